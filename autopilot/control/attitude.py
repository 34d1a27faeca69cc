"""Attitude P and rate PID: from an attitude to body rates, and from those to a normalised torque.

The attitude loop brings the thrust axis home first and the heading second (reduced attitude control), after
Brescianini, Hehn, D'Andrea 2013, "Nonlinear quadrocopter attitude control". The derivative of the rate loop is on the
filtered measurement.
"""

import math

from autopilot.compiled_frames import quat_conjugate, quat_multiply, rotate, rotate_inverse
from foundation.compiled import Grid, Record, njit
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


RATE_PLAUSIBLE = 1000.0  # rad/s, beyond any gyro's range: the sample is nonsense and the filters start anew


@njit(cache=True)
def filter_rates(params: Record, state: Record, rates: Grid, dt: float) -> None:
    """Low-pass the measured rates and their derivative (IMU_GYRO_CUTOFF, IMU_DGYRO_CUTOFF)."""
    first = dt * 2.0 * math.pi * params.gyro_cutoff_hz
    first = first / (1.0 + first)
    second = dt * 2.0 * math.pi * params.gyro_derivative_cutoff_hz
    second = second / (1.0 + second)
    for i in range(3):
        before = state.rates_filtered[i]
        now = before + first * (rates[i] - before)
        if not abs(now) < RATE_PLAUSIBLE:
            before, now = 0.0, 0.0
            state.rates_derivative[i] = 0.0
        state.rates_filtered[i] = now
        state.rates_derivative[i] += second * ((now - before) / dt - state.rates_derivative[i])


@njit(cache=True)
def torque(params: Record, state: Record, dt: float, idle: bool) -> Vec3:
    """Return the normalised torque (roll, pitch, yaw), each in [-1, 1].

    `state.torque_scale`, what the mixer achieved last time, stops an integral that would only push on a full actuator;
    `idle` (on the ground) empties the integrals.
    """
    out = (0.0, 0.0, 0.0)
    x, y, z = out
    for i in range(3):
        error = state.rates_setpoint[i] - state.rates_filtered[i]
        total = params.rate_p[i] * error + state.rate_integral[i] - params.rate_d[i] * state.rates_derivative[i]
        bounded = min(max(total, -1.0), 1.0)
        full = bounded != total or state.torque_scale[i] < 0.999
        if idle:
            state.rate_integral[i] = 0.0
        elif not (full and error * total > 0.0):
            limit = params.rate_integral_limit[i]
            grown = state.rate_integral[i] + params.rate_i[i] * error * dt
            state.rate_integral[i] = min(max(grown, -limit), limit)
        if i == 0:
            x = bounded
        elif i == 1:
            y = bounded
        else:
            z = bounded
    return x, y, z
