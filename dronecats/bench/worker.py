"""The worker process of the local engine: flies several episodes at a time, and ends with its parent process.

Each flight is a thread. The flights of a worker share code, compiled kernels and maps, which never change.
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

from dronecats.flight.processes.child import Part
from dronecats.flight.run.simulated import SimulatedFlight
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import from_json
from foundation.compiled import compile_lock
from foundation.errors import DronecatsError
from foundation.threads import COMPUTING


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerConfig:
    poll_s: float  # wall s, longest wait of the command `ended` for a flight


# s, switch interval of the interpreter. It is short, because a flight needs the interpreter's lock (GIL) again after
# each picture and each written line, and waits this long for it if another flight computes.
SWITCH_S = 0.0005
# New objects between two garbage collections. With Python's default of 700, collections take 7 % of the time of a
# flight without rendering. They free almost nothing, because reference counting frees the objects of a tick.
YOUNG = 20_000


class Worker(Part):
    """Flies for a campaign. The command `fly` begins a flight, `ended` returns one that is over."""

    def __init__(self, config: WorkerConfig) -> None:
        self._poll_s = config.poll_s
        self._idle = threading.Event()
        self._ended: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        sys.setswitchinterval(SWITCH_S)
        with compile_lock():  # workers start together: the first one compiles, the others use the cache
            compile_all()
        gc.freeze()  # code and kernels are permanent, so collections may skip them
        gc.set_threshold(YOUNG, 10, 10)

    def ready(self) -> dict[str, Any]:
        return {"pid": os.getpid()}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Run a command: `fly` begins a `flight` in a `folder`, `ended` returns a flight that has ended, or None.

        An ended flight is a dict with its `folder`, and its `result` or a `fault` that says why it has no result.
        """
        if command == "ended":
            try:
                return self._ended.get(timeout=self._poll_s)
            except queue.Empty:
                return None
        threading.Thread(target=self._fly, kwargs=arguments, daemon=True).start()
        return None

    def _fly(self, flight: dict[str, Any], folder: str) -> None:
        outcome = fly_flight(flight, Path(folder))
        gc.collect()  # a flight leaves reference cycles with large picture buffers
        self._ended.put({**outcome, "folder": folder})

    def turn(self) -> None:
        """Wait a little before `dronecats.flight.processes.child` reads the next command."""
        self._idle.wait(0.01)

    def orphaned(self) -> None:
        """End at once, because the parent process has ended and the flights are no longer needed."""
        os._exit(1)


def fly_flight(flight: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Fly a flight (a FlightSpec as JSON values) in a prepared empty folder. Raises nothing.

    Returns its `result` as in `fly --json`, or a `fault`: the reason why there is no result.
    """
    try:
        spec = from_json(flight, "a worker's order")
        with COMPUTING.taken() if is_compute_bound(spec) else nullcontext():
            result = SimulatedFlight(look_up(spec)).fly_in(folder, lambda line: None)
    except DronecatsError as error:
        return {"fault": str(error)}
    except Exception as bug:
        traceback.print_exc()  # into the worker's log
        return {"fault": f"an unexpected {type(bug).__name__}: {bug}"}
    return {"result": {key: value for key, value in result.items() if key not in ("status", "run_dir")}}


def is_compute_bound(spec: FlightSpec) -> bool:
    """Return whether a flight's thread computes all the time, except while it waits for its model.

    This is the case in lockstep with the built-in autopilot. In real time the thread mostly waits for the clock, and
    with PX4 it mostly waits for the PX4 process.
    """
    simulated = spec.simulated
    return simulated is not None and simulated.speed is None and simulated.autopilot == "ours"


def compile_all() -> None:
    """Compile every kernel of flight, so that workers that start later find them in the cache."""
    from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
    from vehicles import airframe

    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=0, origin=(0.0, 0.0, 0.0))
    vehicle.advance()
    vehicle.close()
