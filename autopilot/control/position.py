"""Position P, velocity PID and heading: computes an acceleration and a yaw from a trajectory setpoint.

A velocity setpoint is first smoothed to the velocity reference, whose acceleration and jerk the vehicle can follow.
"""

import math

from autopilot.records import quat_yaw, wrap_pi
from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Vec3

RESPONSE = 5.0  # 1/s, rate at which the velocity reference nears the setpoint; above the velocity loop's bandwidth


@njit(cache=True)
def braking_speed(distance: float, gain: float, acceleration: float) -> float:
    """Return the speed (m/s) towards a point `distance` (m) away.

    It is gain · distance near the point. Farther away it is the speed from which the vehicle can still stop with
    `acceleration` (m/s²).
    """
    linear = acceleration / (gain * gain)
    if distance <= linear:
        return gain * distance
    return math.sqrt(2.0 * acceleration * (distance - 0.5 * linear))


@njit(cache=True)
def wanted_acceleration(gap: float, limit: float, jerk: float) -> float:
    """Return the acceleration (m/s²) that closes a velocity gap (m/s, ≥ 0), at most `limit`.

    With `jerk` (m/s³) it can return to 0 by the time at which the gap is closed.
    """
    return min(limit, min(RESPONSE * gap, math.sqrt(2.0 * jerk * gap)))


@njit(cache=True)
def slew_horizontal(state: Record, north: float, east: float, limit: float, jerk: float, dt: float) -> None:
    """Move the velocity reference towards a setpoint (north, east; m/s) within `limit` (m/s²) and `jerk` (m/s³)."""
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
    """Move the vertical velocity reference towards the setpoint `down` (m/s, NED)."""
    v, a = state.velocity_reference, state.acceleration_reference
    gap = down - v[2]
    limit = limit_down if gap > 0.0 else limit_up
    target = math.copysign(wanted_acceleration(abs(gap), limit, jerk), gap)
    a[2] += min(max(target - a[2], -jerk * dt), jerk * dt)
    v[2] += a[2] * dt


@njit(cache=True)
def expect(params: Record, state: Record, dt: float) -> None:
    """Advance the expected velocity: a vehicle without disturbances follows the reference with the lag `velocity_lag`.

    The feedback corrects only the difference from the expected velocity. If the feedback also corrected the lag, the
    velocity would overshoot.
    """
    for i in range(3):
        share = dt / (params.velocity_lag[i] + dt)
        a, v = state.acceleration_expected, state.velocity_expected
        a[i] += share * (state.acceleration_reference[i] - a[i])
        # the pull towards the reference removes errors of rounding and of clipped time steps
        v[i] += (a[i] + 0.5 * (state.velocity_reference[i] - params.velocity_lag[i] * a[i] - v[i])) * dt


YAW_LEAD_MAX = math.radians(30.0)  # rad; at a yaw rate setpoint, the yaw reference leads the yaw by at most this angle
YAW_GAIN = 3.0  # 1/s, yaw rate per yaw error near a yaw setpoint
YAW_ACCELERATION = 2.5  # rad/s²; yaw torque is weak, so a faster start would saturate the rotors
FOLLOWING_ERROR_MAX = 0.4  # m/s; with a smaller velocity error, the vehicle follows its setpoint
TRIM_S = 2.0  # s, time constant of `free_integral`, the smoothed integral without an obstacle
TEST_STEP = 0.8  # m/s²; after the integral has grown this much, the change of the velocity error is checked
ERROR_DROP = 0.05  # m/s; if the error drops less in the second half of TEST_STEP, an obstacle blocks the vehicle
BLOWN_BACK_SPEED, CREEP_SPEED = 0.3, 0.35  # m/s, against and along the push; a faster vehicle is not blocked
DESCENDS = 0.2  # m/s; a greater expected downward velocity is a descent
SIDEWAYS_SPEED = 0.3  # m/s; at a greater expected horizontal speed, an obstacle, not the ground, blocks a descent
INITIAL_PUSH_LIMIT, FIRST_S = 2.5, 2.0  # m/s², s: first limit of the P term against an obstacle, and its duration
LASTING_PUSH_LIMIT = 1.0  # m/s², the limit after that
BLOCKED_S = 3.0  # s of contact after which the integral may grow again, in case a gust was taken for an obstacle
FORGET_S = 0.5  # s, time constant of the decay of an integral that pushes against an obstacle
KNOCK = 8.0  # m/s²; a larger sudden unexplained acceleration is a knock; wind of 10 m/s: 3.3 (X500), 6.1 (30 g drone)
KNOCK_TORQUE = 0.15  # KNOCK for torque, as a fraction of full pitch torque; in the same wind 0.06 and 0.08
# s, time constants of the band-pass for knocks: above a gust's frequency, up to 10 Hz
KNOCK_S, GUST_S = 0.016, 0.3
TOUCHED_S = 1.0  # s after a knock, during which the vehicle is assumed to touch the obstacle
FELT_PLAUSIBLE = 10_000.0  # m/s², rad/s²; a larger value is an invalid measurement


