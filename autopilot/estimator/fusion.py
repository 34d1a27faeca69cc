"""Fusion of each sensor into the filter: magnetic heading, pressure altitude, delayed GNSS fixes, zero velocity.

Each function fuses scalars one after the other. The functions for sensors write to the state: innovations, their
variances and test ratios, and the time of the last accepted sample.
"""

import math

from autopilot.estimator.alignment import level
from autopilot.estimator.covariance import apply, forget, hard_iron_slopes, innovation_variance, symmetrize
from autopilot.estimator.records import HISTORY, MOTION, STATES
from autopilot.records import (
    HEADING_TEST,
    HEIGHT_TEST,
    POSITION_TEST,
    VELOCITY_TEST,
    geodetic_to_ned,
    pressure_altitude,
    rotate,
    wrap_pi,
)
from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Vec3

# µs. Fixes from before the last impact are used only if no fix was used for this time. So the filter still gets fixes
# while the vehicle scrapes along a wall, with one impact after another.
IMPACT_FIX_GAP_US = 1_000_000


@njit(cache=True)
def passes(state: Record, test: int, innovation: float, variance: float, gate: float) -> bool:
    """Store an innovation with its variance and test ratio; return whether it is within `gate` (σ)."""
    state.innovation[test] = innovation
    state.innovation_variance[test] = variance
    ratio = innovation * innovation / (gate * gate * variance)
    state.test_ratio[test] = ratio
    good: bool = ratio <= 1.0
    return good


@njit(cache=True)
def fuse_heading(
    params: Record, state: Record, P: Grid, mx: float, my: float, mz: float, time_us: int, landed: bool
) -> None:
    """Fuse the heading of the measured field (gauss, FRD).

    A rotation error δθ changes the field m = R m_body by δθ x m. So the heading ψ of m changes by
    δθz - (mz/mh)(cos ψ δθx + sin ψ δθy), where mh is the length of m's horizontal part. The unknown hard iron also
    changes ψ, by an amount that depends on the vehicle's heading.
    """
    q = state.attitude
    mx -= state.mag_bias[0]
    my -= state.mag_bias[1]
    field = rotate((q[0], q[1], q[2], q[3]), (mx, my, mz))
    horizontal = math.sqrt(field[0] * field[0] + field[1] * field[1])
    if horizontal < 0.02:  # gauss: no heading in a field that is vertical or absent
        return
    heading = math.atan2(field[1], field[0])
    innovation = wrap_pi(params.declination - heading)
    slope = -field[2] / horizontal
    noise = params.mag_noise / horizontal
    # The slopes are those at the expected direction. At the measured one they would have the noise of the innovation,
    # which would bias the tilt.
    north, east = slope * math.cos(params.declination), slope * math.sin(params.declination)
    forward, right = hard_iron_slopes(q, horizontal, params.declination)
    variance = innovation_variance(P, state.work, 0, north, 1, east, 2, 1.0, noise * noise)
    work = state.work
    variance += forward * work[MOTION] + right * work[MOTION + 1]
    for n in range(STATES):
        work[n] += forward * P[MOTION, n] + right * P[MOTION + 1, n]
    variance += forward * work[MOTION] + right * work[MOTION + 1]
    if passes(state, HEADING_TEST, innovation, variance, params.gate_mag):
        apply(P, state, innovation, variance)
        state.mag_fused_us = time_us
        return
    state.rejected += 1
    if landed and time_us - state.mag_fused_us > params.reset_after_us:
        # only on the ground: in the air the GNSS velocity also observes yaw
        realigned = level(
            -2.0 * (q[1] * q[3] - q[0] * q[2]),
            -2.0 * (q[2] * q[3] + q[0] * q[1]),
            -(1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])),
            mx, my, mz, params.declination,
        )  # fmt: skip
        for i in range(4):
            q[i] = realigned[i]
        forget(P, 2, 1, 0.01)
        state.mag_fused_us = time_us
        state.resets += 1


