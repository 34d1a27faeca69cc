"""The compiled inner loop of one flight controller: it updates estimate and actuators every millisecond."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.control import cascade, gains
from autopilot.control.gains import CONTROL_STATE
from autopilot.control.loop_design import design
from autopilot.control.mixer import allocation
from autopilot.estimator import records
from autopilot.estimator.ekf import update as estimate_motion
from autopilot.estimator.records import HISTORY, STATES
from autopilot.records import ESTIMATE, KIND_IDLE, SETPOINT
from foundation.airframe import Airframe
from foundation.compiled import Grid, Record, njit
from foundation.errors import UsageError

control = cascade.update


@njit(cache=True)
def update(
    params: Record,
    state: Record,
    filter_params: Record,
    filter_state: Record,
    covariance: Grid,
    history: Grid,
    setpoint: Record,
    estimate: Record,
    sensors: Record,
    actuators: Record,
) -> None:
    """Run the estimator and, on a new inertial sample, the cascade. Arguments: `FlightCore.kernel_args`.

    A setpoint that stops the rotors needs no sample: disarming and termination also act while the sensor is silent.
    """
    on_ground = setpoint.armed == 0  # a disarmed vehicle counts as on the ground
    if estimate_motion(filter_params, filter_state, covariance, history, sensors, estimate, on_ground):
        control(params, state, setpoint, estimate, actuators)
    elif setpoint.armed == 0 or setpoint.kind == KIND_IDLE:
        cascade.stop(params, state, setpoint, actuators)
        actuators.armed = 1 if setpoint.armed != 0 else 0


def empty_setpoint() -> np.void:
    """Return an empty SETPOINT record: disarmed, no axis controlled, no limits."""
    setpoint: np.void = np.zeros(1, SETPOINT)[0]
    for name in SETPOINT.names or ():
        if SETPOINT[name].base.kind == "f":
            setpoint[name] = np.nan
    setpoint["kind"] = KIND_IDLE
    setpoint["thrust_limit"] = 1.0
    return setpoint


class CoreArguments(NamedTuple):
    """The arguments of `update` for one flight controller."""

    params: np.void  # CONTROL_PARAMS
    state: np.void  # CONTROL_STATE
    filter_params: np.void  # ESTIMATOR_PARAMS
    filter_state: np.void  # ESTIMATOR_STATE
    covariance: NDArray[np.float64]
    history: NDArray[np.float64]
    setpoint: np.void  # SETPOINT
    estimate: np.void  # ESTIMATE
    sensors: np.void  # SENSORS
    actuators: np.void  # ACTUATORS


class FlightCore:
    """The estimator and the cascade of one vehicle, and the records that they share with the commander.

    The commander writes `setpoint` (SETPOINT) and reads `estimate` (ESTIMATE). It sets `state["landed"]` to 1 while the
    vehicle is landed or disarmed, which resets the integrals. `params` and `filter_params` hold gains, limits and noise
    figures.
    """

    def __init__(self, airframe: Airframe) -> None:
        """Design the gains of `airframe`. Raises UsageError if it cannot be controlled."""
        self.airframe = airframe
        self.gains = design(airframe)
        self.params = gains.default_parameters(self.gains, allocation(airframe), len(airframe.rotors))
        self.state = np.zeros(1, CONTROL_STATE)[0]
        self.state["attitude_setpoint"] = (1.0, 0.0, 0.0, 0.0)
        self.state["torque_scale"] = 1.0
        self.state["hover_thrust"] = self.params["hover_thrust"]
        self.filter_params = records.default_parameters()
        self.filter_state = records.initial_state()
        self.covariance = np.zeros((STATES, STATES))
        self.history = np.zeros((HISTORY, 7))
        self.setpoint = empty_setpoint()
        self.estimate = np.zeros(1, ESTIMATE)[0]
        self.estimate["attitude"] = (1.0, 0.0, 0.0, 0.0)
        self._defaults = {name: gains.read(self.params, name) for name in gains.GAINS}

    def kernel_args(self, sensors: np.void, actuators: np.void) -> CoreArguments:
        """Return the arguments of `update` for these SENSORS and ACTUATORS records."""
        if sensors.dtype.names is None or "imu_time_us" not in sensors.dtype.names:
            raise UsageError("the flight core reads a foundation.sensors.SENSORS record: pass vehicle.sensors")
        return CoreArguments(
            self.params, self.state, self.filter_params, self.filter_state, self.covariance, self.history,
            self.setpoint, self.estimate, sensors, actuators,
        )  # fmt: skip

    def parameter_defaults(self) -> dict[str, float]:
        """Return every PX4 parameter of the core with its default for this airframe, in PX4's units."""
        return dict(self._defaults)

    def set_parameter(self, name: str, value: float) -> float:
        """Set a PX4 parameter, at any time; return the value that is set: `value` limited to the parameter's range.

        Raises UsageError for a parameter that the core does not have, or a value that is not finite.
        """
        return gains.write(self.params, name, value)
