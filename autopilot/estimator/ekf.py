"""The estimator: error-state Kalman filter of attitude, velocity, position, inertial biases and hard iron.

`update` runs every millisecond of vehicle time. It integrates the nominal state with every inertial sample, so that
control always has the newest attitude. It propagates the covariance every 4 ms. It fuses samples of
magnetometer, barometer and GNSS when they arrive; a fix is compared with the state at the time of the fix. The only
inputs are sensor samples.
"""

import math

from autopilot.estimator.alignment import align, clear, collect_imu
from autopilot.estimator.covariance import deviation, propagate
from autopilot.estimator.fusion import fuse_fix, fuse_heading, fuse_height, fuse_stillness
from autopilot.estimator.records import HISTORY, STATUS_ALIGNING, STATUS_RUNNING
from autopilot.records import TESTS, pressure_altitude, quat_advance, rotate
from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Vec3

COVARIANCE_PERIOD_S = 0.0035  # least time between propagations: every fourth sample at 1 kHz, each sample at 250 Hz
PUBLISH_PERIOD_US = 20_000  # µs between updates of flags, deviations and ratios; pose and velocity: every sample
VIBRATION_SHARE = 0.02  # weight of a new sample in the vibration metric: smoothing over one second, as in PX4
FULL_SCALE = 0.98 * 16.0 * GRAVITY  # m/s², of an accelerometer with ±16 g; a larger sample counts as clipped
STILL_PERIOD_US = 100_000
STILL_NOISE_GROUND = 0.1  # m/s; without fixes, zero velocity is fused with this noise on the ground
SHOCK_SPEED = 3.0  # m/s, standard deviation of the velocity after an impact (a sample of at least `accel_clip`)
STILL_NOISE_AIR = 10.0  # m/s, as STILL_NOISE_GROUND in the air; so large that it only keeps the tilt error bounded


@njit(cache=True)
def strapdown(state: Record, ax: float, ay: float, az: float, gx: float, gy: float, gz: float, dt: float) -> None:
    """Advance attitude, velocity and position by one inertial sample (biases already removed)."""
    q = state.attitude
    before = (q[0], q[1], q[2], q[3])
    after = quat_advance(before, gx * dt, gy * dt, gz * dt)
    # on average, the specific force acts at the attitude in the middle of the step
    fx, fy, fz = rotate(before, (ax + 0.5 * dt * (gy * az - gz * ay), ay + 0.5 * dt * (gz * ax - gx * az),
                                 az + 0.5 * dt * (gx * ay - gy * ax)))  # fmt: skip
    q[0], q[1], q[2], q[3] = after
    v, p = state.velocity, state.position
    dvx, dvy, dvz = fx * dt, fy * dt, (fz + GRAVITY) * dt
    dpx, dpy, dpz = (v[0] + 0.5 * dvx) * dt, (v[1] + 0.5 * dvy) * dt, (v[2] + 0.5 * dvz) * dt
    v[0] += dvx
    v[1] += dvy
    v[2] += dvz
    p[0] += dpx
    p[1] += dpy
    p[2] += dpz
    rv, rp = state.reckoned_velocity, state.reckoned_position
    rv[0] += dvx
    rv[1] += dvy
    rv[2] += dvz
    rp[0] += dpx
    rp[1] += dpy
    rp[2] += dpz
    i = state.impulse
    i[0] += fx * dt
    i[1] += fy * dt
    i[2] += fz * dt
    state.impulse_dt += dt


@njit(cache=True)
def predict_covariance(params: Record, state: Record, P: Grid, history: Grid) -> None:
    """Propagate the covariance over the time since the last call, and add an entry to `history`."""
    propagate(params, P, state.attitude, state.impulse, state.impulse_dt)
    state.impulse_dt = 0.0
    if state.shocked:  # larger variances, so that the gates accept the first fixes after the impact
        state.shocked = 0
        for i in range(3, 6):
            P[i, i] = max(P[i, i], SHOCK_SPEED * SHOCK_SPEED)
    index = state.history_index
    history[index, 0] = state.time_us
    for i in range(3):
        state.impulse[i] = 0.0
        history[index, 1 + i] = state.reckoned_velocity[i]
        history[index, 4 + i] = state.reckoned_position[i]
    state.history_index = (index + 1) % HISTORY
    state.history_count = min(state.history_count + 1, HISTORY)


