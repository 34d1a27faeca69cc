"""Covariance algebra of the error-state filter, written out by element so that zeros are not computed.

The attitude error is a rotation vector in NED: q_true = exp(δθ) ⊗ q. With the specific force f in NED, the rotation R
from FRD to NED, the gyro bias bg and the accelerometer bias ba, the errors change by (Solà 2017, "Quaternion kinematics
for the error-state Kalman filter", section 7)

    δθ' = -R δbg        δv' = -[f]× δθ - R δba        δp' = δv

So the transition matrix F = I + A dt differs from I in only nine rows, each with at most five entries besides the
diagonal. The hard iron (magnetometer offset) has no effect on the motion. The filter can distinguish it from a
heading error when the vehicle turns.
"""

import math

from autopilot.estimator.records import MOTION, STATES
from autopilot.records import quat_multiply, quat_normalized
from foundation.compiled import Grid, Record, njit


@njit(cache=True)
def propagate(params: Record, P: Grid, q: Grid, impulse: Grid, dt: float) -> None:
    """Replace P by F P Fᵀ + Q over dt seconds; `impulse` (3,) is ∫ specific force (NED) over that time, m/s."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    r00, r01, r02 = dt * (1 - 2 * (y * y + z * z)), dt * 2 * (x * y - w * z), dt * 2 * (x * z + w * y)
    r10, r11, r12 = dt * 2 * (x * y + w * z), dt * (1 - 2 * (x * x + z * z)), dt * 2 * (y * z - w * x)
    r20, r21, r22 = dt * 2 * (x * z - w * y), dt * 2 * (y * z + w * x), dt * (1 - 2 * (x * x + y * y))
    fx, fy, fz = impulse[0], impulse[1], impulse[2]
    for j in range(STATES):  # F P: rows; position first, because it needs the old velocity row
        P[6, j] += dt * P[3, j]
        P[7, j] += dt * P[4, j]
        P[8, j] += dt * P[5, j]
        tx, ty, tz = P[0, j], P[1, j], P[2, j]
        ax, ay, az = P[12, j], P[13, j], P[14, j]
        P[3, j] -= fy * tz - fz * ty + r00 * ax + r01 * ay + r02 * az
        P[4, j] -= fz * tx - fx * tz + r10 * ax + r11 * ay + r12 * az
        P[5, j] -= fx * ty - fy * tx + r20 * ax + r21 * ay + r22 * az
        gx, gy, gz = P[9, j], P[10, j], P[11, j]
        P[0, j] = tx - (r00 * gx + r01 * gy + r02 * gz)
        P[1, j] = ty - (r10 * gx + r11 * gy + r12 * gz)
        P[2, j] = tz - (r20 * gx + r21 * gy + r22 * gz)
    for i in range(STATES):  # (F P) Fᵀ: columns
        P[i, 6] += dt * P[i, 3]
        P[i, 7] += dt * P[i, 4]
        P[i, 8] += dt * P[i, 5]
        tx, ty, tz = P[i, 0], P[i, 1], P[i, 2]
        ax, ay, az = P[i, 12], P[i, 13], P[i, 14]
        P[i, 3] -= fy * tz - fz * ty + r00 * ax + r01 * ay + r02 * az
        P[i, 4] -= fz * tx - fx * tz + r10 * ax + r11 * ay + r12 * az
        P[i, 5] -= fx * ty - fy * tx + r20 * ax + r21 * ay + r22 * az
        gx, gy, gz = P[i, 9], P[i, 10], P[i, 11]
        P[i, 0] = tx - (r00 * gx + r01 * gy + r02 * gz)
        P[i, 1] = ty - (r10 * gx + r11 * gy + r12 * gz)
        P[i, 2] = tz - (r20 * gx + r21 * gy + r22 * gz)
    q_attitude = params.gyro_noise * params.gyro_noise * dt
    q_velocity = params.accel_noise * params.accel_noise * dt
    q_gyro = params.gyro_bias_walk * params.gyro_bias_walk * dt
    q_accel = params.accel_bias_walk * params.accel_bias_walk * dt
    for i in range(3):
        P[i, i] += q_attitude
        P[3 + i, 3 + i] += q_velocity
        P[9 + i, 9 + i] += q_gyro
        P[12 + i, 12 + i] += q_accel
    if params.mag_bias_std > 0.0:
        for i in range(MOTION, STATES):
            P[i, i] += params.mag_bias_walk * params.mag_bias_walk * dt


@njit(cache=True)
def symmetrize(P: Grid) -> None:
    """Replace P by (P + Pᵀ)/2 and keep variances above zero, so that rounding does not accumulate over hours."""
    for i in range(STATES):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean
        P[i, i] = max(P[i, i], 1e-12 if i < MOTION else 0.0)


@njit(cache=True)
def innovation_variance(
    P: Grid, work: Grid, i: int, hi: float, j: int, hj: float, k: int, hk: float, variance: float
) -> float:
    """Return H P Hᵀ + variance for the row H with entries hi, hj, hk at i, j, k; write P Hᵀ to `work`."""
    for n in range(STATES):
        work[n] = hi * P[i, n] + hj * P[j, n] + hk * P[k, n]
    seen: float = hi * work[i] + hj * work[j] + hk * work[k] + variance
    return seen


@njit(cache=True)
def apply(P: Grid, state: Record, innovation: float, innovation_var: float) -> None:
    """Fuse one scalar (`state.work` holds its P Hᵀ): correct the nominal state and reduce P."""
    work = state.work
    scale = 1.0 / innovation_var
    for i in range(STATES):
        gain = work[i] * scale
        for j in range(STATES):
            P[i, j] -= gain * work[j]
    step = innovation * scale
    q = state.attitude
    turn = (1.0, 0.5 * step * work[0], 0.5 * step * work[1], 0.5 * step * work[2])
    corrected = quat_normalized(quat_multiply(turn, (q[0], q[1], q[2], q[3])))
    for i in range(4):
        q[i] = corrected[i]
    for i in range(3):
        state.velocity[i] += step * work[3 + i]
        state.position[i] += step * work[6 + i]
        state.gyro_bias[i] += step * work[9 + i]
        state.accel_bias[i] += step * work[12 + i]
    for i in range(2):
        state.mag_bias[i] += step * work[MOTION + i]


@njit(cache=True)
def forget(P: Grid, first: int, count: int, variance: float) -> None:
    """Set `count` states, beginning at `first`, to the variance `variance` without any correlation."""
    for i in range(first, first + count):
        for j in range(STATES):
            P[i, j] = 0.0
            P[j, i] = 0.0
        P[i, i] = variance


@njit(cache=True)
def initialise(P: Grid, tilt_std: float, yaw_std: float, gyro_bias_std: float) -> None:
    """Set P for a vehicle whose attitude was just aligned. The arguments are standard deviations, rad and rad/s."""
    forget(P, 0, STATES, 0.0)
    for i in range(2):
        P[i, i] = tilt_std * tilt_std
    P[2, 2] = yaw_std * yaw_std
    for i in range(3):
        P[3 + i, 3 + i] = 0.25
        P[6 + i, 6 + i] = 1.0
        P[9 + i, 9 + i] = gyro_bias_std * gyro_bias_std
        P[12 + i, 12 + i] = 0.04  # (0.2 m/s²)², EKF2_ABIAS_INIT


@njit(cache=True)
def hard_iron_slopes(q: Grid, horizontal: float, declination: float) -> tuple[float, float]:
    """Return d(heading innovation)/d(hard iron) in rad/gauss for the forward and the right axis.

    `horizontal` (gauss) is the field's horizontal part. Hard iron b turns the measured heading by n · R b / horizontal.
    n is the horizontal unit vector to the left of magnetic north.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    s, c = math.sin(declination) / horizontal, math.cos(declination) / horizontal
    return (
        s * (1 - 2 * (y * y + z * z)) - c * 2 * (x * y + w * z),
        s * 2 * (x * y - w * z) - c * (1 - 2 * (x * x + z * z)),
    )


@njit(cache=True)
def trust_compass(P: Grid, state: Record, horizontal: float, declination: float, hard_iron: float) -> None:
    """For yaw from the compass: set the hard iron's standard deviation (`hard_iron`, gauss) and its effect on yaw."""
    forward, right = hard_iron_slopes(state.attitude, max(horizontal, 0.02), declination)
    variance = hard_iron * hard_iron
    for i, slope in ((MOTION, forward), (MOTION + 1, right)):
        forget(P, i, 1, variance)
        P[2, i] = -slope * variance
        P[i, 2] = -slope * variance
        P[2, 2] += slope * slope * variance


@njit(cache=True)
def deviation(variance: float) -> float:
    """Return √variance; 0 if rounding made the variance negative."""
    return math.sqrt(max(variance, 0.0))
