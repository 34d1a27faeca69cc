"""The filter alone, with the noise that it assumes: its consistency, and its parts compared with references."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from filterpy.stats import NEES
from numba import njit
from scipy.stats import chi2

from autopilot.estimator import covariance as estimator_covariance
from autopilot.estimator import ekf
from autopilot.estimator.records import HISTORY, MOTION, STATES, STATUS_RUNNING, default_parameters, initial_state
from autopilot.records import ESTIMATE, HEADING_TEST, HEIGHT_TEST, quat_advance, rotate, rotate_inverse
from foundation import frames
from foundation.atmosphere import pressure_altitude
from foundation.frames import GRAVITY
from foundation.sensors import SENSORS

ORIGIN = (47.3977, 8.5456, 488.0)
DECLINATION = 0.0558
FIELD = (0.214 * math.cos(DECLINATION), 0.214 * math.sin(DECLINATION), 0.43)  # gauss, NED
STD0 = np.repeat([0.02, 0.3, 1.0, 0.005, 0.05], 3)  # of attitude, velocity, position, gyro and accelerometer bias
to_geodetic = njit(frames.ned_to_geodetic)
multiply = njit(frames.quat_multiply)

TRUTH = np.dtype(
    [
        ("q", "f8", (4,)),
        ("v", "f8", (3,)),
        ("p", "f8", (3,)),
        ("bg", "f8", (3,)),
        ("ba", "f8", (3,)),
        ("force", "f8", (3,)),
    ]
)


class Filter:
    """Records of one estimator that is already running at the origin."""

    def __init__(self):
        self.params = default_parameters()
        self.params["declination"] = DECLINATION
        self.state = initial_state()
        self.state["status"] = STATUS_RUNNING
        self.state["origin_set"] = 1
        self.state["gps_good_fixes"] = 10
        self.state["origin_lat_deg"], self.state["origin_lon_deg"], self.state["origin_alt_m"] = ORIGIN
        self.state["baro_reference_m"] = ORIGIN[2]
        for name in ("position", "velocity", "baro", "mag"):
            self.state[f"{name}_fused_us"] = 1
        self.covariance = np.zeros((STATES, STATES))  # no hard-iron offset of the magnetometer
        self.covariance[:MOTION, :MOTION] = np.diag(STD0**2)
        self.params["mag_bias_std"] = 0.0
        self.history = np.zeros((HISTORY, 7))
        self.sensors = np.zeros(1, SENSORS)[0]
        self.estimate = np.zeros(1, ESTIMATE)[0]

    @property
    def args(self):
        return self.params, self.state, self.covariance, self.history, self.sensors, self.estimate, False


@njit
def world(
    steps,
    seed,
    noise,
    manoeuvre,
    latency_ms,
    params,
    state,
    covariance,
    history,
    sensors,
    estimate,
    landed,
    truth,
    past,
):
    """Simulate `steps` milliseconds of a known motion and update the filter. `noise` scales all random terms.

    `truth` is advanced in place. `past` (1000, 6) stores velocity and position for the receiver's latency. Returns the
    mean normalised innovations squared of barometer and compass after the first 10 s.
    """
    if seed >= 0:
        np.random.seed(seed)
    dt = 1e-3
    gyro_std, accel_std = noise * params.gyro_noise / math.sqrt(dt), noise * params.accel_noise / math.sqrt(dt)
    baro_sum, baro_count, mag_sum, mag_count = 0.0, 0, 0.0, 0
    for _ in range(steps):
        sensors.time_us += 1000
        now = sensors.time_us
        t = now * 1e-6
        wx = manoeuvre * 0.4 * math.sin(1.3 * t)
        wy = manoeuvre * 0.4 * math.cos(0.9 * t)
        wz = manoeuvre * 0.5 * math.sin(0.31 * t)
        q = (truth.q[0], truth.q[1], truth.q[2], truth.q[3])
        ax, ay, az = rotate_inverse(q, (truth.force[0], truth.force[1], truth.force[2] - GRAVITY))
        ax += manoeuvre * math.sin(0.7 * t)
        ay += manoeuvre * math.cos(1.1 * t)
        az += manoeuvre * math.sin(0.5 * t)
        after = quat_advance(q, wx * dt, wy * dt, wz * dt)
        f = rotate(
            q,
            (
                ax + 0.5 * dt * (wy * az - wz * ay),
                ay + 0.5 * dt * (wz * ax - wx * az),
                az + 0.5 * dt * (wx * ay - wy * ax),
            ),
        )
        for i in range(4):
            truth.q[i] = after[i]
        for i in range(3):
            a = f[i] + (GRAVITY if i == 2 else 0.0)
            truth.p[i] += (truth.v[i] + 0.5 * a * dt) * dt
            truth.v[i] += a * dt
            truth.bg[i] += noise * params.gyro_bias_walk * math.sqrt(dt) * np.random.normal()
            truth.ba[i] += noise * params.accel_bias_walk * math.sqrt(dt) * np.random.normal()
            past[(now // 1000) % 1000, i] = truth.v[i]
            past[(now // 1000) % 1000, 3 + i] = truth.p[i]
        sensors.imu_time_us = now
        sensors.gyro_frd[0] = wx + truth.bg[0] + gyro_std * np.random.normal()
        sensors.gyro_frd[1] = wy + truth.bg[1] + gyro_std * np.random.normal()
        sensors.gyro_frd[2] = wz + truth.bg[2] + gyro_std * np.random.normal()
        sensors.accel_frd[0] = ax + truth.ba[0] + accel_std * np.random.normal()
        sensors.accel_frd[1] = ay + truth.ba[1] + accel_std * np.random.normal()
        sensors.accel_frd[2] = az + truth.ba[2] + accel_std * np.random.normal()
        late = steps > 1 and now > 10_000_000
        mag, baro = now % 20_000 == 5_000, now % 20_000 == 0
        if mag:
            sensors.mag_time_us = now
            m = rotate_inverse(after, FIELD)
            for i in range(3):
                sensors.mag_frd[i] = m[i] + noise * params.mag_noise * np.random.normal()
        if baro:
            sensors.baro_time_us = now
            height = ORIGIN[2] - truth.p[2] + noise * params.baro_noise * np.random.normal()
            sensors.pressure_hpa = 1013.25 * (1.0 - height / 44330.769) ** (1.0 / 0.190263)
        if now % 100_000 == 0 and now > 1000 * latency_ms:
            sensors.gps_time_us = now - 1000 * latency_ms
            slot = ((now // 1000) - latency_ms) % 1000
            n = past[slot]
            lat, lon, alt = to_geodetic(
                ORIGIN[0],
                ORIGIN[1],
                ORIGIN[2],
                n[3] + noise * params.gps_position_noise * np.random.normal(),
                n[4] + noise * params.gps_position_noise * np.random.normal(),
                n[5],
            )
            sensors.gps_lat_deg, sensors.gps_lon_deg, sensors.gps_alt_m = lat, lon, alt
            for i in range(3):
                sensors.gps_velocity_ned[i] = n[i] + noise * params.gps_velocity_noise * np.random.normal()
            sensors.gps_eph_m, sensors.gps_epv_m, sensors.gps_speed_accuracy = 0.1, 1.0, 0.1
            sensors.gps_fix_type = 3
        ekf.update(params, state, covariance, history, sensors, estimate, landed)
        if late and baro:
            baro_sum += state.test_ratio[HEIGHT_TEST] * params.gate_baro**2
            baro_count += 1
        if late and mag:
            mag_sum += state.test_ratio[HEADING_TEST] * params.gate_mag**2
            mag_count += 1
    return baro_sum / max(baro_count, 1), mag_sum / max(mag_count, 1)


def error_of(filter_, truth):
    """Return the 15 errors (truth minus estimate) in the filter's order. Attitude is a rotation vector in NED."""
    state = filter_.state
    q = frames.quat_multiply(tuple(truth["q"]), frames.quat_conjugate(tuple(state["attitude"])))
    turn = 2.0 * np.array(q[1:]) * math.copysign(1.0, q[0])
    return np.concatenate(
        [
            turn,
            truth["v"] - state["velocity"],
            truth["p"] - state["position"],
            truth["bg"] - state["gyro_bias"],
            truth["ba"] - state["accel_bias"],
        ]
    )


