"""The records of the control loops. `read` and `write` access gains and limits by PX4's names and units.

CONTROL_PARAMS holds the gains and limits. CONTROL_STATE holds the values that the loops keep from one step to the next;
a step is one millisecond.
"""

import math
from dataclasses import dataclass

import numpy as np

from autopilot.control.loop_design import Gains
from autopilot.control.mixer import Allocation
from foundation.errors import UsageError
from foundation.sensors import MAX_ROTORS

CONTROL_PARAMS = np.dtype(
    [
        ("position_p", "f8", (3,)),  # 1/s
        ("velocity_p", "f8", (3,)),  # m/s² per m/s
        ("velocity_i", "f8", (3,)),  # m/s² per m
        ("velocity_d", "f8", (3,)),  # m/s² per m/s²
        ("speed_max_horizontal", "f8"),  # m/s
        ("speed_max_up", "f8"),  # m/s
        ("speed_max_down", "f8"),  # m/s
        ("acceleration_horizontal", "f8"),  # m/s², for position setpoints
        ("acceleration_horizontal_max", "f8"),  # m/s², for velocity setpoints
        ("acceleration_up", "f8"),  # m/s²
        ("acceleration_down", "f8"),  # m/s²
        ("jerk_position", "f8"),  # m/s³, for position setpoints
        ("jerk_velocity", "f8"),  # m/s³, for velocity setpoints
        ("tilt_max", "f8"),  # rad
        ("thrust_min", "f8"),  # 0 … 1, collective, in the air
        ("thrust_max", "f8"),  # 0 … 1
        ("thrust_horizontal_margin", "f8"),  # 0 … 1, reserved for the horizontal force when thrust saturates
        ("hover_thrust", "f8"),  # 0 … 1, from the airframe's constants
        ("yaw_rate_auto_max", "f8"),  # rad/s, while turning to a yaw setpoint
        ("velocity_lag", "f8", (3,)),  # s, lag of acceleration behind its setpoint and of velocity behind its reference
        ("yaw_lag", "f8"),  # s, lag of yaw rate behind its setpoint
        ("attitude_p", "f8", (3,)),  # 1/s, roll pitch yaw
        ("yaw_weight", "f8"),  # limit of sin(yaw error / 2)
        ("rate_max", "f8", (3,)),  # rad/s
        ("torque_acceleration", "f8", (3,)),  # rad/s², angular acceleration at a normalised torque of 1
        ("rate_p", "f8", (3,)),  # normalised torque per rad/s
        ("rate_i", "f8", (3,)),  # normalised torque per rad
        ("rate_d", "f8", (3,)),  # normalised torque per rad/s²
        ("rate_integral_limit", "f8", (3,)),  # normalised torque
        ("gyro_cutoff_hz", "f8"),  # first-order low-pass of the rates
        ("gyro_derivative_cutoff_hz", "f8"),  # first-order low-pass of the derivative of the rates
        ("airmode", "i8"),  # 1: thrust may rise to keep the roll and pitch torque
        ("rotors", "i8"),
        ("mix", "f8", (MAX_ROTORS, 4)),  # rotor thrust fraction per normalised torque (roll, pitch, yaw) and thrust
        ("rotor_thrust_min", "f8"),  # 0 … 1, thrust of an idling rotor as a fraction of its full thrust
    ],
    align=True,
)

