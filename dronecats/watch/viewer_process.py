"""The page as a process of its own, which only reads: hung, killed or late, it costs a flight nothing."""

import os
import time
from pathlib import Path
from typing import Any

from dronecats.scenery.page import LoopbackServer
from dronecats.watch.config import ViewerConfig
from dronecats.watch.episodes import EpisodeList
from dronecats.watch.page import LivePage

PERIOD_S = 0.04  # wall seconds from one update to the next while somebody looks …
IDLE_S = 0.25  # … and while nobody does
LISTED_S = 0.5  # from one look for flights to the next
NICE = 5  # whatever flies comes first


class FlightViewer:
    """Serves the page and brings it up to the folder, again and again."""

    def __init__(self, config: ViewerConfig) -> None:
        os.nice(NICE)
        self._server = LoopbackServer(f"DroneCATS · {config.title}" if config.title else "DroneCATS", config.port)
        self._episodes = EpisodeList(Path(config.root))
        self._page = LivePage(self._server)
        self._due_s = self._list_due_s = 0.0

    def ready(self) -> dict[str, Any]:
        return {"url": self._server.url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Nothing is asked of it."""

    def turn(self) -> None:
        now_s = time.monotonic()
        time.sleep(max(0.0, self._due_s - now_s))
        began_s = time.monotonic()
        self._due_s = began_s + (PERIOD_S if self._server.get_clients() else IDLE_S)
        if began_s >= self._list_due_s:
            self._page.listed(self._episodes.look())
            self._list_due_s = time.monotonic() + LISTED_S
        self._page.turn()

    def close(self) -> None:
        self._server.stop()


def create(config: ViewerConfig) -> FlightViewer:
    """Return the page of a folder."""
    return FlightViewer(config)
