"""The control cascade: computes actuator commands from a setpoint and an estimate at every inertial sample.

The rate loop runs at every sample, the attitude loop every 2 ms, the position and velocity loops every 10 ms. If an
intermediate value is not finite, `fallback` commands level flight at hover thrust, so that no rotor gets that value.

The attitude loop corrects the thrust axis first and the heading second (reduced attitude control), after Brescianini,
Hehn, D'Andrea 2013, "Nonlinear quadrocopter attitude control". The derivative of the rate loop acts on the filtered
measurement.
"""

import math

from autopilot.control.mixer import attitude_of, limit_force, mix, track_hover
from autopilot.control.position import (
    accelerate,
    detect_knock,
    initialise_references,
    integrate,
    update_velocity_reference,
    update_yaw_reference,
)
from autopilot.records import (
    KIND_IDLE,
    KIND_RATES,
    KIND_TRAJECTORY,
    quat_conjugate,
    quat_from_euler,
    quat_multiply,
    quat_yaw,
    rotate,
    rotate_inverse,
)
from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Quat, Vec3


@njit(cache=True)
def wanted_rates(params: Record, attitude: Quat, target: Quat, yaw_rate: float) -> Vec3:
    """Return the body rates (rad/s) that turn `attitude` towards `target`, both FRD → NED.

    `yaw_rate` (rad/s, about NED down) is added. Each axis is limited to `params.rate_max`.
    """
    error = quat_multiply(quat_conjugate(attitude), target)
    axis = rotate(error, (0.0, 0.0, 1.0))  # target direction of the body's down axis, in the body frame
    half = math.sqrt(max(0.5 * (1.0 + axis[2]), 0.0))  # cosine of half the tilt error
    over = (0.0, 1.0, 0.0, 0.0)  # upside down: roll by 180°
    tilt = (half, -axis[1] / (2.0 * half), axis[0] / (2.0 * half), 0.0) if half > 1e-3 else over
    twist = quat_multiply(quat_conjugate(tilt), error)
    turn = twist[3] if twist[0] >= 0.0 else -twist[3]
    turn = min(max(turn, -params.yaw_weight), params.yaw_weight)  # so that thrust remains for roll and pitch
    ahead = rotate_inverse(attitude, (0.0, 0.0, yaw_rate))
    p = params.attitude_p
    x = 2.0 * p[0] * tilt[1] + ahead[0]
    y = 2.0 * p[1] * tilt[2] + ahead[1]
    z = 2.0 * p[2] * turn + ahead[2]
    top = params.rate_max
    return min(max(x, -top[0]), top[0]), min(max(y, -top[1]), top[1]), min(max(z, -top[2]), top[2])


RATE_PLAUSIBLE = 1000.0  # rad/s; more is beyond any gyro's range: the sample is invalid, and the filters are reset


@njit(cache=True)
def filter_rates(params: Record, state: Record, rates: Grid, dt: float) -> None:
    """Low-pass filter the measured rates and their derivative (IMU_GYRO_CUTOFF, IMU_DGYRO_CUTOFF)."""
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
    """Return the normalised torque (roll, pitch, yaw), each in [-1, 1], which is also written to `state.torque`.

    `state.torque_scale` is the fraction of the torque that the mixer last achieved. Below 1 (saturated actuators), an
    integral that would increase the torque stops. `idle` (on the ground or nearly without thrust) resets the integrals.
    """
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
        state.torque[i] = bounded
    return state.torque[0], state.torque[1], state.torque[2]


OUTER_PERIOD_US = 10_000
ATTITUDE_PERIOD_US = 2_000
SHORTEST_S, LONGEST_S = 1e-4, 0.02  # s, bounds of a time step, so that a gap in the samples causes no spike
ACCELERATION_CUTOFF = 2.0 * math.pi * 10.0  # rad/s, for the velocity loop's derivative
LIGHT = 0.3  # fraction of the hover thrust; below it the vehicle stands or falls, and the rate integrals are reset
ACCELERATION_PLAUSIBLE = 1000.0  # m/s²; more is beyond any accelerometer's range
ROTOR_LAG_S = 0.02  # s, lag of the rotors' thrust and torque behind the commands