CONTROL_STATE = np.dtype(
    [
        ("landed", "i8"),  # input: 1 while the vehicle is landed or disarmed, which resets the integrals
        ("time_us", "i8"),  # time of the newest inertial sample
        ("outer_time_us", "i8"),  # when the position and velocity loops last ran
        ("attitude_time_us", "i8"),
        ("kind", "i8"),  # kind of the setpoint in the last step
        ("velocity_reference", "f8", (3,)),  # m/s, smoothed velocity setpoint
        ("acceleration_reference", "f8", (3,)),  # m/s², derivative of velocity_reference
        ("velocity_expected", "f8", (3,)),  # m/s, velocity of a vehicle that follows the reference with velocity_lag
        ("acceleration_expected", "f8", (3,)),  # m/s², derivative of velocity_expected
        ("velocity_integral", "f8", (3,)),  # m/s²
        ("free_integral", "f8", (3,)),  # m/s², smoothed velocity_integral, updated while the velocity error is small
        ("tried_integral", "f8", (3,)),  # m/s², velocity_integral before the increase that is being tested
        ("tried_error", "f8"),  # m/s, velocity error before that increase
        ("blocked_s", "f8"),  # s since an obstacle was hit, 0: none; without a knock, it starts at FIRST_S
        ("blocked_way", "f8", (3,)),  # unit vector, NED, direction of the push against the obstacle
        ("unexplained", "f8", (6,)),  # m/s², rad/s², FRD, accelerations that the rotors do not explain, filtered
        ("unexplained_slow", "f8", (6,)),  # the slow part of `unexplained`, such as wind
        ("torque_filtered", "f8", (3,)),  # normalised, with the lag of the rotors
        ("untouched_s", "f8"),  # s since the last knock (impact on an obstacle)
        ("acceleration_filtered", "f8", (3,)),  # m/s², NED, measured
        ("yaw_reference", "f8"),  # rad, yaw setpoint of the attitude loop; turns at yaw_rate_expected
        ("yaw_rate_expected", "f8"),  # rad/s, yaw_rate_reference with the lag yaw_lag
        ("yaw_rate_reference", "f8"),  # rad/s, smoothed yaw rate setpoint
        ("attitude_setpoint", "f8", (4,)),
        ("thrust_setpoint", "f8"),
        ("rates_setpoint", "f8", (3,)),
        ("rates_filtered", "f8", (3,)),
        ("rates_derivative", "f8", (3,)),
        ("rate_integral", "f8", (3,)),
        ("torque", "f8", (3,)),  # normalised, as achieved by the mixer
        ("torque_scale", "f8", (3,)),  # 0 … 1, achieved torque / demanded torque
        ("hover_thrust", "f8"),  # 0 … 1, running estimate
        ("thrust_filtered", "f8"),  # 0 … 1, collective with the lag of the rotors
        ("not_finite", "i8"),  # number of steps in which `cascade.fallback` replaced a result that was not finite
    ],
    align=True,
)


@dataclass(frozen=True, slots=True)
class GainField:
    """The place of a PX4 parameter in the CONTROL_PARAMS record."""

    field: str
    axes: tuple[int, ...] = ()  # elements of a vector field; empty for a scalar
    factor: float = 1.0  # from PX4's unit to the record's
    least: float = 0.0  # smallest allowed value, in PX4's unit
    most: float = math.inf  # largest allowed value, in PX4's unit
    default: float | None = None  # in PX4's unit; None: the airframe's design gives the value


_DEG = math.radians(1.0)

GAINS: dict[str, GainField] = {
    "MPC_XY_P": GainField("position_p", (0, 1), most=4.0),
    "MPC_Z_P": GainField("position_p", (2,), most=4.0),
    "MPC_XY_VEL_P_ACC": GainField("velocity_p", (0, 1), most=10.0),
    "MPC_XY_VEL_I_ACC": GainField("velocity_i", (0, 1), most=60.0),
    "MPC_XY_VEL_D_ACC": GainField("velocity_d", (0, 1), most=2.0),
    "MPC_Z_VEL_P_ACC": GainField("velocity_p", (2,), most=15.0),
    "MPC_Z_VEL_I_ACC": GainField("velocity_i", (2,), most=10.0),
    "MPC_Z_VEL_D_ACC": GainField("velocity_d", (2,), most=2.0),
    "MPC_XY_VEL_MAX": GainField("speed_max_horizontal", most=30.0, default=12.0),
    "MPC_Z_VEL_MAX_UP": GainField("speed_max_up", least=0.1, most=15.0, default=3.0),
    "MPC_Z_VEL_MAX_DN": GainField("speed_max_down", least=0.1, most=15.0, default=1.5),
    "MPC_ACC_HOR": GainField("acceleration_horizontal", least=0.5, most=15.0, default=3.0),
    "MPC_ACC_HOR_MAX": GainField("acceleration_horizontal_max", least=0.5, most=15.0, default=5.0),
    "MPC_ACC_UP_MAX": GainField("acceleration_up", least=0.5, most=15.0, default=4.0),
    "MPC_ACC_DOWN_MAX": GainField("acceleration_down", least=0.5, most=15.0, default=3.0),
    "MPC_JERK_AUTO": GainField("jerk_position", least=1.0, most=80.0, default=8.0),
    "MPC_JERK_MAX": GainField("jerk_velocity", least=0.5, most=500.0, default=40.0),
    "MPC_TILTMAX_AIR": GainField("tilt_max", factor=_DEG, least=5.0, most=80.0, default=45.0),
    "MPC_THR_MIN": GainField("thrust_min", most=0.5),
    "MPC_THR_MAX": GainField("thrust_max", least=0.1, most=1.0, default=1.0),
    "MPC_THR_XY_MARG": GainField("thrust_horizontal_margin", most=0.5, default=0.3),
    "MPC_THR_HOVER": GainField("hover_thrust", least=0.05, most=0.9),
    "MPC_YAWRAUTO_MAX": GainField("yaw_rate_auto_max", factor=_DEG, least=5.0, most=360.0, default=60.0),
    "MC_ROLL_P": GainField("attitude_p", (0,), most=12.0),
    "MC_PITCH_P": GainField("attitude_p", (1,), most=12.0),
    "MC_YAW_P": GainField("attitude_p", (2,), most=5.0),
    "MC_YAW_WEIGHT": GainField("yaw_weight", least=0.05, most=1.0, default=0.4),
    "MC_ROLLRATE_MAX": GainField("rate_max", (0,), factor=_DEG, most=1800.0, default=220.0),
    "MC_PITCHRATE_MAX": GainField("rate_max", (1,), factor=_DEG, most=1800.0, default=220.0),
    "MC_YAWRATE_MAX": GainField("rate_max", (2,), factor=_DEG, most=1800.0, default=200.0),
    "MC_ROLLRATE_P": GainField("rate_p", (0,), most=2.0),
    "MC_ROLLRATE_I": GainField("rate_i", (0,), most=20.0),
    "MC_ROLLRATE_D": GainField("rate_d", (0,), most=0.1),
    "MC_PITCHRATE_P": GainField("rate_p", (1,), most=2.0),
    "MC_PITCHRATE_I": GainField("rate_i", (1,), most=20.0),
    "MC_PITCHRATE_D": GainField("rate_d", (1,), most=0.1),
    "MC_YAWRATE_P": GainField("rate_p", (2,), most=5.0),
    "MC_YAWRATE_I": GainField("rate_i", (2,), most=20.0),
    "MC_YAWRATE_D": GainField("rate_d", (2,), most=0.1),
    "MC_RR_INT_LIM": GainField("rate_integral_limit", (0,), most=1.0, default=0.3),
    "MC_PR_INT_LIM": GainField("rate_integral_limit", (1,), most=1.0, default=0.3),
    "MC_YR_INT_LIM": GainField("rate_integral_limit", (2,), most=1.0, default=0.3),
    "IMU_GYRO_CUTOFF": GainField("gyro_cutoff_hz", least=5.0, most=1000.0),
    "IMU_DGYRO_CUTOFF": GainField("gyro_derivative_cutoff_hz", least=5.0, most=1000.0),
    "MC_AIRMODE": GainField("airmode", most=1.0),
}


