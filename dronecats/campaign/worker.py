"""A worker: a process that flies episodes in lockstep, several at a time, and dies with whoever started it.

A flight is a thread. What the flights of a worker share is what never changes: code, compiled kernels, and the maps.
"""

import gc
import os
import queue
import sys
import threading
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.campaign.config import WorkerConfig
from dronecats.flight.flight import look_up
from dronecats.run.settings import settings
from dronecats.run.simulated import fly_in
from foundation.errors import DronecatsError

# Short, since a flight asks for the interpreter anew after each picture and each line that it writes, and would wait
# for this long whenever another one computes.
SWITCH_S = 0.0005


class Worker:
    """Part of a run (`dronecats.processes.child`). `fly` begins an episode, `ended` waits for the next that is over."""

    def __init__(self, config: WorkerConfig) -> None:
        self._spec = config.flight
        self._idle = threading.Event()
        self._ended: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        sys.setswitchinterval(SWITCH_S)
        compile_all()

    def ready(self) -> dict[str, Any]:
        return {"pid": os.getpid()}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Begin to fly the episode of a `record` in `folder`, or wait for one that has ended and return its result.

        What has ended is told with its `folder`, and has a `result`, or the `fault` for which there is none.
        """
        if command == "ended":
            return self._ended.get()
        threading.Thread(target=self._fly, args=(arguments["record"], arguments["folder"]), daemon=True).start()
        return None

    def _fly(self, record: dict[str, Any], folder: str) -> None:
        said = self._flown(record, Path(folder))
        gc.collect()  # a flight is full of circles, and the buffers of its pictures are large
        self._ended.put({**said, "folder": folder})

    def _flown(self, record: dict[str, Any], folder: Path) -> dict[str, Any]:
        try:
            flight = look_up(replace(self._spec, episode=None, record=record), ask_model=False)
            result = fly_in(folder, flight, lambda line: None, settings(flight, flight.camera))
        except DronecatsError as error:
            return {"fault": str(error)}
        except Exception as bug:
            traceback.print_exc()  # into the worker's log
            return {"fault": f"an unexpected {type(bug).__name__}: {bug}"}
        return {"result": {key: value for key, value in result.items() if key not in ("status", "run_dir")}}

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