@njit(cache=True)
def fallback(params: Record, state: Record, estimate: Record) -> None:
    """Command level flight with the present heading at hover thrust; reset all states that could be NaN or infinite."""
    q = estimate.attitude
    yaw = quat_yaw((q[0], q[1], q[2], q[3]))
    level = quat_from_euler(0.0, 0.0, yaw if math.isfinite(yaw) else 0.0)
    for i in range(4):
        state.attitude_setpoint[i] = level[i]
    for i in range(3):
        state.rates_setpoint[i] = 0.0
        state.velocity_integral[i] = 0.0
        state.velocity_reference[i] = 0.0
        state.velocity_expected[i] = 0.0
        state.acceleration_reference[i] = 0.0
        state.acceleration_expected[i] = 0.0
        state.acceleration_filtered[i] = 0.0
    state.thrust_setpoint = params.hover_thrust
    state.yaw_reference = yaw if math.isfinite(yaw) else 0.0
    state.yaw_rate_reference = 0.0
    state.yaw_rate_expected = 0.0
    if not math.isfinite(state.hover_thrust):
        state.hover_thrust = params.hover_thrust
    state.blocked_s = 0.0
    state.not_finite += 1


@njit(cache=True)
def run_outer_loops(
    params: Record, state: Record, setpoint: Record, estimate: Record, ceiling: float, dt: float
) -> None:
    """Compute the attitude and thrust setpoint from a trajectory setpoint. `ceiling` limits the thrust (0 … 1)."""
    q = estimate.attitude
    update_yaw_reference(params, state, setpoint, quat_yaw((q[0], q[1], q[2], q[3])), dt)
    horizontal, vertical = update_velocity_reference(params, state, setpoint, estimate, dt)
    wanted = accelerate(params, state, setpoint, estimate, horizontal, vertical, dt)
    force = limit_force(params, state.hover_thrust, ceiling, wanted)
    if not math.isfinite(force[0] + force[1] + force[2] + state.yaw_reference):
        fallback(params, state, estimate)
        return
    if state.landed == 0:
        flown = (force[0], force[1], force[2] + GRAVITY)
        integrate(params, state, estimate, wanted, flown, horizontal, vertical, dt)
    else:
        for i in range(3):
            state.velocity_integral[i] = 0.0
    target = attitude_of(force, state.yaw_reference)
    for i in range(4):
        state.attitude_setpoint[i] = target[i]
    pull = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2) * state.hover_thrust / GRAVITY
    state.thrust_setpoint = min(max(pull, 0.0), ceiling)


@njit(cache=True)
def apply_direct_setpoint(params: Record, state: Record, setpoint: Record, estimate: Record, ceiling: float) -> None:
    """Copy an attitude or rate setpoint and its thrust. Non-finite values become level, rate 0 or hover thrust."""
    thrust = setpoint.thrust
    if not math.isfinite(thrust):
        thrust = state.hover_thrust
    state.thrust_setpoint = min(max(thrust, 0.0), min(ceiling, params.thrust_max))
    if setpoint.kind == KIND_RATES:
        for i in range(3):
            rate = setpoint.rates_frd[i]
            top = params.rate_max[i]
            state.rates_setpoint[i] = min(max(rate, -top), top) if math.isfinite(rate) else 0.0
        return
    a = setpoint.attitude
    norm = a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3]
    if math.isfinite(norm) and norm > 0.25:
        scale = 1.0 / math.sqrt(norm)
        for i in range(4):
            state.attitude_setpoint[i] = a[i] * scale
    else:
        q = estimate.attitude
        yaw = setpoint.yaw if math.isfinite(setpoint.yaw) else quat_yaw((q[0], q[1], q[2], q[3]))
        level = quat_from_euler(0.0, 0.0, yaw)
        for i in range(4):
            state.attitude_setpoint[i] = level[i]
    rate = setpoint.yaw_rate
    state.yaw_rate_reference = rate if math.isfinite(rate) else 0.0


@njit(cache=True)
def stop(params: Record, state: Record, setpoint: Record, actuators: Record) -> None:
    """Set all rotor commands to 0 and reset the state of the last flight. At 0, an armed rotor idles."""
    for i in range(3):
        state.rate_integral[i] = 0.0
        state.velocity_integral[i] = 0.0
        state.rates_setpoint[i] = 0.0
        state.torque_scale[i] = 1.0
    state.thrust_setpoint = 0.0
    state.thrust_filtered = 0.0
    for i in range(3):
        state.torque_filtered[i] = 0.0
    state.hover_thrust = params.hover_thrust
    state.kind = KIND_IDLE
    for i in range(actuators.command.shape[0]):
        actuators.command[i] = 0.0


