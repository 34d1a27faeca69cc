"""How a velocity setpoint turns into one that a vehicle can follow: bounded acceleration and jerk."""

import math

from foundation.compiled import Record, njit

RESPONSE = 5.0  # 1/s, how fast the last metre per second is closed; well above the velocity loop's own bandwidth


@njit(cache=True)
def braking_speed(distance: float, gain: float, acceleration: float) -> float:
    """Return the speed (m/s) towards a point `distance` (m) away: gain · distance close by, and further out no more
    than what constant braking at `acceleration` (m/s²) can still stop."""
    linear = acceleration / (gain * gain)
    if distance <= linear:
        return gain * distance
    return math.sqrt(2.0 * acceleration * (distance - 0.5 * linear))


@njit(cache=True)
def wanted_acceleration(gap: float, limit: float, jerk: float) -> float:
    """Return the acceleration (m/s²) with which to close a velocity gap (m/s, ≥ 0) so that it can fade in time."""
    return min(limit, min(RESPONSE * gap, math.sqrt(2.0 * jerk * gap)))


@njit(cache=True)
def slew_horizontal(state: Record, north: float, east: float, limit: float, jerk: float, dt: float) -> None:
    """Move the horizontal velocity reference towards (north, east) within `limit` (m/s²) and `jerk` (m/s³)."""
    v, a = state.velocity_reference, state.acceleration_reference
    gap_n, gap_e = north - v[0], east - v[1]
    gap = math.sqrt(gap_n * gap_n + gap_e * gap_e)
    scale = wanted_acceleration(gap, limit, jerk) / gap if gap > 1e-9 else 0.0
    step_n, step_e = gap_n * scale - a[0], gap_e * scale - a[1]
    step = math.sqrt(step_n * step_n + step_e * step_e)
    if step > jerk * dt:
        step_n *= jerk * dt / step
        step_e *= jerk * dt / step
    a[0] += step_n
    a[1] += step_e
    v[0] += a[0] * dt
    v[1] += a[1] * dt


@njit(cache=True)
def slew_vertical(state: Record, down: float, limit_up: float, limit_down: float, jerk: float, dt: float) -> None:
    """Move the vertical velocity reference towards `down` (m/s, NED)."""
    v, a = state.velocity_reference, state.acceleration_reference
    gap = down - v[2]
    limit = limit_down if gap > 0.0 else limit_up
    target = math.copysign(wanted_acceleration(abs(gap), limit, jerk), gap)
    a[2] += min(max(target - a[2], -jerk * dt), jerk * dt)
    v[2] += a[2] * dt


@njit(cache=True)
def expect(params: Record, state: Record, dt: float) -> None:
    """Advance the velocity that a vehicle following the reference's acceleration with its lag has by now.

    The velocity error is taken against it: the feedback then corrects disturbances only and not the lag, which would
    make it overshoot.
    """
    for i in range(3):
        share = dt / (params.velocity_lag[i] + dt)
        a, v = state.acceleration_expected, state.velocity_expected
        a[i] += share * (state.acceleration_reference[i] - a[i])
        # leaking into the reference, so that rounding and clipped steps do not remain
        v[i] += (a[i] + 0.5 * (state.velocity_reference[i] - params.velocity_lag[i] * a[i] - v[i])) * dt