@njit(cache=True)
def fuse_height(params: Record, state: Record, P: Grid, pressure_hpa: float, time_us: int) -> None:
    """Fuse the pressure altitude above the reference as -z."""
    down = state.baro_reference_m - pressure_altitude(pressure_hpa)
    innovation = down - state.position[2]
    variance = innovation_variance(P, state.work, 8, 1.0, 8, 0.0, 8, 0.0, params.baro_noise**2)
    if passes(state, HEIGHT_TEST, innovation, variance, params.gate_baro):
        apply(P, state, innovation, variance)
        state.baro_fused_us = time_us
        return
    state.rejected += 1
    if time_us - state.baro_fused_us > params.reset_after_us:
        state.position[2] = down
        forget(P, 8, 1, params.baro_noise**2)
        state.baro_fused_us = time_us
        state.resets += 1


@njit(cache=True)
def fuse_stillness(state: Record, P: Grid, noise: float) -> None:
    """Fuse zero velocity with the standard deviation `noise` (m/s). Used while there are no fixes."""
    for axis in range(3):
        variance = innovation_variance(P, state.work, 3 + axis, 1.0, 3, 0.0, 3, 0.0, noise * noise)
        apply(P, state, -state.velocity[axis], variance)


@njit(cache=True)
def since_fix(state: Record, history: Grid, fix_us: int) -> tuple[float, Vec3, Vec3]:
    """Return the predicted motion from fix_us to now: (age s, Δvelocity (3), Δposition (3)), NED.

    For a fix older than `history`, the oldest entry is used. For a fix that is not in the past, all three are 0.
    """
    newest = state.time_us
    if fix_us >= newest or state.history_count == 0:
        return 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    later_us, later_index = newest, -1
    for back in range(1, state.history_count + 1):
        index = (state.history_index - back) % HISTORY
        if history[index, 0] <= fix_us:
            # linear interpolation between two entries, which are 4 ms apart
            w = (later_us - fix_us) / (later_us - history[index, 0])
            vx, vy, vz = history[index, 1], history[index, 2], history[index, 3]
            px, py, pz = history[index, 4], history[index, 5], history[index, 6]
            v, p = state.reckoned_velocity, state.reckoned_position
            if later_index < 0:
                ux, uy, uz, rx, ry, rz = v[0], v[1], v[2], p[0], p[1], p[2]
            else:
                ux, uy, uz = history[later_index, 1], history[later_index, 2], history[later_index, 3]
                rx, ry, rz = history[later_index, 4], history[later_index, 5], history[later_index, 6]
            return (
                (newest - fix_us) * 1e-6,
                (v[0] - ux + w * (ux - vx), v[1] - uy + w * (uy - vy), v[2] - uz + w * (uz - vz)),
                (p[0] - rx + w * (rx - px), p[1] - ry + w * (ry - py), p[2] - rz + w * (rz - pz)),
            )
        later_us, later_index = int(history[index, 0]), index
    v, p = state.reckoned_velocity, state.reckoned_position
    h = history[later_index]
    return (
        (newest - later_us) * 1e-6,
        (v[0] - h[1], v[1] - h[2], v[2] - h[3]),
        (p[0] - h[4], p[1] - h[5], p[2] - h[6]),
    )


@njit(cache=True)
def good_fix(params: Record, sensors: Record) -> bool:
    """Return whether the newest fix is three-dimensional, finite and as accurate as PX4 requires."""
    v = sensors.gps_velocity_ned
    return (
        sensors.gps_fix_type >= 3
        and 0.0 <= sensors.gps_eph_m < params.gps_eph_max
        and 0.0 <= sensors.gps_epv_m < params.gps_epv_max
        and 0.0 <= sensors.gps_speed_accuracy < params.gps_speed_accuracy_max
        and math.isfinite(sensors.gps_lat_deg + sensors.gps_lon_deg + sensors.gps_alt_m + v[0] + v[1] + v[2])
    )


@njit(cache=True)
def set_origin(params: Record, state: Record, P: Grid, history: Grid, sensors: Record) -> None:
    """Set the local frame's origin to this fix, with z = 0 at `baro_reference_m`; adopt the velocity of the fix."""
    state.origin_lat_deg = sensors.gps_lat_deg
    state.origin_lon_deg = sensors.gps_lon_deg
    _, dv, dp = since_fix(state, history, sensors.gps_time_us)
    state.origin_alt_m = sensors.gps_alt_m + state.position[2] - dp[2]
    v = sensors.gps_velocity_ned
    for i in range(3):
        state.velocity[i] = v[i] + dv[i]
    for i in range(2):
        state.position[i] = dp[i]
    forget(P, 3, 3, max(sensors.gps_speed_accuracy, params.gps_velocity_noise) ** 2)
    height_variance = P[8, 8]
    forget(P, 6, 3, max(sensors.gps_eph_m, params.gps_position_noise) ** 2)
    P[8, 8] = height_variance
    state.origin_set = 1
    state.position_fused_us = state.time_us
    state.velocity_fused_us = state.time_us


