"""Plant and inner loop of one vehicle fused in one compiled loop, which finds its records and arrays by address.

numba takes about 2 µs to look at each numpy record it is handed, since numpy spells the record's layout out anew each
time: 40 µs for the records of one vehicle, five times what ten milliseconds of flight cost; and 0.1 µs for each array.
So their places in memory are looked up once, and every call hands over the address of the list of them.
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

Addresses = NDArray[np.int64]  # addresses of the records; of each array its address, rows and columns
RECORDS = 7  # the plant and six of the inner loop
PLACES = RECORDS + 3 * 9


@intrinsic  # type: ignore[untyped-decorator]  # numba tells no types
def _pointer(typingctx: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
    """Return an integer as the address it is."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


@njit(cache=True, allocates=True)
def _grid(at: Addresses, number: int) -> Grid:
    """Return the array of this number."""
    k = RECORDS + 3 * number
    grid: Grid = carray(_pointer(at[k]), (at[k + 1], at[k + 2]), np.float64)
    return grid


@njit(cache=True, allocates=True)
def _grid32(at: Addresses, number: int) -> Grid32:
    """Return the array of this number, of floats of half the width."""
    k = RECORDS + 3 * number
    grid: Grid32 = carray(_pointer(at[k]), (at[k + 1], at[k + 2]), np.float32)
    return grid


@njit(cache=True, allocates=True)
def _index(at: Addresses, number: int) -> Index:
    """Return the array of this number, a list of integers."""
    k = RECORDS + 3 * number
    index: Index = carray(_pointer(at[k]), at[k + 1], np.int32)
    return index


@njit(cache=True, allocates=True)
def fly(steps: int, places: int) -> None:
    """Advance one vehicle and its inner loop by `steps` milliseconds. `places`: the address of `Fused`'s list."""
    at = carray(_pointer(places), PLACES, np.int64)
    down, peak = _grid(at, 0), _grid(at, 1)
    triangles = SolidTriangles(_grid32(at, 2), _grid32(at, 3), _index(at, 4), _index(at, 5), _index(at, 6))
    covariance, history = _grid(at, 7), _grid(at, 8)
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
_DOUBLES, _SINGLES, _NUMBERS = (np.dtype(kind) for kind in (np.float64, np.float32, np.int32))
ARRAYS = [  # type, dimensions, and that the entries lie one after the other
    *((_DOUBLES, 2, True),) * 2, *((_SINGLES, 2, True),) * 2, *((_NUMBERS, 1, True),) * 3, *((_DOUBLES, 2, True),) * 2,
]  # fmt: skip


class Fused:
    """One vehicle's plant and inner loop. Records and arrays belong to them; replacing one needs a new Fused."""

    def __init__(self, plant: tuple[Any, ...], core: tuple[Any, ...]) -> None:
        """Take `Multirotor.kernel_args` and `FlightCore.kernel_args`, which share sensors and actuators.

        Raises TypeError when a record or an array is not the one that `fly` takes in its place.
        """
        each_alone = [*plant[:-1], *plant[-1], *core]
        records = [argument for argument in each_alone if isinstance(argument, np.void)]
        arrays = [argument for argument in each_alone if not isinstance(argument, np.void)]
        layouts = [(array.dtype, array.ndim, array.flags.c_contiguous) for array in arrays]
        if [record.dtype for record in records] != [PLANT, *CORE_RECORDS] or layouts != ARRAYS:
            raise TypeError("the arguments of the plant or the inner loop have changed: bring sitl.fused.fly in line")
        # of the sensors and actuators those of the plant are taken
        places = [np.frombuffer(record, np.uint8).ctypes.data for record in records[:RECORDS]]
        for array in arrays:
            places += [array.ctypes.data, len(array), array.shape[-1]]
        self._kept_alive = records, arrays, np.array(places, np.int64)
        self._places = self._kept_alive[-1].ctypes.data
        if compile_ahead.cold():
            compile_ahead.compile_all(update, core)

    def advance(self, steps: int) -> None:
        """Live through `steps` milliseconds."""
        fly(steps, self._places)
