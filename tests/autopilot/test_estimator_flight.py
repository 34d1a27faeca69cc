"""The estimator in flight, compared with the truth of the simulated physics."""

import numpy as np
import pytest

from autopilot.records import POSITION_TEST
from foundation.frames import GRAVITY
from tests.autopilot.core_flight import Flight


def errors(flight, start):
    """Return (position, velocity, attitude in degrees) errors of the rows from `start` on, each (n, 3).

    The first fixes set the origin of the local frame. Their error comes from the receiver, not from the filter's motion
    estimate, and is part of the position error.
    """
    position = flight.column("position", start) - flight.column("truth_position", start)
    velocity = flight.column("velocity", start) - flight.column("truth_velocity", start)
    attitude = flight.column("euler", start) - flight.column("truth_euler", start)
    return position, velocity, np.degrees((attitude + np.pi) % (2 * np.pi) - np.pi)


def rms(values):
    return np.sqrt((values**2).sum(axis=1).mean())


@pytest.mark.parametrize("yaw", [0.0, 2.5, -1.2])
def test_converges_from_rest_within_ten_seconds(yaw):
    flight = Flight(seed=3, yaw=yaw)
    start = flight.run(10.0)
    estimate = flight.estimate
    flags = [estimate[f"{name}_valid"] for name in ("attitude", "velocity", "position", "altitude")]
    assert flags == [1, 1, 1, 1]
    assert estimate["origin_set"] == 1
    position, velocity, attitude = errors(flight, start)
    assert np.abs(attitude[-50:]).max() < 3.0  # the compass has its hard-iron error on the ground
    assert np.abs(velocity[-50:]).max() < 0.15
    assert np.abs(position[-50:, :2]).max() < 2.0
    assert np.linalg.norm(estimate["accel_frd"] - [0.0, 0.0, -GRAVITY]) < 0.2


def test_attitude_and_position_are_invalid_after_half_a_second():
    flight = Flight()
    flight.run(0.5)
    assert flight.estimate["attitude_valid"] == 0
    assert flight.estimate["position_valid"] == 0


@pytest.mark.parametrize("seed", [5, 6])
def test_errors_are_small_over_two_minutes_of_random_flight(seed):
    flight = Flight(seed=seed).hover(12.0)
    rng = np.random.default_rng(seed)
    start = len(flight.rows)
    for _ in range(30):
        z = flight.estimate["position_ned"][2]
        climb = 1.0 if z < -20.0 else -1.0 if z > -8.0 else rng.uniform(-1.0, 1.0)
        flight.ask(velocity_ned=(*rng.uniform(-5.0, 5.0, 2), climb), yaw_rate=rng.uniform(-1.0, 1.0))
        flight.run(3.0)
    flight.ask(position_ned=(0.0, 0.0, -12.0), yaw=1.0)
    flight.run(30.0)
    position, velocity, attitude = errors(flight, start)
    assert rms(attitude) < 1.0
    assert rms(velocity) < 0.15
    assert rms(position[:, :2]) < 1.0
    assert rms(position) < 1.5  # includes the receiver's altitude error at the origin
    assert flight.core.filter_state["resets"] == 0
    assert flight.core.filter_state["rejected"] <= 5


def test_a_short_jump_of_the_receiver_is_rejected():
    flight = Flight(seed=8).hover()
    before = flight.estimate["position_ned"].copy()
    flight.upset["gps_north_deg"] = 40.0 / 111_195.0  # 40 m
    flight.run(3.0)
    assert 25.0 < flight.estimate["test_ratio"][POSITION_TEST] < 400.0  # 40 m over a gate of 5 × (0.7 to 1.2 m)
    assert np.linalg.norm(flight.estimate["position_ned"] - before) < 1.0
    assert flight.estimate["position_valid"] == 1
    flight.upset["gps_north_deg"] = 0.0
    flight.run(2.0)
    assert flight.estimate["test_ratio"][POSITION_TEST] < 1.0
    assert flight.core.filter_state["resets"] == 0
    assert np.linalg.norm(flight.estimate["position_ned"] - before) < 1.5


def test_a_lasting_jump_is_accepted_after_the_timeout():
    flight = Flight(seed=8).hover()
    before = flight.estimate["position_ned"].copy()
    flight.upset["gps_north_deg"] = 40.0 / 111_195.0
    flight.run(6.0)
    assert flight.estimate["position_valid"] == 0
    flight.run(2.5)
    assert flight.core.filter_state["resets"] == 1
    assert flight.estimate["position_valid"] == 1
    assert flight.estimate["position_ned"][0] - before[0] > 30.0


def test_losing_the_receiver_invalidates_position_and_velocity_but_not_attitude():
    flight = Flight(seed=4).hover()
    flight.upset["gps_fix_type"] = 1
    flight.run(6.0)
    estimate = flight.estimate
    assert (estimate["position_valid"], estimate["velocity_valid"]) == (0, 0)
    assert (estimate["attitude_valid"], estimate["altitude_valid"]) == (1, 1)
    assert estimate["position_std_h"] > 0.5
    flight.upset["gps_fix_type"] = -1
    flight.sensors["gps_fix_type"] = 3
    start = flight.run(10.0)
    assert (estimate["position_valid"], estimate["velocity_valid"]) == (1, 1)
    position, velocity, _ = errors(flight, start)
    assert np.abs(velocity[-100:]).max() < 0.5
    assert np.abs(position[-100:, :2]).max() < 3.0


def test_nan_samples_are_skipped():
    flight = Flight(seed=2).hover()
    flight.upset["imu_nan_until_us"] = flight.sensors["time_us"] + 10_000
    flight.run(3.0)
    assert 5 <= flight.core.filter_state["bad_samples"] <= 10
    assert flight.core.filter_state["restarts"] == 0
    assert np.isfinite(flight.estimate["attitude"]).all()
    assert abs(flight.vehicle.truth["position_ned"][2] + 10.0) < 2.0


def test_lasting_nan_samples_invalidate_the_attitude_until_they_end():
    flight = Flight(seed=2).hover()
    flight.upset["imu_nan_until_us"] = flight.sensors["time_us"] + 200_000
    flight.run(0.15)
    assert flight.estimate["attitude_valid"] == 0
    assert flight.estimate["time_us"] == pytest.approx(flight.sensors["time_us"], abs=5_000)
    flight.run(0.2)
    assert flight.estimate["attitude_valid"] == 1


def test_the_filter_realigns_after_a_nan_covariance():
    flight = Flight(seed=2)
    flight.run(10.0)
    flight.core.covariance[:] = np.nan
    flight.run(0.1)
    assert flight.core.filter_state["restarts"] == 1
    flight.run(6.0)
    assert flight.estimate["attitude_valid"] == 1
    assert flight.estimate["position_valid"] == 1
    assert np.isfinite(flight.core.covariance).all()


def test_same_seed_same_bytes():
    def fly():
        flight = Flight(seed=11)
        flight.run(10.0)
        flight.ask(velocity_ned=(1.0, 0.0, -1.0), yaw_rate=0.3)
        flight.run(2.0)
        return flight.estimate.tobytes(), flight.actuators.tobytes(), flight.core.covariance.tobytes()

    assert fly() == fly()
