"""The cascade's parameters under their PX4 names and in PX4's units."""

import math
from dataclasses import dataclass

import numpy as np

from autopilot.control.records import CONTROL_PARAMS
from autopilot.design import Gains
from autopilot.mixer import Allocation
from foundation.errors import UsageError


@dataclass(frozen=True, slots=True)
class Place:
    """Where a PX4 parameter lives in the CONTROL_PARAMS record."""

    field: str
    axes: tuple[int, ...] = ()  # elements of a vector field; empty for a scalar
    factor: float = 1.0  # from PX4's unit to the record's
    least: float = 0.0  # PX4's unit
    most: float = math.inf


_DEG = math.radians(1.0)

PLACES: dict[str, Place] = {
    "MPC_XY_P": Place("position_p", (0, 1), most=4.0),
    "MPC_Z_P": Place("position_p", (2,), most=4.0),
    "MPC_XY_VEL_P_ACC": Place("velocity_p", (0, 1), most=10.0),
    "MPC_XY_VEL_I_ACC": Place("velocity_i", (0, 1), most=60.0),
    "MPC_XY_VEL_D_ACC": Place("velocity_d", (0, 1), most=2.0),
    "MPC_Z_VEL_P_ACC": Place("velocity_p", (2,), most=15.0),
    "MPC_Z_VEL_I_ACC": Place("velocity_i", (2,), most=10.0),
    "MPC_Z_VEL_D_ACC": Place("velocity_d", (2,), most=2.0),
    "MPC_XY_VEL_MAX": Place("speed_max_horizontal", most=30.0),
    "MPC_Z_VEL_MAX_UP": Place("speed_max_up", least=0.1, most=15.0),
    "MPC_Z_VEL_MAX_DN": Place("speed_max_down", least=0.1, most=15.0),
    "MPC_ACC_HOR": Place("acceleration_horizontal", least=0.5, most=15.0),
    "MPC_ACC_HOR_MAX": Place("acceleration_horizontal_max", least=0.5, most=15.0),
    "MPC_ACC_UP_MAX": Place("acceleration_up", least=0.5, most=15.0),
    "MPC_ACC_DOWN_MAX": Place("acceleration_down", least=0.5, most=15.0),
    "MPC_JERK_AUTO": Place("jerk_position", least=1.0, most=80.0),
    "MPC_JERK_MAX": Place("jerk_velocity", least=0.5, most=500.0),
    "MPC_TILTMAX_AIR": Place("tilt_max", factor=_DEG, least=5.0, most=80.0),
    "MPC_THR_MIN": Place("thrust_min", most=0.5),
    "MPC_THR_MAX": Place("thrust_max", least=0.1, most=1.0),
    "MPC_THR_XY_MARG": Place("thrust_horizontal_margin", most=0.5),
    "MPC_THR_HOVER": Place("hover_thrust", least=0.05, most=0.9),
    "MPC_YAWRAUTO_MAX": Place("yaw_rate_auto_max", factor=_DEG, least=5.0, most=360.0),
    "MC_ROLL_P": Place("attitude_p", (0,), most=12.0),
    "MC_PITCH_P": Place("attitude_p", (1,), most=12.0),
    "MC_YAW_P": Place("attitude_p", (2,), most=5.0),
    "MC_YAW_WEIGHT": Place("yaw_weight", least=0.05, most=1.0),
    "MC_ROLLRATE_MAX": Place("rate_max", (0,), factor=_DEG, most=1800.0),
    "MC_PITCHRATE_MAX": Place("rate_max", (1,), factor=_DEG, most=1800.0),
    "MC_YAWRATE_MAX": Place("rate_max", (2,), factor=_DEG, most=1800.0),
    "MC_ROLLRATE_P": Place("rate_p", (0,), most=2.0),
    "MC_ROLLRATE_I": Place("rate_i", (0,), most=20.0),
    "MC_ROLLRATE_D": Place("rate_d", (0,), most=0.1),
    "MC_PITCHRATE_P": Place("rate_p", (1,), most=2.0),
    "MC_PITCHRATE_I": Place("rate_i", (1,), most=20.0),
    "MC_PITCHRATE_D": Place("rate_d", (1,), most=0.1),
    "MC_YAWRATE_P": Place("rate_p", (2,), most=5.0),
    "MC_YAWRATE_I": Place("rate_i", (2,), most=20.0),
    "MC_YAWRATE_D": Place("rate_d", (2,), most=0.1),
    "MC_RR_INT_LIM": Place("rate_integral_limit", (0,), most=1.0),
    "MC_PR_INT_LIM": Place("rate_integral_limit", (1,), most=1.0),
    "MC_YR_INT_LIM": Place("rate_integral_limit", (2,), most=1.0),
    "IMU_GYRO_CUTOFF": Place("gyro_cutoff_hz", least=5.0, most=1000.0),
    "IMU_DGYRO_CUTOFF": Place("gyro_derivative_cutoff_hz", least=5.0, most=1000.0),
    "MC_AIRMODE": Place("airmode", most=1.0),
}


