"""Runs a vehicle's plant (physics) and inner loop (estimator and controller) in one compiled loop.

For each call, numba needs 0.1 µs per array argument, but about 2 µs per numpy record, because numpy describes the
record's layout anew. The records of one vehicle would take 40 µs, five times as long as the computation of 10 ms of
flight. So `Fused` stores all memory addresses in one list, and each call passes only the address of this list.
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

Addresses = NDArray[np.int64]  # address of each record; address, rows and columns of each array
RECORDS = 7  # the plant and six of the inner loop
PLACES = RECORDS + 3 * 9  # entries of the list: one for each record, three for each of nine arrays


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type annotations
def _pointer(typingctx: Any, address: Any) -> tuple[Any, Callable[..., Any]]:

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


@njit(cache=True, allocates=True)
def _grid(at: Addresses, number: int) -> Grid:
    """Return the two-dimensional float64 array `number` (0 …) of the list `at`."""
    k = RECORDS + 3 * number
    grid: Grid = carray(_pointer(at[k]), (at[k + 1], at[k + 2]), np.float64)
    return grid


@njit(cache=True, allocates=True)
def _grid32(at: Addresses, number: int) -> Grid32:
    """Return the two-dimensional float32 array `number` of the list `at`."""
    k = RECORDS + 3 * number
    grid: Grid32 = carray(_pointer(at[k]), (at[k + 1], at[k + 2]), np.float32)
    return grid


@njit(cache=True, allocates=True)
def _index(at: Addresses, number: int) -> Index:
    """Return the one-dimensional int32 array `number` of the list `at`."""
    k = RECORDS + 3 * number
    index: Index = carray(_pointer(at[k]), at[k + 1], np.int32)
    return index


@njit(cache=True, allocates=True)
def fly(steps: int, places: int) -> None:
    """Advance one vehicle and its inner loop by `steps` milliseconds. `places`: address of the list in `Fused`."""
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
ARRAYS = [  # for each array: dtype, number of dimensions, whether it is C-contiguous
    *((_DOUBLES, 2, True),) * 2, *((_SINGLES, 2, True),) * 2, *((_NUMBERS, 1, True),) * 3, *((_DOUBLES, 2, True),) * 2,
]  # fmt: skip


class Fused:
    """The fused loop of one vehicle. It holds addresses, so a new record or array needs a new Fused."""

    def __init__(self, plant: tuple[Any, ...], core: tuple[Any, ...]) -> None:
        """`plant`: `Multirotor.kernel_args`; `core`: `FlightCore.kernel_args`. Both use the same sensors and actuators.

        Raises TypeError if a record or an array does not have the type that `fly` expects.
        """
        each_alone = [*plant[:-1], *plant[-1], *core]
        records = [argument for argument in each_alone if isinstance(argument, np.void)]
        arrays = [argument for argument in each_alone if not isinstance(argument, np.void)]
        layouts = [(array.dtype, array.ndim, array.flags.c_contiguous) for array in arrays]
        if [record.dtype for record in records] != [PLANT, *CORE_RECORDS] or layouts != ARRAYS:
            raise TypeError("the arguments of the plant or the inner loop have changed: bring sitl.fused.fly in line")
        # the core's sensors and actuators are left out: `fly` uses the plant's
        places = [np.frombuffer(record, np.uint8).ctypes.data for record in records[:RECORDS]]
        for array in arrays:
            places += [array.ctypes.data, len(array), array.shape[-1]]
        self._kept_alive = records, arrays, np.array(places, np.int64)
        self._places = self._kept_alive[-1].ctypes.data
        if compile_ahead.should_compile_in_parallel():
            compile_ahead.compile_all(update, core)

    def advance(self, steps: int) -> None:
        fly(steps, self._places)