@njit(cache=True)
def run_rate_loop(params: Record, state: Record, estimate: Record, actuators: Record, dt: float) -> None:
    """Compute the rotor commands from the rates setpoint and the thrust.

    A command is a fraction of full speed; thrust is proportional to its square.
    """
    roll, pitch, yaw = torque(
        params, state, dt, state.landed != 0 or state.thrust_setpoint < LIGHT * state.hover_thrust
    )
    thrust = state.thrust_setpoint
    if not math.isfinite(roll + pitch + yaw + thrust):
        fallback(params, state, estimate)
        for i in range(3):
            state.rate_integral[i] = 0.0
            state.rates_filtered[i] = 0.0
            state.rates_derivative[i] = 0.0
        roll, pitch, yaw, thrust = 0.0, 0.0, 0.0, state.thrust_setpoint
    command = actuators.command
    share, turn, collective = mix(params, roll, pitch, yaw, thrust, command)
    for i in range(params.rotors):
        command[i] = math.sqrt(command[i])
    state.torque_scale[0] = share
    state.torque_scale[1] = share
    state.torque_scale[2] = turn
    state.torque[0] = share * roll
    state.torque[1] = share * pitch
    state.torque[2] = turn * yaw
    for i in range(3):
        state.torque_filtered[i] += min(dt / ROTOR_LAG_S, 1.0) * (state.torque[i] - state.torque_filtered[i])
    state.thrust_filtered += min(dt / ROTOR_LAG_S, 1.0) * (collective - state.thrust_filtered)


@njit(cache=True)
def update(params: Record, state: Record, setpoint: Record, estimate: Record, actuators: Record) -> None:
    """Run the loops that are due at `estimate.time_us`; write `actuators` and the setpoint fields of `estimate`."""
    time_us = estimate.time_us
    dt = min(max((time_us - state.time_us) * 1e-6, SHORTEST_S), LONGEST_S)
    state.time_us = time_us
    filter_rates(params, state, estimate.rates_frd, dt)
    detect_knock(params, state, estimate, dt)
    actuators.time_us = time_us
    armed = setpoint.armed != 0
    actuators.armed = 1 if armed else 0
    kind = setpoint.kind
    if not armed or kind < KIND_TRAJECTORY or kind > KIND_RATES:
        stop(params, state, setpoint, actuators)
    else:
        ceiling = setpoint.thrust_limit
        ceiling = min(max(ceiling, 0.0), 1.0) if math.isfinite(ceiling) else 1.0
        elapsed = time_us - state.outer_time_us
        if kind == KIND_TRAJECTORY:
            if state.kind != KIND_TRAJECTORY:
                initialise_references(state, estimate)
                elapsed = OUTER_PERIOD_US
            if elapsed >= OUTER_PERIOD_US or elapsed < 0:
                state.outer_time_us = time_us
                span = min(max(elapsed * 1e-6, SHORTEST_S), 2.0 * LONGEST_S)
                filter_acceleration(state, estimate, span)
                track_hover(params, state, estimate, span)
                run_outer_loops(params, state, setpoint, estimate, ceiling, span)
        else:
            apply_direct_setpoint(params, state, setpoint, estimate, ceiling)
        waited = time_us - state.attitude_time_us
        if kind != KIND_RATES and (waited >= ATTITUDE_PERIOD_US or waited < 0 or state.kind != kind):
            state.attitude_time_us = time_us
            q, a = estimate.attitude, state.attitude_setpoint
            x, y, z = wanted_rates(params, (q[0], q[1], q[2], q[3]), (a[0], a[1], a[2], a[3]), state.yaw_rate_reference)
            state.rates_setpoint[0], state.rates_setpoint[1], state.rates_setpoint[2] = x, y, z
        state.kind = kind
        run_rate_loop(params, state, estimate, actuators, dt)
    for i in range(4):
        estimate.attitude_setpoint[i] = state.attitude_setpoint[i]
    for i in range(3):
        estimate.rates_setpoint[i] = state.rates_setpoint[i]
    estimate.thrust_setpoint = state.thrust_setpoint
    estimate.hover_thrust = state.hover_thrust


@njit(cache=True)
def filter_acceleration(state: Record, estimate: Record, dt: float) -> None:
    """Low-pass filter the measured acceleration (NED, gravity removed)."""
    q, s = estimate.attitude, estimate.accel_frd
    x, y, z = rotate((q[0], q[1], q[2], q[3]), (s[0], s[1], s[2]))
    weight = dt * ACCELERATION_CUTOFF
    weight = weight / (1.0 + weight)
    f = state.acceleration_filtered
    if not abs(x) + abs(y) + abs(z) < ACCELERATION_PLAUSIBLE:
        return
    f[0] += weight * (x - f[0])
    f[1] += weight * (y - f[1])
    f[2] += weight * (z + GRAVITY - f[2])
