"""Sensors: rates, noise, delay and direction, against the suite's values."""

from dataclasses import replace

import numpy as np
import pytest

from foundation.errors import UsageError
from foundation.frames import GRAVITY, geodetic_to_ned, quat_from_euler
from tests.vehicles.fleet import HIGH, ORIGIN, vehicle
from vehicles.multirotor import Multirotor
from vehicles.sensors import PERFECT, Suite


def record(craft: Multirotor, field: str, count: int, every: int = 1) -> np.ndarray:
    """Return `count` values of a sensor field, `every` ms apart."""
    values = []
    for _ in range(count):
        craft.advance(every)
        values.append(np.copy(craft.sensors[field]))
    return np.array(values)


def test_perfect_inertial_sensors_equal_the_truth() -> None:
    craft = vehicle(suite=PERFECT)
    craft.advance(100)
    assert craft.sensors["accel_frd"] == pytest.approx((0.0, 0.0, -GRAVITY), abs=1e-6)
    assert craft.sensors["gyro_frd"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("period", [1000, 4000])
def test_inertial_noise_is_as_configured(period: int) -> None:
    suite = Suite(imu_period_us=period, accel_random_walk=0.0, gyro_random_walk=0.0)
    craft = vehicle(suite=suite)
    accel = record(craft, "accel_frd", 3000, period // 1000)
    assert np.std(accel, axis=0) == pytest.approx(suite.accel_noise_density / np.sqrt(period * 1e-6), rel=0.08)
    gyro = record(craft, "gyro_frd", 3000, period // 1000)
    assert np.std(gyro, axis=0) == pytest.approx(suite.gyro_noise_density / np.sqrt(period * 1e-6), rel=0.08)


def test_biases_differ_by_seed_and_walk_as_configured() -> None:
    suite = Suite()
    first = np.array([vehicle(seed=seed).memory["gyro_bias"] for seed in range(100)])
    assert np.std(first) == pytest.approx(suite.gyro_bias, rel=0.15)
    walked = []
    for seed in range(60):
        craft = vehicle(seed=seed)
        before = craft.memory["accel_bias"].copy()
        craft.advance(10_000)
        walked.append(craft.memory["accel_bias"] - before)
    assert np.std(walked) == pytest.approx(suite.accel_random_walk * np.sqrt(10.0), rel=0.2)


def test_inertial_sensors_saturate() -> None:
    craft = vehicle(position_ned=HIGH, suite=PERFECT)
    craft.state["rates"] = (50.0, 0.0, -50.0)
    craft.advance(1)
    assert craft.sensors["gyro_frd"][0] == PERFECT.gyro_range
    assert craft.sensors["gyro_frd"][2] == -PERFECT.gyro_range


def test_each_sensor_keeps_its_rate() -> None:
    craft = vehicle()
    seen: dict[str, set[int]] = {name: set() for name in ("imu", "mag", "baro", "gps", "range", "battery")}
    for _ in range(2000):
        craft.advance(1)
        assert craft.sensors["time_us"] == craft.state["time_us"] == craft.truth["time_us"]
        for name, times in seen.items():
            times.add(int(craft.sensors[f"{name}_time_us"]))
    counts = {name: len(times - {0}) for name, times in seen.items()}
    assert counts == {"imu": 2000, "mag": 200, "baro": 100, "gps": 19, "range": 100, "battery": 20}


@pytest.mark.parametrize("latency", [0, 100_000, 250_000])
def test_a_fix_arrives_late_with_the_time_of_its_position(latency: int) -> None:
    craft = vehicle(position_ned=HIGH, suite=replace(PERFECT, gps_latency_us=latency))
    craft.state["velocity"] = (5.0, -3.0, 0.0)
    positions = {0: craft.truth["position_ned"].copy()}
    seen = set()
    for _ in range(1500):
        craft.advance(1)
        positions[int(craft.truth["time_us"])] = craft.truth["position_ned"].copy()
        valid = int(craft.sensors["gps_time_us"])
        if valid == 0 or valid in seen:
            continue
        seen.add(valid)
        assert craft.sensors["time_us"] - valid == latency
        fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
        assert geodetic_to_ned(*ORIGIN, *fix) == pytest.approx(positions[valid], abs=1e-3)
    assert len(seen) == 15 - latency // 100_000
    assert craft.sensors["gps_fix_type"] == 3


def test_the_gps_error_has_the_configured_size_and_correlation() -> None:
    suite = Suite()
    errors, velocities = [], []
    for seed in range(40):
        craft = vehicle(seed=seed)
        for steps in (1000, 1000, 30_000):
            craft.advance(steps)
            fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
            errors.append(np.array(geodetic_to_ned(*ORIGIN, *fix)) - craft.truth["position_ned"])
            velocities.append(craft.sensors["gps_velocity_ned"].copy())
    grid = np.array(errors).reshape(40, 3, 3)
    assert np.std(grid[..., :2]) == pytest.approx(np.hypot(suite.gps_error_h, suite.gps_multipath_h), rel=0.25)
    assert np.std(grid[..., 2]) == pytest.approx(np.hypot(suite.gps_error_v, suite.gps_multipath_v), rel=0.3)
    slow, long, short = suite.gps_error_time_s, suite.gps_multipath_time_s, suite.gps_smoothing_s
    for index, seconds in ((0, 1.0), (1, 30.0)):
        # a Gauss-Markov process through a first-order filter: (T exp(-t/T) - τ exp(-t/τ)) / (T - τ)
        alike = (long * np.exp(-seconds / long) - short * np.exp(-seconds / short)) / (long - short)
        variance = suite.gps_noise**2 + suite.gps_error_h**2 * (1.0 - np.exp(-seconds / slow))
        variance += suite.gps_multipath_h**2 * long / (long + short) * (1.0 - alike)
        moved = grid[:, index + 1, :2] - grid[:, index, :2]
        assert np.std(moved) == pytest.approx(np.sqrt(2.0 * variance), rel=0.25)
    assert np.std(np.array(velocities)[:, :2]) == pytest.approx(suite.gps_velocity_noise_h, rel=0.2)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2.0, np.pi, -2.0])
def test_the_magnetic_field_turns_against_the_yaw(yaw: float) -> None:
    craft = vehicle(yaw=yaw, suite=PERFECT)
    craft.advance(50)
    x, y, z = craft.sensors["mag_frd"]
    heading = np.arctan2(-y, x) + np.radians(PERFECT.mag_declination_deg)
    assert np.cos(heading - yaw) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm((x, y, z)) == pytest.approx(PERFECT.mag_strength)
    assert np.degrees(np.arcsin(z / np.linalg.norm((x, y, z)))) == pytest.approx(PERFECT.mag_inclination_deg)


def test_pressure_and_temperature_fall_with_the_altitude() -> None:
    low, high = vehicle(suite=PERFECT), vehicle(suite=PERFECT, position_ned=HIGH)
    low.advance(25)
    high.advance(25)
    difference = low.sensors["pressure_hpa"] - high.sensors["pressure_hpa"]
    assert difference == pytest.approx(100.0 * 0.1146, rel=0.02)  # ρ·g at 500 m, hPa per metre
    assert low.sensors["temperature_c"] == pytest.approx(15.0 - 0.0065 * ORIGIN[2], abs=0.01)


def test_barometer_noise_is_as_configured() -> None:
    craft = vehicle(suite=replace(PERFECT, baro_noise_hpa=0.012))
    assert np.std(record(craft, "pressure_hpa", 1500, 20)) == pytest.approx(0.012, rel=0.1)


def test_the_rangefinder_measures_along_the_body_axis_up_to_its_range() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -6.0), suite=PERFECT)
    craft.state["attitude"] = quat_from_euler(0.4, 0.0, 0.0)
    craft.advance(6)
    height = -craft.truth["position_ned"][2]
    assert craft.sensors["range_m"] == pytest.approx(height / np.cos(0.4), abs=0.01)
    craft = vehicle(position_ned=(0.0, 0.0, -12.5), suite=PERFECT)
    craft.advance(20)
    assert np.isnan(craft.sensors["range_m"])
    craft = vehicle(suite=replace(PERFECT, range_max_m=0.0))
    craft.advance(100)
    assert np.isnan(craft.sensors["range_m"])
    assert craft.sensors["range_time_us"] == 0


def test_an_invalid_suite_is_rejected() -> None:
    with pytest.raises(UsageError, match="imu_period_us"):
        Suite(imu_period_us=500)
    with pytest.raises(UsageError, match="gps_latency_us"):
        Suite(gps_latency_us=-1)
