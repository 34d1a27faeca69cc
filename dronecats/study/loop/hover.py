"""Defines the loops of the control cascade, and simulates the hover of an airframe, from which every trial starts."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.control.flight_core import CoreArguments, FlightCore
from autopilot.records import ESTIMATE, KIND_ATTITUDE, KIND_RATES, KIND_TRAJECTORY, SETPOINT
from dronecats.study.loop.feedback import (
    ATTITUDE,
    CHANNELS,
    COLUMNS,
    DELAY_LINE_ROWS,
    RATE,
    VELOCITY,
    simulate_with_delay,
)
from foundation.airframe import Airframe
from foundation.errors import UsageError
from foundation.frames import PX4_HOME, quat_from_euler
from foundation.wording import suggestion
from vehicles.multirotor import Multirotor, PlantArguments
from vehicles.sensors import PERFECT, Suite


@dataclass(frozen=True, slots=True)
class CascadeLoop:
    """One loop about one axis, and the small step that tests it."""

    name: str  # as in `dronecats tune`
    group: str  # rate, attitude or velocity
    level: int  # RATE, ATTITUDE or VELOCITY: the quantity that is fed back
    axis: int  # 0, 1, 2: roll, pitch, yaw, or north, east, down
    step: float  # rad/s, rad or m/s: so small that nothing saturates


TURNS = ("roll", "pitch", "yaw")
LOOPS = (
    *(CascadeLoop(f"{a} rate", "rate", RATE, k, 0.05) for k, a in enumerate(TURNS)),
    *(CascadeLoop(f"{a} attitude", "attitude", ATTITUDE, k, 0.02) for k, a in enumerate(TURNS)),
    CascadeLoop("horizontal velocity", "velocity", VELOCITY, 0, 0.1),
    CascadeLoop("vertical velocity", "velocity", VELOCITY, 2, 0.1),
)
GROUPS = ("rate", "attitude", "velocity")


def select_loops(names: list[str] | None) -> tuple[CascadeLoop, ...]:
    """Return the loops whose name or group is in `names`; None: all loops. Raises UsageError for an unknown name."""
    for name in names or ():
        if name not in GROUPS and name not in [loop.name for loop in LOOPS]:
            raise UsageError(
                f"--loops {name} is not known: {suggestion(name, [*GROUPS, *(loop.name for loop in LOOPS)])}"
            )
    return tuple(loop for loop in LOOPS if not names or loop.group in names or loop.name in names)


Array = NDArray[np.float64]

SAMPLE_S = 0.001
HEIGHT_M = 30.0
CLIMB = 2.0  # m/s
BOOT_S, SETTLE_S = 10.0, 12.0
STEADY_S = {"rate": 0.1, "attitude": 1.0, "velocity": 8.0}  # s with a setpoint of zero before a step, by group


@dataclass(frozen=True, slots=True)
class StepResponse:
    """The response of a vehicle to a setpoint step at time 0."""

    time: Array  # (n,) s, every millisecond
    value: Array  # (n,) rad/s, rad or m/s: true quantity of the loop, minus its value before the step
    step: float  # size of the step, in the unit of `value`


class Stack(NamedTuple):
    """The state records of one vehicle and its flight controller."""

    plant: PlantArguments
    core: CoreArguments

    def copied(self) -> "Stack":
        plant, core = self.plant, self.core
        return Stack(
            plant._replace(plant=plant.plant.copy()),
            core._replace(**{name: value.copy() for name, value in core._asdict().items()}),
        )


class Hover:
    """A hovering vehicle, kept as records of its state. Each trial flies a copy of these records."""

    def __init__(self, airframe: Airframe, suite: Suite = PERFECT) -> None:
        """Boot, climb and settle. Raises UsageError for an airframe that cannot be controlled.

        The rotors are balanced and the default sensors are perfect, because vibration, noise and bias would hide a
        stability margin.
        """
        self.airframe = airframe = airframe.balanced()
        vehicle = Multirotor(airframe, seed=1, origin=PX4_HOME, suite=suite)
        core = FlightCore(airframe)
        self.gains = core.gains
        self._stack = Stack(vehicle.kernel_args, core.kernel_args(vehicle.sensors, vehicle.actuators))
        self._fly(self._stack, BOOT_S)
        self._set(self._stack, KIND_TRAJECTORY, velocity_ned=(0.0, 0.0, -CLIMB), yaw=0.0)
        self._fly(self._stack, HEIGHT_M / CLIMB)
        self._set(self._stack, KIND_TRAJECTORY, position_ned=(0.0, 0.0, -HEIGHT_M), yaw=0.0)
        self._fly(self._stack, SETTLE_S)

    @property
    def plant(self) -> Any:
        """The PLANT record of the hover, read-only."""
        return self._stack.plant.plant

    def step_response(self, loop: CascadeLoop, delay_s: float, seconds: float) -> StepResponse:
        """Return the response to a small step of a loop's setpoint while the loop's feedback is `delay_s` late."""
        stack = self._stack.copied()
        self._enter(stack, loop, 0.0)
        before = self._fly(stack, STEADY_S[loop.group])
        self._enter(stack, loop, loop.step)
        after = self._fly(stack, seconds, loop, delay_s)
        value = measured_values(loop, after) - measured_values(loop, before)[-1]
        return StepResponse(np.arange(1, len(value) + 1, dtype=np.float64) * SAMPLE_S, value, loop.step)

    def _enter(self, stack: "Stack", loop: CascadeLoop, size: float) -> None:
        """Set the setpoint of a loop to `size` on the loop's axis. This makes the outer loops inactive."""
        setpoint = tuple(size if axis == loop.axis else 0.0 for axis in range(3))
        thrust = float(stack.core.state["hover_thrust"])
        if loop.level == RATE:
            self._set(stack, KIND_RATES, rates_frd=setpoint, thrust=thrust)
        elif loop.level == ATTITUDE:
            self._set(stack, KIND_ATTITUDE, attitude=quat_from_euler(*setpoint), yaw_rate=0.0, thrust=thrust)
        else:
            self._set(stack, KIND_TRAJECTORY, velocity_ned=setpoint, yaw=0.0)

    @staticmethod
    def _set(stack: "Stack", kind: int, **fields: Any) -> None:
        setpoint = stack.core.setpoint
        for name in SETPOINT.names or ():
            if SETPOINT[name].base.kind == "f":
                setpoint[name] = np.nan
        setpoint["kind"], setpoint["armed"], setpoint["thrust_limit"] = kind, 1, 1.0
        for name, value in fields.items():
            setpoint[name] = value

    @staticmethod
    def _fly(stack: "Stack", seconds: float, loop: CascadeLoop | None = None, delay_s: float = 0.0) -> Array:
        """Fly, with the feedback of `loop` late by `delay_s`; return the truth of every millisecond, (n, COLUMNS)."""
        out = np.empty((round(seconds / SAMPLE_S), COLUMNS))
        level, axis = (loop.level, loop.axis) if loop else (RATE, 0)
        line, late_estimate = np.zeros((DELAY_LINE_ROWS, CHANNELS)), np.zeros(1, ESTIMATE)[0]
        core = stack.core
        simulate_with_delay(
            level, axis, min(delay_s / SAMPLE_S, DELAY_LINE_ROWS - 2.0), out, line, late_estimate, *stack.plant,
            core.params, core.state, core.filter_params, core.filter_state, core.covariance, core.history,
            core.setpoint, core.estimate,
        )  # fmt: skip
        return out


def measured_values(loop: CascadeLoop, rows: Array) -> Array:
    """Return the controlled quantity of a loop from rows of truth (n, COLUMNS): (n,) rad/s, rad or m/s."""
    if loop.level == RATE:
        return rows[:, loop.axis]
    if loop.level != ATTITUDE:
        return rows[:, 7 + loop.axis]
    w, x, y, z = rows[:, 3:7].T
    angles = (
        np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
    return np.asarray(np.unwrap(angles[loop.axis]))
