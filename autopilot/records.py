"""Records that the compiled inner loop and the commander exchange, the setpoint as a tuple, and compiled conversions.

The inner loop writes ESTIMATE 1000 times per simulated second; the commander reads it at its own rate and writes
SETPOINT. As in PX4's TrajectorySetpoint, NaN in a setpoint field means "not controlled". The conversions are compiled
versions of those in `foundation.frames`.
"""

import math
from typing import NamedTuple

import numpy as np

from foundation import atmosphere, frames
from foundation.compiled import njit
from foundation.frames import Quat, Vec3

# SETPOINT.kind: the loop of the cascade that gets the setpoint
KIND_IDLE = 0  # rotors stopped (disarmed) or idling (armed)
KIND_TRAJECTORY = 1  # position, velocity, acceleration, yaw, yaw rate; NaN = not controlled
KIND_ATTITUDE = 2  # attitude, yaw rate and collective thrust
KIND_RATES = 3  # body rates and collective thrust

SETPOINT = np.dtype(
    [
        ("kind", "i8"),
        ("armed", "i8"),
        ("position_ned", "f8", (3,)),  # m, local frame
        ("velocity_ned", "f8", (3,)),  # m/s, feed-forward on an axis with a position setpoint
        ("acceleration_ned", "f8", (3,)),  # m/s², feed-forward
        ("yaw", "f8"),  # rad
        ("yaw_rate", "f8"),  # rad/s
        ("attitude", "f8", (4,)),  # (w, x, y, z), FRD → NED
        ("rates_frd", "f8", (3,)),  # rad/s
        ("thrust", "f8"),  # 0 … 1, collective thrust as a fraction of all rotors at full speed
        ("speed_limit_up", "f8"),  # m/s; the active flight mode sets this limit and the next two
        ("speed_limit_down", "f8"),  # m/s
        ("speed_limit_horizontal", "f8"),  # m/s
        ("thrust_limit", "f8"),  # 0 … 1, upper limit of the collective thrust; below 1 during the take-off ramp
    ],
    align=True,
)

# index of a quantity in `innovation` and `test_ratio`
VELOCITY_TEST = 0  # 0 to 2: velocity of a fix, NED
POSITION_TEST = 3  # 3 and 4: position of a fix, north and east
HEIGHT_TEST = 5  # barometer, down
HEADING_TEST = 6  # magnetometer
TESTS = 7

ESTIMATE = np.dtype(
    [
        ("time_us", "i8"),  # µs, vehicle clock
        ("attitude", "f8", (4,)),  # (w, x, y, z), FRD → NED
        ("rates_frd", "f8", (3,)),  # rad/s, bias removed
        ("accel_frd", "f8", (3,)),  # m/s², specific force, bias removed
        ("velocity_ned", "f8", (3,)),  # m/s
        ("position_ned", "f8", (3,)),  # m, local frame; its origin is the 10th good fix in a row
        ("gyro_bias", "f8", (3,)),  # rad/s
        ("accel_bias", "f8", (3,)),  # m/s²
        ("origin_lat_deg", "f8"),  # local frame's origin
        ("origin_lon_deg", "f8"),
        ("origin_alt_m", "f8"),  # m above mean sea level
        ("origin_set", "i8"),  # bool
        ("attitude_valid", "i8"),  # bool: tilt and yaw aligned
        ("velocity_valid", "i8"),  # bool
        ("position_valid", "i8"),  # bool: horizontal
        ("altitude_valid", "i8"),  # bool
        ("position_std_h", "f8"),  # m, σ (h: horizontal)
        ("position_std_v", "f8"),  # m, σ (v: vertical)
        ("velocity_std_h", "f8"),  # m/s
        ("velocity_std_v", "f8"),  # m/s
        ("tilt_std", "f8"),  # rad
        ("yaw_std", "f8"),  # rad
        ("innovation", "f8", (TESTS,)),  # m/s, m and rad: newest sample of each kind minus its expected value
        ("innovation_variance", "f8", (TESTS,)),
        ("test_ratio", "f8", (TESTS,)),  # innovation² / (gate² · variance); > 1: sample not used
        ("attitude_setpoint", "f8", (4,)),  # setpoint of the attitude loop, sent as ATTITUDE_TARGET
        ("rates_setpoint", "f8", (3,)),  # rad/s
        ("thrust_setpoint", "f8"),  # 0 … 1
        ("hover_thrust", "f8"),  # 0 … 1
        ("resets", "i8"),  # number of resets of a quantity and restarts of the filter since boot
        ("vibration_accel", "f8"),  # m/s², smoothed change of accel_frd in 20 ms, as in PX4
        ("vibration_gyro", "f8"),  # rad/s, smoothed change of rates_frd in 20 ms
        ("clipped", "i8", (3,)),  # number of 20 ms checks with this axis of accel_frd at full scale
    ],
    align=True,
)


NAN = math.nan
FREE: Vec3 = (NAN, NAN, NAN)  # not controlled


class CascadeSetpoint(NamedTuple):
    """The setpoint of the cascade; fields, units and frames as in `autopilot.records.SETPOINT`."""

    kind: int = KIND_TRAJECTORY
    position_ned: Vec3 = FREE
    velocity_ned: Vec3 = FREE
    acceleration_ned: Vec3 = FREE
    yaw: float = NAN
    yaw_rate: float = NAN
    attitude: Quat = (1.0, 0.0, 0.0, 0.0)
    rates_frd: Vec3 = (0.0, 0.0, 0.0)
    thrust: float = 0.0
    speed_limit_up: float = 3.0
    speed_limit_down: float = 1.5
    speed_limit_horizontal: float = 12.0
    thrust_limit: float = 1.0


IDLE = CascadeSetpoint(kind=KIND_IDLE)


rotate = njit(cache=True)(frames.rotate)
rotate_inverse = njit(cache=True)(frames.rotate_inverse)
quat_multiply = njit(cache=True)(frames.quat_multiply)
quat_conjugate = njit(cache=True)(frames.quat_conjugate)
quat_normalized = njit(cache=True)(frames.quat_normalized)
quat_from_euler = njit(cache=True)(frames.quat_from_euler)
quat_yaw = njit(cache=True)(frames.quat_yaw)
wrap_pi = njit(cache=True)(frames.wrap_pi)
geodetic_to_ned = njit(cache=True)(frames.geodetic_to_ned)
pressure_altitude = njit(cache=True)(atmosphere.pressure_altitude)


@njit(cache=True)
def quat_advance(q: Quat, x: float, y: float, z: float) -> Quat:
    """Return q ⊗ exp((x, y, z)/2): q after a small body-frame rotation vector (rad).

    It uses third-order series instead of sin and cos, and one Newton step instead of a square root. It is exact to 1e-9
    for 0.05 rad, which a fast multirotor turns in one millisecond.
    """
    h = 0.25 * (x * x + y * y + z * z)
    s = 0.5 - h / 12.0
    c = 1.0 - 0.5 * h
    dx, dy, dz = s * x, s * y, s * z
    w = q[0] * c - q[1] * dx - q[2] * dy - q[3] * dz
    i = q[0] * dx + q[1] * c + q[2] * dz - q[3] * dy
    j = q[0] * dy - q[1] * dz + q[2] * c + q[3] * dx
    k = q[0] * dz + q[1] * dy - q[2] * dx + q[3] * c
    n = 1.5 - 0.5 * (w * w + i * i + j * j + k * k)
    return (w * n, i * n, j * n, k * n)