def fresh_truth():
    truth = np.zeros(1, TRUTH)[0]
    truth["q"] = (1.0, 0.0, 0.0, 0.0)
    return truth


@pytest.mark.parametrize("manoeuvre", [0.0, 1.0])
def test_normalised_errors_are_consistent(manoeuvre):
    """The mean NEES of 40 flights lies within the 99.8 % interval of χ² with 15 degrees of freedom."""
    flights, scores, baro, mag = 40, [], [], []
    for seed in range(flights):
        filter_, truth, past = Filter(), fresh_truth(), np.zeros((1000, 6))
        start = np.random.default_rng(seed).normal(size=MOTION) * STD0
        state = filter_.state
        state["attitude"] = frames.quat_normalized((1.0, *(-0.5 * start[:3])))
        state["velocity"], state["position"] = -start[3:6], -start[6:9]
        truth["bg"], truth["ba"] = start[9:12], start[12:15]
        row = []
        for k in range(4):
            innovations = world(5000, seed if k == 0 else -1, 1.0, manoeuvre, 100, *filter_.args, truth, past)
            error = error_of(filter_, truth)
            row.append(NEES(np.array([error]), np.zeros((1, MOTION)), filter_.covariance[None, :MOTION, :MOTION])[0])
        scores.append(row)
        baro.append(innovations[0])
        mag.append(innovations[1])
    low, high = chi2.ppf([0.001, 0.999], 15 * flights) / flights
    means = np.array(scores).mean(axis=0)
    assert (means > low).all(), means
    assert (means < high).all(), means
    assert 0.9 < np.mean(baro) < 1.1
    assert 0.85 < np.mean(mag) < 1.15