@njit(cache=True)
def smaller_limit(own: float, mode: float) -> float:
    """Return the smaller of a parameter's and the mode's limit. The mode's limit counts only if finite and positive."""
    return min(own, mode) if math.isfinite(mode) and mode > 0.0 else own


@njit(cache=True)
def initialise_references(state: Record, estimate: Record) -> None:
    """Initialise the trajectory loops with the vehicle's present motion, so that a new mode starts without a jump."""
    for i in range(3):
        v = estimate.velocity_ned[i]
        state.velocity_reference[i] = v if math.isfinite(v) else 0.0
        state.velocity_expected[i] = state.velocity_reference[i]
        state.acceleration_reference[i] = 0.0
        state.acceleration_expected[i] = 0.0
        state.acceleration_filtered[i] = 0.0
        state.velocity_integral[i] = 0.0
        state.free_integral[i] = 0.0
    state.blocked_s = 0.0
    q = estimate.attitude
    state.yaw_reference = quat_yaw((q[0], q[1], q[2], q[3]))
    state.yaw_rate_reference = 0.0
    state.yaw_rate_expected = 0.0


@njit(cache=True)
def slew_yaw_rate(params: Record, state: Record, rate: float, dt: float) -> float:
    """Move the yaw rate reference towards `rate` (rad/s) within YAW_ACCELERATION; return the expected yaw rate."""
    step = min(max(rate - state.yaw_rate_reference, -YAW_ACCELERATION * dt), YAW_ACCELERATION * dt)
    state.yaw_rate_reference += step
    state.yaw_rate_expected += dt / (params.yaw_lag + dt) * (state.yaw_rate_reference - state.yaw_rate_expected)
    expected: float = state.yaw_rate_expected
    return expected


@njit(cache=True)
def update_yaw_reference(params: Record, state: Record, setpoint: Record, yaw: float, dt: float) -> None:
    """Advance the yaw reference: turn to the yaw setpoint, turn at the yaw rate setpoint, or keep the heading."""
    if math.isfinite(setpoint.yaw):
        gap = wrap_pi(setpoint.yaw - state.yaw_reference)
        limit = params.yaw_rate_auto_max
        rate = math.copysign(min(braking_speed(abs(gap), YAW_GAIN, 0.6 * YAW_ACCELERATION), limit), gap)
        rate = slew_yaw_rate(params, state, rate, dt)
        state.yaw_reference = wrap_pi(state.yaw_reference + rate * dt)
    else:
        limit = params.rate_max[2]
        rate = min(max(setpoint.yaw_rate, -limit), limit) if math.isfinite(setpoint.yaw_rate) else 0.0
        rate = slew_yaw_rate(params, state, rate, dt)
        lead = wrap_pi(state.yaw_reference + rate * dt - yaw)
        state.yaw_reference = wrap_pi(yaw + min(max(lead, -YAW_LEAD_MAX), YAW_LEAD_MAX))


@njit(cache=True)
def update_velocity_reference(
    params: Record, state: Record, setpoint: Record, estimate: Record, dt: float
) -> tuple[bool, bool]:
    """Advance the velocity reference towards the position and velocity setpoints.

    An axis with only an acceleration setpoint has no velocity feedback. Any other axis without a position or velocity
    setpoint stops. Returns which axes have velocity feedback: (horizontal, vertical).
    """
    p, v = setpoint.position_ned, setpoint.velocity_ned
    here = estimate.position_ned
    horizontal_max = smaller_limit(params.speed_max_horizontal, setpoint.speed_limit_horizontal)
    up_max = smaller_limit(params.speed_max_up, setpoint.speed_limit_up)
    down_max = smaller_limit(params.speed_max_down, setpoint.speed_limit_down)

    to_position = math.isfinite(p[0]) and math.isfinite(p[1]) and estimate.position_valid != 0
    north = v[0] if math.isfinite(v[0]) else 0.0
    east = v[1] if math.isfinite(v[1]) else 0.0
    limit, jerk = params.acceleration_horizontal_max, params.jerk_velocity
    if to_position:
        gap_n, gap_e = p[0] - here[0], p[1] - here[1]
        gap = math.sqrt(gap_n * gap_n + gap_e * gap_e)
        if gap > 1e-6:
            # 0.7 leaves a part of the acceleration limit for the feed-forward
            speed = min(braking_speed(gap, params.position_p[0], 0.7 * params.acceleration_horizontal), horizontal_max)
            north += gap_n / gap * speed
            east += gap_e / gap * speed
        if not (math.isfinite(v[0]) or math.isfinite(v[1])):
            limit, jerk = params.acceleration_horizontal, params.jerk_position
    speed = math.sqrt(north * north + east * east)
    if speed > horizontal_max:
        north *= horizontal_max / speed
        east *= horizontal_max / speed
    slew_horizontal(state, north, east, limit, jerk, dt)

    down = v[2] if math.isfinite(v[2]) else 0.0
    vertical_jerk = params.jerk_velocity
    if math.isfinite(p[2]):
        gap = p[2] - here[2]
        braking = params.acceleration_up if gap > 0.0 else params.acceleration_down
        down += math.copysign(braking_speed(abs(gap), params.position_p[2], 0.7 * braking), gap)
        vertical_jerk = params.jerk_position
    down = min(max(down, -up_max), down_max)
    slew_vertical(state, down, params.acceleration_up, params.acceleration_down, vertical_jerk, dt)

    expect(params, state, dt)

    a = setpoint.acceleration_ned
    only_horizontal = (
        math.isfinite(a[0]) and math.isfinite(a[1])
        and not (math.isfinite(p[0]) or math.isfinite(p[1]) or math.isfinite(v[0]) or math.isfinite(v[1]))
    )  # fmt: skip
    only_vertical = math.isfinite(a[2]) and not (math.isfinite(p[2]) or math.isfinite(v[2]))
    return (estimate.velocity_valid != 0 and not only_horizontal), not only_vertical


