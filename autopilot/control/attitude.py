"""Attitude P: rates that bring the thrust axis home first and the heading second (reduced attitude control).

After Brescianini, Hehn, D'Andrea 2013, "Nonlinear quadrocopter attitude control".
"""

import math

from autopilot.compiled_frames import quat_conjugate, quat_multiply, rotate, rotate_inverse
from foundation.compiled import Record, njit
from foundation.frames import Quat, Vec3


@njit(cache=True)
def wanted_rates(params: Record, attitude: Quat, target: Quat, yaw_rate: float) -> Vec3:
    """Return the body rates (rad/s) from `attitude` towards `target`, both FRD → NED, yaw_rate (rad/s) added about NED
    down; each axis within its limit."""
    error = quat_multiply(quat_conjugate(attitude), target)
    axis = rotate(error, (0.0, 0.0, 1.0))  # where the body's down axis has to go, in the body frame
    half = math.sqrt(max(0.5 * (1.0 + axis[2]), 0.0))  # cosine of half the tilt to make good
    over = (0.0, 1.0, 0.0, 0.0)  # upside down: over the side
    tilt = (half, -axis[1] / (2.0 * half), axis[0] / (2.0 * half), 0.0) if half > 1e-3 else over
    twist = quat_multiply(quat_conjugate(tilt), error)
    turn = twist[3] if twist[0] >= 0.0 else -twist[3]
    turn = min(max(turn, -params.yaw_weight), params.yaw_weight)  # a large heading error must not starve roll and pitch
    ahead = rotate_inverse(attitude, (0.0, 0.0, yaw_rate))
    p = params.attitude_p
    x = 2.0 * p[0] * tilt[1] + ahead[0]
    y = 2.0 * p[1] * tilt[2] + ahead[1]
    z = 2.0 * p[2] * turn + ahead[2]
    top = params.rate_max
    return min(max(x, -top[0]), top[0]), min(max(y, -top[1]), top[1]), min(max(z, -top[2]), top[2])