@njit(cache=True)
def fuse_aiding_sensors(params: Record, state: Record, P: Grid, history: Grid, sensors: Record, landed: bool) -> None:
    """Fuse new samples of magnetometer, barometer, GNSS."""
    time_us = state.time_us
    if sensors.mag_time_us != state.mag_time_us:
        elapsed = sensors.mag_time_us - state.mag_time_us
        m = sensors.mag_frd
        if not math.isfinite(m[0] + m[1] + m[2]):
            state.mag_time_us = sensors.mag_time_us
            state.bad_samples += 1
        elif elapsed >= 19_000 or elapsed < 0:  # 50 Hz is enough
            state.mag_time_us = sensors.mag_time_us
            fuse_heading(params, state, P, m[0], m[1], m[2], time_us, landed)
    if sensors.baro_time_us != state.baro_time_us:
        state.baro_time_us = sensors.baro_time_us
        if 100.0 < sensors.pressure_hpa < 1300.0:
            fuse_height(params, state, P, sensors.pressure_hpa, time_us)
        else:
            state.bad_samples += 1
    if sensors.gps_time_us != state.gps_time_us:
        state.gps_time_us = sensors.gps_time_us
        fuse_fix(params, state, P, history, sensors)
    unaided = state.velocity_fused_us == 0 or time_us - state.velocity_fused_us > 1_000_000
    if unaided and time_us - state.still_fused_us >= STILL_PERIOD_US:
        state.still_fused_us = time_us
        fuse_stillness(state, P, STILL_NOISE_GROUND if landed else STILL_NOISE_AIR)


@njit(cache=True)
def collect_alignment_samples(params: Record, state: Record, P: Grid, sensors: Record) -> None:
    """Add the new samples to the alignment window, and align if the window is complete."""
    if state.align_since_us == 0:
        clear(state, state.time_us)
    collect_imu(state, sensors.accel_frd, sensors.gyro_frd)
    if sensors.mag_time_us != state.mag_time_us:
        state.mag_time_us = sensors.mag_time_us
        m = sensors.mag_frd
        if math.isfinite(m[0] + m[1] + m[2]):
            state.align_mag_count += 1
            for i in range(3):
                state.align_mag[i] += m[i]
    if sensors.baro_time_us != state.baro_time_us:
        state.baro_time_us = sensors.baro_time_us
        if 100.0 < sensors.pressure_hpa < 1300.0:
            state.align_baro_count += 1
            state.align_baro += pressure_altitude(sensors.pressure_hpa)
    align(params, state, P, state.time_us)


@njit(cache=True)
def publish(params: Record, state: Record, P: Grid, estimate: Record) -> None:
    """Write flags, deviations and test ratios into the ESTIMATE record."""
    time_us = state.time_us
    running = state.status == STATUS_RUNNING
    estimate.attitude_valid = running
    estimate.origin_set = state.origin_set
    estimate.origin_lat_deg = state.origin_lat_deg
    estimate.origin_lon_deg = state.origin_lon_deg
    estimate.origin_alt_m = state.origin_alt_m
    timeout = params.timeout_us
    estimate.velocity_valid = running and state.velocity_fused_us > 0 and time_us - state.velocity_fused_us < timeout
    estimate.position_valid = running and state.position_fused_us > 0 and time_us - state.position_fused_us < timeout
    estimate.altitude_valid = running and time_us - state.baro_fused_us < timeout
    estimate.position_std_h = deviation(P[6, 6] + P[7, 7])
    estimate.position_std_v = deviation(P[8, 8])
    estimate.velocity_std_h = deviation(P[3, 3] + P[4, 4])
    estimate.velocity_std_v = deviation(P[5, 5])
    estimate.tilt_std = deviation(P[0, 0] + P[1, 1])
    estimate.yaw_std = deviation(P[2, 2])
    for i in range(TESTS):
        estimate.innovation[i] = state.innovation[i]
        estimate.innovation_variance[i] = state.innovation_variance[i]
        estimate.test_ratio[i] = state.test_ratio[i]