@njit(cache=True)
def accelerate(
    params: Record, state: Record, setpoint: Record, estimate: Record, horizontal: bool, vertical: bool, dt: float
) -> Vec3:
    """Return the acceleration setpoint (NED, m/s²): velocity PID plus the feed-forward of the reference."""
    out_n, out_e, out_d = 0.0, 0.0, 0.0
    push_reduction = 0.0  # m/s²
    if state.blocked_s > 0.0:
        for i in range(3 if vertical else 2):
            error = state.velocity_expected[i] - estimate.velocity_ned[i]
            push_reduction += params.velocity_p[i] * error * state.blocked_way[i]
        limit = INITIAL_PUSH_LIMIT if state.blocked_s < FIRST_S else LASTING_PUSH_LIMIT
        push_reduction = max(push_reduction - limit, 0.0)
    for i in range(3):
        extra = setpoint.acceleration_ned[i]
        ahead = extra if math.isfinite(extra) else 0.0
        if (i < 2 and horizontal) or (i == 2 and vertical):
            reference = state.acceleration_reference[i]
            error = state.velocity_expected[i] - estimate.velocity_ned[i]
            total = (
                ahead + reference + params.velocity_p[i] * error + state.velocity_integral[i]
                - push_reduction * state.blocked_way[i]
                - params.velocity_d[i] * (state.acceleration_filtered[i] - state.acceleration_expected[i])
            )  # fmt: skip
        else:
            total = ahead
            state.velocity_reference[i] = estimate.velocity_ned[i]
            state.velocity_expected[i] = estimate.velocity_ned[i]
            state.acceleration_reference[i] = 0.0
            state.acceleration_expected[i] = 0.0
            if i < 2:
                state.velocity_integral[i] = 0.0
        if i == 0:
            out_n = total
        elif i == 1:
            out_e = total
        else:
            out_d = total
    return out_n, out_e, out_d


@njit(cache=True)
def integrate(
    params: Record,
    state: Record,
    estimate: Record,
    wanted: Vec3,
    flown: Vec3,
    horizontal: bool,
    vertical: bool,
    dt: float,
) -> None:
    """Advance the velocity integrals.

    The tilt and thrust limits reduce the acceleration from `wanted` to `flown`. This difference is fed back to the
    integrals to prevent wind-up.
    """
    rests = obstacle_axes(state, vertical) if horizontal and 0.0 < state.blocked_s < BLOCKED_S else 0
    for i in range(3):
        if (i < 2 and not horizontal) or (i == 2 and not vertical):
            continue
        error = state.velocity_expected[i] - estimate.velocity_ned[i] if i >= rests else 0.0
        cut = wanted[i] - flown[i]
        back = 2.0 / max(params.velocity_p[i], 0.1) * cut  # tracking anti-windup, as in PX4's PositionControl
        state.velocity_integral[i] += params.velocity_i[i] * (error - back) * dt
        bound = 5.0  # m/s², half a g, for wind or missing thrust
        state.velocity_integral[i] = min(max(state.velocity_integral[i], -bound), bound)
    if horizontal:
        limit_obstacle_push(state, estimate, vertical, dt)