@njit(cache=True)
def fuse_fix(params: Record, state: Record, P: Grid, history: Grid, sensors: Record) -> None:
    """Fuse a fix with the state at the time of the fix.

    The expected fix is the present state minus the predicted motion during τ, the time since the fix. With
    δp(t - τ) = δp - τ δv and δv(t - τ) = δv + [∫f]× δθ the slopes are exact to first order. Only the process noise
    during τ is neglected.
    """
    if not good_fix(params, sensors):
        state.gps_good_fixes = 0
        return
    state.gps_good_fixes += 1
    if state.origin_set == 0:
        if state.gps_good_fixes >= params.gps_fixes_required:
            set_origin(params, state, P, history, sensors)
        return
    if state.gps_good_fixes < 3:  # after a gap, the first fixes are not used: the receiver must settle
        return
    time_us = state.time_us
    if sensors.gps_time_us <= state.shock_us and time_us - state.velocity_fused_us < IMPACT_FIX_GAP_US:
        return  # a fix from before an impact does not show the velocity after the impact
    age, dv, dp = since_fix(state, history, sensors.gps_time_us)
    local = geodetic_to_ned(
        state.origin_lat_deg, state.origin_lon_deg, state.origin_alt_m,
        sensors.gps_lat_deg, sensors.gps_lon_deg, sensors.gps_alt_m,
    )  # fmt: skip
    v, p = sensors.gps_velocity_ned, state.position
    symmetrize(P)

    speed_variance = max(sensors.gps_speed_accuracy, params.gps_velocity_noise) ** 2
    force = (dv[0], dv[1], dv[2] - GRAVITY * age)
    rejected = False
    for axis in range(3):
        if axis == 0:
            i, hi, j, hj = 2, force[1], 1, -force[2]
        elif axis == 1:
            i, hi, j, hj = 0, force[2], 2, -force[0]
        else:
            i, hi, j, hj = 1, force[0], 0, -force[1]
        innovation = v[axis] - (state.velocity[axis] - dv[axis])
        variance = innovation_variance(P, state.work, 3 + axis, 1.0, i, hi, j, hj, speed_variance)
        if passes(state, VELOCITY_TEST + axis, innovation, variance, params.gate_velocity):
            apply(P, state, innovation, variance)
        else:
            rejected = True
    if not rejected:
        state.velocity_fused_us = time_us
    elif time_us - state.velocity_fused_us > params.reset_after_us:
        for i in range(3):
            state.velocity[i] = v[i] + dv[i]
        forget(P, 3, 3, speed_variance)
        state.velocity_fused_us = time_us
        state.resets += 1

    place_variance = max(sensors.gps_eph_m, params.gps_position_noise) ** 2
    good = True
    for axis in range(2):
        innovation = local[axis] - (p[axis] - dp[axis])
        variance = innovation_variance(P, state.work, 6 + axis, 1.0, 3 + axis, -age, 0, 0.0, place_variance)
        good = passes(state, POSITION_TEST + axis, innovation, variance, params.gate_position) and good
    if good:
        # the position error of a receiver is the same for many fixes, so together they count as one fix
        shared_variance = place_variance * params.gps_fixes_alike
        for axis in range(2):
            innovation = local[axis] - (p[axis] - dp[axis])
            variance = innovation_variance(P, state.work, 6 + axis, 1.0, 3 + axis, -age, 0, 0.0, shared_variance)
            apply(P, state, innovation, variance)
        state.position_fused_us = time_us
    else:
        state.rejected += 1
        if time_us - state.position_fused_us > params.reset_after_us:
            height, height_variance = p[2], P[8, 8]
            for i in range(2):
                p[i] = local[i] + dp[i]
            forget(P, 6, 3, place_variance)
            p[2], P[8, 8] = height, height_variance
            state.position_fused_us = time_us
            state.resets += 1
