"""Alignment, the initial attitude: tilt from gravity, yaw from the magnetic field, gyro bias at rest."""

import math

from autopilot.estimator.covariance import initialise, trust_compass
from autopilot.estimator.records import STATUS_RUNNING
from autopilot.records import quat_from_euler, rotate
from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Quat

REST_GYRO_STD = 0.05  # rad/s; a larger deviation from the mean is more than noise: the vehicle is being moved
REST_ACCEL_ERROR = 0.5  # m/s²; at rest, the mean specific force differs by less than this from gravity
ATTEMPTS = 5  # after this many windows in which the vehicle moved, the next window aligns anyway, with larger variances


@njit(cache=True)
def clear(state: Record, time_us: int) -> None:
    """Begin a new window of averages at time_us."""
    state.align_since_us = time_us
    state.align_count = 0
    state.align_mag_count = 0
    state.align_baro_count = 0
    state.align_gyro_squared = 0.0
    state.align_baro = 0.0
    for i in range(3):
        state.align_accel[i] = 0.0
        state.align_gyro[i] = 0.0
        state.align_mag[i] = 0.0


@njit(cache=True)
def collect_imu(state: Record, accel: Grid, gyro: Grid) -> None:
    """Add one inertial sample (m/s² and rad/s, FRD) to the window."""
    state.align_count += 1
    for i in range(3):
        state.align_accel[i] += accel[i]
        state.align_gyro[i] += gyro[i]
    state.align_gyro_squared += gyro[0] * gyro[0] + gyro[1] * gyro[1] + gyro[2] * gyro[2]


@njit(cache=True)
def level(ax: float, ay: float, az: float, mx: float, my: float, mz: float, declination: float) -> Quat:
    """Return the attitude (FRD → NED) from the specific force a and the magnetic field m, both FRD.

    The down axis is opposite to the specific force. The field points to magnetic north, which is `declination` (rad)
    east of true north.
    """
    roll = math.atan2(-ay, -az)
    pitch = math.atan2(ax, math.sqrt(ay * ay + az * az))
    field = rotate(quat_from_euler(roll, pitch, 0.0), (mx, my, mz))
    return quat_from_euler(roll, pitch, declination - math.atan2(field[1], field[0]))


@njit(cache=True)
def align(params: Record, state: Record, P: Grid, time_us: int) -> None:
    """At a window's end, start the filter if the vehicle was at rest (see ATTEMPTS), else begin a new window."""
    if time_us - state.align_since_us < params.align_us:
        return
    enough = state.align_count >= 50 and state.align_mag_count >= 5 and state.align_baro_count >= 5
    if not enough:
        if time_us - state.align_since_us > 10 * params.align_us:
            clear(state, time_us)
        return
    n = state.align_count
    ax, ay, az = state.align_accel[0] / n, state.align_accel[1] / n, state.align_accel[2] / n
    gx, gy, gz = state.align_gyro[0] / n, state.align_gyro[1] / n, state.align_gyro[2] / n
    spread = state.align_gyro_squared / n - (gx * gx + gy * gy + gz * gz)
    error = abs(math.sqrt(ax * ax + ay * ay + az * az) - GRAVITY)
    bias = math.sqrt(gx * gx + gy * gy + gz * gz)
    resting = spread < 3.0 * REST_GYRO_STD**2 and error < REST_ACCEL_ERROR and bias < 0.2
    if not resting and state.align_attempts < ATTEMPTS:
        state.align_attempts += 1
        clear(state, time_us)
        return
    m = state.align_mag_count
    q = level(ax, ay, az, state.align_mag[0] / m, state.align_mag[1] / m, state.align_mag[2] / m, params.declination)
    for i in range(4):
        state.attitude[i] = q[i]
    for i in range(3):
        state.velocity[i] = 0.0
        state.position[i] = 0.0
        state.gyro_bias[i] = state.align_gyro[i] / n if resting else 0.0
        state.accel_bias[i] = 0.0
        state.impulse[i] = 0.0
    state.impulse_dt = 0.0
    state.mag_bias[0] = state.mag_bias[1] = 0.0
    state.history_count = 0
    height = state.align_baro / state.align_baro_count
    if state.origin_set == 0:
        state.baro_reference_m = height
    else:  # a restart in flight keeps the local frame
        state.position[2] = state.baro_reference_m - height
    if resting:
        initialise(P, 0.02, 0.05, 0.003)
    else:
        initialise(P, 0.2, 0.2, 0.05)
    north, east, _ = rotate(q, (state.align_mag[0] / m, state.align_mag[1] / m, state.align_mag[2] / m))
    trust_compass(P, state, math.sqrt(north * north + east * east), params.declination, params.mag_bias_std)
    state.status = STATUS_RUNNING
    state.baro_fused_us = time_us
    state.mag_fused_us = time_us
    state.align_attempts = 0