@njit(cache=True)
def obstacle_axes(state: Record, vertical: bool) -> int:
    """Return the number of axes (2: north and east, 3: all) that an obstacle may block.

    It is 2 without vertical velocity feedback, and in a vertical descent, because the ground may end the descent.
    """
    north, east, down = state.velocity_expected
    aside = north * north + east * east > SIDEWAYS_SPEED * SIDEWAYS_SPEED
    return 3 if vertical and (down < DESCENDS or aside) else 2


@njit(cache=True)
def component_along(vector: Grid, way: Vec3) -> float:
    """Return the component of a vector (north, east, down) along the unit vector `way`."""
    share: float = vector[0] * way[0] + vector[1] * way[1] + vector[2] * way[2]
    return share


@njit(cache=True)
def limit_obstacle_push(state: Record, estimate: Record, vertical: bool, dt: float) -> None:
    """Detect an obstacle, such as a wall, and reduce the integrals that push against it.

    A vehicle at rest measures the same velocity error in wind and at a wall. Each of two signs shows a wall: a knock at
    the impact, or a velocity error that does not fall while the integral grows. In wind the error falls.
    """
    total, free, tried, blocked = state.velocity_integral, state.free_integral, state.tried_integral, state.blocked_way
    north = state.velocity_expected[0] - estimate.velocity_ned[0]
    east = state.velocity_expected[1] - estimate.velocity_ned[1]
    axes = obstacle_axes(state, vertical)
    down = state.velocity_expected[2] - estimate.velocity_ned[2] if axes == 3 else 0.0
    size = math.sqrt(north * north + east * east + down * down)
    touched = state.untouched_s < TOUCHED_S
    if size < FOLLOWING_ERROR_MAX and not touched:
        for i in range(3):
            free[i] += min(dt / TRIM_S, 1.0) * (total[i] - free[i])
            tried[i] = total[i]
        state.tried_error = size
        state.blocked_s = 0.0
        return
    scale = 1.0 / max(size, 1e-6)
    push = (north * scale, east * scale, down * scale)
    moves = component_along(estimate.velocity_ned, push)
    stands = -BLOWN_BACK_SPEED < moves < CREEP_SPEED
    beyond, grown = (
        component_along(total, push) - component_along(free, push),
        component_along(total, push) - component_along(tried, push),
    )
    away = component_along(blocked, push) < 0.0
    if grown >= TEST_STEP and (state.blocked_s > 0.0 or (stands and state.tried_error - size < ERROR_DROP)):
        state.blocked_s = FIRST_S
        blocked[0], blocked[1], blocked[2] = push
    elif touched and (state.blocked_s == 0.0 or away):
        state.blocked_s = dt
        blocked[0], blocked[1], blocked[2] = push
    elif state.blocked_s > 0.0:
        state.blocked_s = 0.0 if away or not (stands or touched) else state.blocked_s + dt
    if beyond < -TEST_STEP or (state.blocked_s > 0.0 and beyond < 0.0) or 0.0 < state.blocked_s < BLOCKED_S:
        for i in range(axes):
            total[i] += min(dt / FORGET_S, 1.0) * (free[i] - total[i])
            tried[i] = total[i]
        state.tried_error = size
    elif grown < 0.5 * TEST_STEP:
        state.tried_error = size  # up to half of TEST_STEP; by then the rebound has ended
    elif grown >= TEST_STEP:
        for i in range(axes):
            tried[i] = total[i]


@njit(cache=True)
def detect_knock(params: Record, state: Record, estimate: Record, dt: float) -> None:
    """Update the accelerations that the rotors do not explain, and detect a knock in them.

    The force of an obstacle rises within milliseconds, wind force more slowly: Tomić, Ott, Haddadin, "External
    wrench estimation, collision detection, and reflex reaction for flying robots", IEEE Trans. Robotics, 2017.
    """
    thrust = state.thrust_filtered * GRAVITY / max(state.hover_thrust, 0.05)
    fast, slow = min(dt / KNOCK_S, 1.0), min(dt / GUST_S, 1.0)
    turn, sudden = params.torque_acceleration, 0.0
    for i in range(6):
        if i < 3:
            least = KNOCK
            felt = estimate.accel_frd[i] + (thrust if i == 2 else 0.0)
        else:
            least = KNOCK_TORQUE * turn[1]
            felt = state.rates_derivative[i - 3] - turn[i - 3] * state.torque_filtered[i - 3]
        if not abs(felt) < FELT_PLAUSIBLE:
            return
        state.unexplained[i] += fast * (felt - state.unexplained[i])
        state.unexplained_slow[i] += slow * (felt - state.unexplained_slow[i])
        if state.landed != 0:
            state.unexplained_slow[i] = state.unexplained[i]
        sudden += ((state.unexplained[i] - state.unexplained_slow[i]) / least) ** 2
    state.untouched_s = 0.0 if sudden > 1.0 else state.untouched_s + dt
