"""Plant and inner loop of one vehicle fused in one compiled loop, which finds its records by address.

numba takes about 2 µs to look at each numpy record it is handed, since numpy spells the record's layout out anew each
time: 40 µs for the records of one vehicle, three times what ten milliseconds of flight cost. So their places in memory
are looked up once, and every call hands over one array of them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from autopilot.control.flight_core import update
from autopilot.control.gains import CONTROL_PARAMS, CONTROL_STATE
from autopilot.estimator.records import ESTIMATOR_PARAMS, ESTIMATOR_STATE
from autopilot.records import ESTIMATE, SETPOINT
from dronecats.flight.sitl import compile_ahead
from foundation.compiled import Grid, njit
from foundation.sensors import ACTUATORS, SENSORS
from vehicles.multirotor import PLANT, step
from vehicles.solids import Grid32, Index, SolidTriangles


@intrinsic  # type: ignore[untyped-decorator]  # numba tells no types
def _pointer(typingctx: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
    """Return an integer as the address it is."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


@njit(cache=True, allocates=True)
def fly(
    steps: int,
    at: NDArray[np.int64],
    down: Grid,
    peak: Grid,
    corners: Grid32,
    bounds: Grid32,
    start: Index,
    numbers: Index,
    owner: Index,
    covariance: Grid,
    history: Grid,
) -> None:
    """Advance one vehicle and its inner loop by `steps` milliseconds. Arguments: `Fused`'s."""
    triangles = SolidTriangles(corners, bounds, start, numbers, owner)  # handed over one by one: looked at faster
    plant = carray(_pointer(at[0]), 1, PLANT)[0]
    control_params = carray(_pointer(at[1]), 1, CONTROL_PARAMS)[0]
    control_state = carray(_pointer(at[2]), 1, CONTROL_STATE)[0]
    filter_params = carray(_pointer(at[3]), 1, ESTIMATOR_PARAMS)[0]
    filter_state = carray(_pointer(at[4]), 1, ESTIMATOR_STATE)[0]
    setpoint = carray(_pointer(at[5]), 1, SETPOINT)[0]
    estimate = carray(_pointer(at[6]), 1, ESTIMATE)[0]
    for _ in range(steps):
        step(plant, down, peak, triangles)
        update(
            control_params, control_state, filter_params, filter_state, covariance, history, setpoint, estimate,
            plant.sensors, plant.actuators,
        )  # fmt: skip


CORE_RECORDS = (
    CONTROL_PARAMS, CONTROL_STATE, ESTIMATOR_PARAMS, ESTIMATOR_STATE, SETPOINT, ESTIMATE, SENSORS, ACTUATORS,
)  # fmt: skip


class Fused:
    """One vehicle's plant and inner loop. The records belong to them; whoever replaces one makes a new Fused."""

    def __init__(self, plant: tuple[Any, ...], core: tuple[Any, ...]) -> None:
        """Take `Multirotor.kernel_args` and `FlightCore.kernel_args`, which share sensors and actuators.

        Raises TypeError when a record is not the one that `fly` takes in its place.
        """
        each_alone = [*plant[:-1], *plant[-1], *core]
        records = [argument for argument in each_alone if isinstance(argument, np.void)]
        kinds = [record.dtype for record in records]
        if kinds != [PLANT, *CORE_RECORDS]:
            raise TypeError("the arguments of the plant or the inner loop have changed: bring sitl.fused.fly in line")
        self._kept_alive = records
        self._at = np.array([np.frombuffer(record, np.uint8).ctypes.data for record in records], np.int64)
        self._arrays = tuple(argument for argument in each_alone if not isinstance(argument, np.void))
        if compile_ahead.cold():
            compile_ahead.compile_all(update, core)

    def advance(self, steps: int) -> None:
        """Live through `steps` milliseconds."""
        fly(steps, self._at, *self._arrays)