@njit(cache=True)
def update_vibration(state: Record, estimate: Record, accel: Vec3, rates: Vec3) -> None:
    """Update the vibration metrics with the newest sample (m/s² and rad/s, FRD)."""
    a, g = state.looked_accel, state.looked_rates
    if state.published_us > 0:
        moved = math.sqrt((accel[0] - a[0]) ** 2 + (accel[1] - a[1]) ** 2 + (accel[2] - a[2]) ** 2)
        turned = math.sqrt((rates[0] - g[0]) ** 2 + (rates[1] - g[1]) ** 2 + (rates[2] - g[2]) ** 2)
        estimate.vibration_accel += VIBRATION_SHARE * (moved - estimate.vibration_accel)
        estimate.vibration_gyro += VIBRATION_SHARE * (turned - estimate.vibration_gyro)
    a[0], a[1], a[2] = accel
    g[0], g[1], g[2] = rates
    for i in range(3):
        if abs(a[i]) > FULL_SCALE:
            estimate.clipped[i] += 1


@njit(cache=True)
def update(
    params: Record, state: Record, P: Grid, history: Grid, sensors: Record, estimate: Record, landed: bool
) -> bool:
    """Update from the SENSORS record; return whether it has a new, finite inertial sample.

    With such a sample, `estimate` is updated. After 0.1 s without one, the attitude of `estimate` is invalid.
    params, state: ESTIMATOR_PARAMS, ESTIMATOR_STATE; P (STATES, STATES); history (HISTORY, 7); landed: the vehicle is
    assumed to stand on the ground.
    """
    time_us = sensors.imu_time_us
    a, g = sensors.accel_frd, sensors.gyro_frd
    is_finite = math.isfinite(a[0] + a[1] + a[2] + g[0] + g[1] + g[2])
    if time_us == state.time_us or not is_finite:
        if not is_finite:
            state.bad_samples += 1
        if sensors.time_us - state.time_us > 100_000:
            estimate.attitude_valid = 0  # the inertial sensor delivers no usable samples
            estimate.time_us = sensors.time_us
        return False
    dt = (time_us - state.time_us) * 1e-6
    state.time_us = time_us
    estimate.time_us = time_us
    b, c = state.gyro_bias, state.accel_bias
    gx, gy, gz = g[0] - b[0], g[1] - b[1], g[2] - b[2]
    ax, ay, az = a[0] - c[0], a[1] - c[1], a[2] - c[2]
    if state.status == STATUS_ALIGNING:
        collect_alignment_samples(params, state, P, sensors)
    else:
        strapdown(state, ax, ay, az, gx, gy, gz, min(max(dt, 0.0), 0.05))
        if max(abs(a[0]), abs(a[1]), abs(a[2])) >= params.accel_clip:
            state.shocked, state.shock_us = 1, time_us
        if state.impulse_dt >= COVARIANCE_PERIOD_S:
            predict_covariance(params, state, P, history)
        fuse_aiding_sensors(params, state, P, history, sensors, landed)
        if not math.isfinite(state.attitude[0] + state.velocity[0] + state.velocity[1] + state.position[2] + P[0, 0]):
            restart(state)
    if time_us - state.published_us >= PUBLISH_PERIOD_US or time_us < state.published_us:
        update_vibration(state, estimate, (ax, ay, az), (gx, gy, gz))
        state.published_us = time_us
        publish(params, state, P, estimate)
    for i in range(4):
        estimate.attitude[i] = state.attitude[i]
    for i in range(3):
        estimate.velocity_ned[i] = state.velocity[i]
        estimate.position_ned[i] = state.position[i]
        estimate.gyro_bias[i] = b[i]
        estimate.accel_bias[i] = c[i]
    estimate.resets = state.resets + state.restarts
    r, s = estimate.rates_frd, estimate.accel_frd
    r[0], r[1], r[2] = gx, gy, gz
    s[0], s[1], s[2] = ax, ay, az
    return True


@njit(cache=True)
def restart(state: Record) -> None:
    """Reset a state that is no longer finite, and align again. The local frame keeps its origin."""
    state.status = STATUS_ALIGNING
    state.restarts += 1
    state.align_since_us = 0
    state.align_attempts = 5  # align after one window, even if moving: the vehicle may be in the air
    state.attitude[0] = 1.0
    state.position_fused_us = 0
    state.velocity_fused_us = 0
    for i in range(3):
        state.attitude[1 + i] = 0.0
        state.velocity[i] = 0.0
        state.position[i] = 0.0
        state.gyro_bias[i] = 0.0
        state.accel_bias[i] = 0.0
        state.reckoned_velocity[i] = 0.0
        state.reckoned_position[i] = 0.0
