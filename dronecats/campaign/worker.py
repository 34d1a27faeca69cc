"""A worker: a process that flies one episode after the other in lockstep, and dies with whoever started it."""

import os
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.campaign.config import WorkerConfig
from dronecats.flight.flight import look_up
from dronecats.run.settings import settings
from dronecats.run.simulated import fly_in


class Worker:
    """Part of a run (`dronecats.processes.child`). Its one command flies an episode and answers with the result."""

    def __init__(self, config: WorkerConfig) -> None:
        self._spec = config.flight
        self._idle = threading.Event()
        compile_all()

    def ready(self) -> dict[str, Any]:
        return {"pid": os.getpid()}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Fly the episode of a `record` in `folder`."""
        flight = look_up(replace(self._spec, episode=None, record=arguments["record"]), ask_model=False)
        folder = Path(arguments["folder"])
        result = fly_in(folder, flight, lambda line: None, settings(flight, flight.camera))
        return {key: value for key, value in result.items() if key not in ("status", "run_dir")}

    def turn(self) -> None:
        """Wait a little; `dronecats.processes.child` looks for the next command."""
        self._idle.wait(0.01)

    def orphaned(self) -> None:
        """Whoever wanted the result is gone: nobody waits for a flight of minutes to end."""
        os._exit(1)

    def close(self) -> None:
        pass


def compile_all() -> None:
    """Have every kernel of flight compiled, so that workers that start later find them in the cache."""
    from dronecats.sitl.simulation import BootPose, SimulatedVehicle
    from vehicles import airframe

    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=0, origin=(0.0, 0.0, 0.0))
    vehicle.advance()
    vehicle.close()


def create(config: WorkerConfig) -> Worker:
    """Return a worker. Raises UsageError."""
    return Worker(config)
