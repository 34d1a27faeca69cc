"""A worker: a process that flies episodes, several at a time, and dies with whoever started it.

A flight is a thread. What the flights of a worker share is what never changes: code, compiled kernels, and the maps.
"""

import gc
import os
import queue
import sys
import threading
import traceback
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.flight.run.simulated import SimulatedFlight
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import from_json
from foundation.compiled import in_turn
from foundation.errors import DronecatsError
from foundation.threads import COMPUTING, expect_more


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerConfig:
    """A worker that flies what it is told to, several flights at a time where they mostly wait for a model."""

    poll_s: float = 0.2  # wall s at most until it answers whether a flight is over


# Short, since a flight asks for the interpreter anew after each picture and each line that it writes, and would wait
# for this long whenever another one computes.
SWITCH_S = 0.0005


class Worker:
    """A child process of a campaign. `fly` begins a flight, `ended` tells of one that is over."""

    def __init__(self, config: WorkerConfig) -> None:
        self._poll_s = config.poll_s
        self._idle = threading.Event()
        self._ended: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        sys.setswitchinterval(SWITCH_S)
        expect_more()
        with in_turn():  # all start at once: the first compiles what has to be, the others find it done
            compile_all()
        gc.freeze()  # code and kernels stay for good: no collection has to look at them again

    def ready(self) -> dict[str, Any]:
        return {"pid": os.getpid()}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Begin to fly a `flight` in `folder`, or return one that has ended; None while there is none.

        What has ended is told with its `folder`, and has a `result`, or the `fault` for which there is none.
        """
        if command == "ended":
            try:
                return self._ended.get(timeout=self._poll_s)
            except queue.Empty:
                return None
        threading.Thread(target=self._fly, kwargs=arguments, daemon=True).start()
        return None

    def _fly(self, flight: dict[str, Any], folder: str) -> None:
        said = flown(flight, Path(folder))
        gc.collect()  # a flight is full of circles, and the buffers of its pictures are large
        self._ended.put({**said, "folder": folder})

    def turn(self) -> None:
        """Wait a little; `dronecats.flight.processes.child` looks for the next command."""
        self._idle.wait(0.01)

    def orphaned(self) -> None:
        """Whoever wanted the result is gone: nobody waits for a flight of minutes to end."""
        os._exit(1)

    def close(self) -> None:
        pass


def flown(told: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Fly the flight that JSON values are, in a folder that is prepared for it; whatever happens, return.

    Returns its `result` as `fly --json` has it, or the `fault` for which there is none. Any engine may call it, and
    anywhere: all that it needs is the flight and an empty folder.
    """
    try:
        spec = from_json(told, "a worker's order")
        with COMPUTING.taken() if waits_for_models_alone(spec) else nullcontext():
            result = SimulatedFlight(look_up(spec)).fly_in(folder, lambda line: None)
    except DronecatsError as error:
        return {"fault": str(error)}
    except Exception as bug:
        traceback.print_exc()  # into the worker's log
        return {"fault": f"an unexpected {type(bug).__name__}: {bug}"}
    return {"result": {key: value for key, value in result.items() if key not in ("status", "run_dir")}}


def waits_for_models_alone(spec: FlightSpec) -> bool:
    """Return whether a flight's thread computes all the time, but for its model: in lockstep, with all in one process.

    In real time it mostly waits for the clock, and under a PX4 for that.
    """
    simulated = spec.simulated
    return simulated is not None and simulated.speed is None and simulated.autopilot == "ours"


def compile_all() -> None:
    """Have every kernel of flight compiled, so that workers that start later find them in the cache."""
    from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
    from vehicles import airframe

    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=0, origin=(0.0, 0.0, 0.0))
    vehicle.advance()
    vehicle.close()


def create(config: WorkerConfig) -> Worker:
    """Return a worker. Raises UsageError."""
    return Worker(config)
