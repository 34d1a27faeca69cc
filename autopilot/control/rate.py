"""Rate PID with the derivative on the filtered measurement: body rates in, normalised torque out."""

import math

from foundation.compiled import Grid, Record, njit
from foundation.frames import Vec3

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