@pytest.mark.parametrize(
    ("velocity", "force"), [((10.0, -4.0, 0.0), (0.0, 0.0, 0.0)), ((0.0, 0.0, 0.0), (2.0, 1.0, 0.0))]
)
@pytest.mark.parametrize("latency_ms", [0, 100, 200])
def test_a_delayed_fix_is_compared_with_the_state_at_its_own_time(velocity, force, latency_ms):
    """Delayed fixes cause no bias at constant speed or at constant acceleration."""
    filter_, truth, past = Filter(), fresh_truth(), np.zeros((1000, 6))
    truth["v"], truth["force"] = velocity, force
    filter_.state["velocity"] = velocity
    world(20_000, 0, 0.0, 0.0, latency_ms, *filter_.args, truth, past)
    error = error_of(filter_, truth)
    assert np.abs(error[3:6]).max() < 0.01
    assert np.abs(error[6:9]).max() < 0.02  # naive fusion: 10 m/s · 0.1 s = 1 m


def test_vertical_channel_equals_a_textbook_filter():
    """With known attitude and biases, z and its velocity form a two-state Kalman filter with the barometer."""
    filter_ = Filter()
    filter_.params["gyro_noise"] = filter_.params["gyro_bias_walk"] = filter_.params["accel_bias_walk"] = 0.0
    variance = np.zeros(STATES)
    variance[5], variance[8] = 0.25, 1.0
    filter_.covariance[:] = np.diag(variance)
    filter_.state["velocity_fused_us"] = 10**12  # aiding never times out, so the filter never assumes standstill
    dt = 0.004
    reference = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    reference.x = np.zeros((2, 1))
    reference.F = np.array([[1.0, dt], [0.0, 1.0]])
    reference.B = np.array([[0.5 * dt * dt], [dt]])
    reference.Q = np.diag([0.0, filter_.params["accel_noise"] ** 2 * dt])
    reference.H = np.array([[1.0, 0.0]])
    reference.R = np.array([[filter_.params["baro_noise"] ** 2]])
    reference.P = np.diag([1.0, 0.25])
    rng = np.random.default_rng(1)
    sensors = filter_.sensors
    for k in range(1, 1000):
        sensors["time_us"] = sensors["imu_time_us"] = 4000 * k
        down = 0.5 * math.sin(0.01 * k)
        sensors["accel_frd"] = (0.0, 0.0, down - GRAVITY)
        reference.predict(u=np.array([[down]]))
        if k % 5 == 0:
            sensors["baro_time_us"] = sensors["time_us"]
            sensors["pressure_hpa"] = 1013.25 * (1.0 - (ORIGIN[2] + rng.normal()) / 44330.769) ** (1.0 / 0.190263)
            reference.update(ORIGIN[2] - pressure_altitude(sensors["pressure_hpa"]))
        ekf.update(*filter_.args)
        assert filter_.state["position"][2] == pytest.approx(reference.x[0, 0], abs=1e-9)
        assert filter_.state["velocity"][2] == pytest.approx(reference.x[1, 0], abs=1e-9)
    inner = filter_.covariance[np.ix_([8, 5], [8, 5])]
    assert inner == pytest.approx(reference.P, rel=1e-9)


