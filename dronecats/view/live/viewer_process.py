"""The page as a process of its own, which only reads: hung, killed or late, it costs a flight nothing."""

import os
import time
from pathlib import Path
from typing import Any

from dronecats.view.live.config import ViewerConfig
from dronecats.view.live.episodes import EpisodeList
from dronecats.view.live.page import LiveFlight, LivePage
from dronecats.view.live.wires import WireFollower
from dronecats.view.scene.page import LoopbackServer
from episodes.records import catalogue
from episodes.world.world import World

PERIOD_S = 0.04  # wall seconds from one update to the next while somebody looks …
IDLE_S = 0.25  # … and while nobody does
LISTED_S = 0.5  # from one look for flights to the next
NICE = 5  # whatever flies comes first


class FolderPage:
    """The flights of a folder."""

    def __init__(self, server: LoopbackServer, root: Path) -> None:
        self._episodes, self._page = EpisodeList(root), LivePage(server)
        self._due_s = 0.0

    def turn(self) -> None:
        """Bring the page up to now."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._page.listed(self._episodes.look())
            self._due_s = now_s + LISTED_S
        self._page.turn()


class FlightViewer:
    """Serves the page and brings it up to what has come, again and again."""

    def __init__(self, config: ViewerConfig) -> None:
        os.nice(NICE)
        label = f"DroneCATS · {config.title}" if config.title else "DroneCATS"
        self._server = LoopbackServer(label, config.port, config.hosts)
        self._config = config
        self._page: FolderPage | LiveFlight | None = None  # made in the first turn: a world may take seconds
        self._due_s = 0.0

    def ready(self) -> dict[str, Any]:
        return {"url": self._server.url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Nothing is asked of it."""

    def turn(self) -> None:
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + (PERIOD_S if self._server.get_clients() else IDLE_S)
        if self._page is None:
            self._page = self._made()
        self._page.turn()

    def close(self) -> None:
        self._server.stop()

    def _made(self) -> FolderPage | LiveFlight:
        wires = self._config.wires
        if wires is None:
            return FolderPage(self._server, Path(self._config.root))
        world = World(catalogue.load(wires.episode))
        self._server.gui.main_panel.dock_right()
        return LiveFlight(self._server, WireFollower(wires, world), world, wires.drones, piloted=False)


def create(config: ViewerConfig) -> FlightViewer:
    """Return the page of a folder, or of a simulator's wires."""
    return FlightViewer(config)