def default_parameters(gains: Gains, allocation: Allocation, rotors: int) -> np.void:
    """Return one CONTROL_PARAMS record: gains from the design, and mostly PX4's default limits.

    Four limits differ from PX4 1.15. MPC_JERK_MAX is 40 instead of 8 m/s³, because PX4 does not smooth offboard
    velocity setpoints: it reaches 1.4 m/s half a second after a setpoint of 2 m/s. MPC_JERK_AUTO is 8 instead of
    4 m/s³. MPC_YAWRAUTO_MAX is 60 °/s, the rate of the agent's turns. MPC_THR_MIN is at most 0.4 of the hover thrust.
    """
    params: np.void = np.zeros(1, CONTROL_PARAMS)[0]
    for name, gain in GAINS.items():
        if gain.default is not None:
            write(params, name, gain.default)
    for name in (
        "attitude_p", "velocity_p", "velocity_i", "velocity_d", "position_p", "velocity_lag", "yaw_lag",
        "gyro_cutoff_hz", "gyro_derivative_cutoff_hz", "hover_thrust", "rotor_thrust_min",
    ):  # fmt: skip
        params[name] = getattr(gains, name)
    for name in ("rate_p", "rate_i", "rate_d"):  # from rad/s² to normalised torque
        params[name] = np.array(getattr(gains, name)) / np.array(gains.acceleration_max)
    params["torque_acceleration"] = gains.acceleration_max
    params["rotors"] = rotors
    params["mix"] = allocation.mix
    params["thrust_min"] = min(0.12, 0.4 * gains.hover_thrust)
    return params


def read(params: np.void, name: str) -> float:
    """Return the value of a PX4 parameter in PX4's unit. Raises UsageError for an unknown parameter."""
    gain = _gain(name)
    value = params[gain.field]
    return float(value[gain.axes[0]] if gain.axes else value) / gain.factor


def write(params: np.void, name: str, value: float) -> float:
    """Set a PX4 parameter to `value` (PX4's unit), limited to the parameter's range; return the limited value.

    Raises UsageError for an unknown parameter, or for a value that is not finite.
    """
    gain = _gain(name)
    if not math.isfinite(value):
        raise UsageError(f"parameter {name} cannot be {value}: give a finite number")
    bounded = min(max(value, gain.least), gain.most)
    if gain.axes:
        for axis in gain.axes:
            params[gain.field][axis] = bounded * gain.factor
    else:
        params[gain.field] = bounded * gain.factor
    return bounded


def _gain(name: str) -> GainField:
    try:
        return GAINS[name]
    except KeyError:
        raise UsageError(f"parameter {name} is not a parameter of the control cascade") from None