def default_parameters(gains: Gains, allocation: Allocation, rotors: int) -> np.void:
    """Return one CONTROL_PARAMS record: gains from the design, limits as PX4's defaults where it has them.

    Two differ from PX4 1.15 on purpose. MPC_JERK_MAX is 40 instead of 8 m/s³, because a real PX4 does not smooth
    offboard velocity setpoints at all and reaches 1.4 of 2 m/s in half a second. MPC_YAWRAUTO_MAX is
    60 °/s, the rate at which the paper's rotation is flown.
    """
    params: np.void = np.zeros(1, CONTROL_PARAMS)[0]
    for name in ("attitude_p", "velocity_p", "velocity_i", "velocity_d", "position_p"):
        params[name] = getattr(gains, name)
    for name in ("rate_p", "rate_i", "rate_d"):  # to normalised torque
        params[name] = np.array(getattr(gains, name)) / np.array(gains.acceleration_max)
    params["velocity_lag"] = gains.velocity_lag
    params["yaw_lag"] = gains.yaw_lag
    params["gyro_cutoff_hz"] = gains.gyro_cutoff_hz
    params["gyro_derivative_cutoff_hz"] = gains.gyro_derivative_cutoff_hz
    params["hover_thrust"] = gains.hover_thrust
    params["rotor_thrust_min"] = gains.rotor_thrust_min
    params["rotors"] = rotors
    params["mix"] = allocation.mix
    params["speed_max_horizontal"] = 12.0
    params["speed_max_up"] = 3.0
    params["speed_max_down"] = 1.5
    params["acceleration_horizontal"] = 3.0
    params["acceleration_horizontal_max"] = 5.0
    params["acceleration_up"] = 4.0
    params["acceleration_down"] = 3.0
    params["jerk_position"] = 8.0
    params["jerk_velocity"] = 40.0
    params["tilt_max"] = math.radians(45.0)
    params["thrust_min"] = min(0.12, 0.4 * gains.hover_thrust)
    params["thrust_max"] = 1.0
    params["thrust_horizontal_margin"] = 0.3
    params["yaw_rate_auto_max"] = math.radians(60.0)
    params["yaw_weight"] = 0.4
    params["rate_max"] = (math.radians(220.0), math.radians(220.0), math.radians(200.0))
    params["rate_integral_limit"] = (0.3, 0.3, 0.3)
    return params


def read(params: np.void, name: str) -> float:
    """Return the value of a PX4 parameter in PX4's unit. Raises UsageError for one the cascade does not have."""
    place = _place(name)
    value = params[place.field]
    return float(value[place.axes[0]] if place.axes else value) / place.factor


def write(params: np.void, name: str, value: float) -> float:
    """Set a PX4 parameter, given in PX4's unit, and return the value that holds: bounded to its range.

    Raises UsageError for a parameter that the cascade does not have or a value that is not a number.
    """
    place = _place(name)
    if not math.isfinite(value):
        raise UsageError(f"parameter {name} cannot be {value}: give a finite number")
    bounded = min(max(value, place.least), place.most)
    if place.axes:
        for axis in place.axes:
            params[place.field][axis] = bounded * place.factor
    else:
        params[place.field] = bounded * place.factor
    return bounded


def _place(name: str) -> Place:
    try:
        return PLACES[name]
    except KeyError:
        raise UsageError(f"parameter {name} is not a parameter of the control cascade") from None
