"""The logger as a process: listens on the truth bus and on a telemetry port of its own, and writes."""

from functools import partial
from pathlib import Path
from typing import Any

from dronecats.flight.logger.config import LoggerConfig
from dronecats.flight.logger.recorder import Recorder
from dronecats.flight.logger.telemetry import subscribe
from dronecats.flight.logger.world_measure import measured_in
from dronecats.flight.processes.bus_listener import Listener
from dronecats.flight.sitl.scenario import load_world, origin
from foundation.camera import CameraModel


class Logger:
    """Part of a real-time flight."""

    def __init__(self, config: LoggerConfig) -> None:
        world = load_world(config.episode, config.airframe)
        self._recorder = Recorder(Path(config.folder), origin(world), measured_in(world), CameraModel())
        self._drones = len(world.record.starts)
        self._truth = Listener(config.truth, self._recorder.truth)
        self._telemetry = [
            Listener(url, partial(self._recorder.telemetry, drone=drone)) for drone, url in enumerate(config.telemetry)
        ]
        for index, listener in enumerate(self._telemetry):
            subscribe(listener.send, index + 1)

    def ready(self) -> dict[str, Any]:
        return {}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        match command:
            case "begin":
                self._recorder.begin(arguments["t0_us"], arguments["cap_s"])
            case "end":
                self.turn()
                self._recorder.end(arguments["reason"], arguments.get("error"))
            case "heard":
                return self._recorder.drones >= self._drones
        return None

    def turn(self) -> None:
        self._truth.read(0.02)
        for listener in self._telemetry:
            listener.read(0.0)

    def close(self) -> None:
        self._recorder.close()


def create(config: LoggerConfig) -> Logger:
    """Return the logger for an episode file, its airframe, an episode folder, and the URLs to listen on."""
    return Logger(config)
