"""Runs a built-in pilot in a child process, as an OpenAI-compatible endpoint on the loopback interface."""

import time
from dataclasses import dataclass
from typing import Any

from dronecats.pilots import roster
from dronecats.pilots.server import PilotServer


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotConfig:
    """The configuration that the parent sends to the child process."""

    pilot: str  # name of the pilot (`dronecats.pilots.roster`)
    port: int = 0  # TCP port; 0: the system chooses one


class PilotPart:
    """The endpoint of a pilot, with the interface `Part` of child processes (`dronecats.flight.processes.child`)."""

    def __init__(self, config: PilotConfig) -> None:
        """Raises UsageError if the pilot replays a file that has no replies."""
        name = config.pilot
        self._server = PilotServer(roster.answer(name), name, owned_by=roster.owner(name), port=config.port).start()

    def ready(self) -> dict[str, Any]:
        return {"base_url": self._server.base_url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        return None

    def turn(self) -> None:
        time.sleep(0.05)  # the server runs in its own thread; this thread only polls for the parent's commands

    def close(self) -> None:
        self._server.close()