def test_sparse_propagation_equals_the_dense_product():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(STATES, STATES))
    before = root @ root.T
    q = frames.quat_normalized(tuple(rng.normal(size=4)))
    impulse, dt = rng.normal(size=3), 0.004
    rotation = np.array([frames.rotate(q, tuple(e)) for e in np.eye(3)]).T
    x, y, z = impulse
    jacobian = np.eye(STATES)
    jacobian[0:3, 9:12] = -rotation * dt
    jacobian[3:6, 0:3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    jacobian[3:6, 12:15] = -rotation * dt
    jacobian[6:9, 3:6] = np.eye(3) * dt
    noise = np.append(np.repeat([1.0, 4.0, 0.0, 9.0, 16.0], 3), [25.0, 25.0]) * dt
    expected = jacobian @ before @ jacobian.T + np.diag(noise)
    after = before.copy()
    params = default_parameters()
    names = ("gyro_noise", "accel_noise", "gyro_bias_walk", "accel_bias_walk", "mag_bias_walk")
    for name, value in zip(names, (1.0, 2.0, 3.0, 4.0, 5.0), strict=True):
        params[name] = value
    estimator_covariance.propagate(params, after, np.array(q), impulse, dt)
    assert after == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_turn_separates_hard_iron_from_heading():
    """A body-fixed magnetometer offset makes the first heading wrong. A turn on the spot corrects both."""
    filter_, truth = Filter(), fresh_truth()
    filter_.params["mag_bias_std"] = 0.01
    iron = (0.006, -0.005)  # gauss; the heading error is 1.3° when facing north
    heading = DECLINATION - math.atan2(FIELD[1] + iron[1], FIELD[0] + iron[0])
    filter_.state["attitude"] = frames.quat_from_euler(0.0, 0.0, heading)
    filter_.covariance[:] = np.diag(np.append(np.repeat([0.01, 0.1, 0.5, 0.002, 0.02], 3), [0.0, 0.0]) ** 2)
    estimator_covariance.trust_compass(filter_.covariance, filter_.state, 0.214, DECLINATION, 0.01)
    sensors, yaw = filter_.sensors, 0.0
    for k in range(1, 10_000):
        sensors["time_us"] = sensors["imu_time_us"] = 4000 * k
        rate = 0.6 if k > 1000 else 0.0
        yaw += rate * 0.004
        truth["q"] = frames.quat_from_euler(0.0, 0.0, yaw)
        sensors["gyro_frd"], sensors["accel_frd"] = (0.0, 0.0, rate), (0.0, 0.0, -GRAVITY)
        if k % 5 == 0:
            sensors["mag_time_us"] = sensors["time_us"]
            sensors["mag_frd"] = rotate_inverse(tuple(truth["q"]), FIELD) + np.array([*iron, 0.0])
        filter_.state["velocity_fused_us"] = sensors["time_us"]
        ekf.update(*filter_.args)
        if k == 1000:
            assert abs(error_of(filter_, truth)[2]) > 0.015
    assert abs(error_of(filter_, truth)[2]) < 0.004
    assert filter_.state["mag_bias"] == pytest.approx(iron, abs=0.001)


def test_fast_attitude_step_equals_the_exact_one():
    rng = np.random.default_rng(0)
    for _ in range(100):
        q = frames.quat_normalized(tuple(rng.normal(size=4)))
        turn = rng.uniform(-0.03, 0.03, 3)
        assert quat_advance(q, *turn) == pytest.approx(frames.quat_integrate(q, tuple(turn)), abs=1e-9)


def test_vibration_is_the_smoothed_change_between_samples() -> None:
    vehicle = Filter()

    def feel(milliseconds: int, accel_down: Callable[[int], float]) -> None:
        for i in range(milliseconds):
            vehicle.sensors["imu_time_us"] += 1000
            vehicle.sensors["accel_frd"] = (0.0, 0.0, accel_down(i // 20))  # the filter samples vibration every 20 ms
            ekf.update(*vehicle.args)

    feel(1000, lambda look: -GRAVITY)
    assert vehicle.estimate["vibration_accel"] < 1e-6
    feel(10_000, lambda look: -GRAVITY + (3.0 if look % 2 else -3.0))
    assert vehicle.estimate["vibration_accel"] == pytest.approx(6.0, abs=0.2)
    assert vehicle.estimate["vibration_gyro"] < 1e-3
    assert vehicle.estimate["clipped"].tolist() == [0, 0, 0]
    feel(200, lambda look: -200.0)
    assert vehicle.estimate["clipped"].tolist() == [0, 0, 10]
