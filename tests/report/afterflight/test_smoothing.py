"""Tests the smoother on known paths: it removes short errors, and its standard deviation covers the others."""

import math

import numpy as np
import pytest

from dronecats.report.afterflight import CORRELATION_S, Estimates, smooth

STEP_S = 0.1


def path(t):
    """Return positions and velocities of a vehicle that flies steps of 1.2 m/s with stops: (n, 3) m and m/s."""
    speed = np.where((t % 5.0) < 3.0, 1.2, 0.0)
    speed = np.convolve(np.pad(speed, 10, mode="edge"), np.ones(11) / 11, "same")[10:-10]
    north = np.concatenate([[0.0], np.cumsum(speed[:-1])]) * STEP_S
    position = np.column_stack([north, 2.0 * np.sin(t / 10), np.full_like(t, -3.0)])
    return position, np.column_stack([speed, 0.2 * np.cos(t / 10), np.zeros_like(t)])


def estimated(seconds=60.0, *, wander_m=0.0, noise_m=0.05, std_m=1.0, seed=0, jump=None):
    """Return estimates on that path with a wandering error, and the true positions at the same times."""
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, STEP_S)
    position, velocity = path(t)
    error = np.empty((len(t), 3))
    error[0] = generator.normal(0.0, wander_m, 3)
    kept = math.exp(-STEP_S / CORRELATION_S)
    for k in range(1, len(t)):
        error[k] = kept * error[k - 1] + generator.normal(0.0, wander_m * math.sqrt(1.0 - kept**2), 3)
    positions = position + error + generator.normal(0.0, noise_m, position.shape)
    if jump is not None:
        positions[t >= seconds / 2] += jump
    reported = np.full(position.shape, std_m)
    velocities = velocity + generator.normal(0.0, 0.1, velocity.shape)
    return Estimates(t * 1e6 + 7e6, positions, velocities, reported, np.full(velocity.shape, 0.1)), position


def rms(values) -> float:
    return float(np.sqrt((values**2).sum(1).mean()))


def test_the_smoother_removes_noise() -> None:
    estimates, truth = estimated(noise_m=0.2)
    smoothed = smooth(estimates, estimates.time_us)
    relative = smoothed.position_ned - truth
    relative -= relative.mean(0)
    assert rms(relative) < 0.5 * rms(estimates.position_ned - truth)


def test_the_standard_deviation_covers_a_slowly_wandering_error() -> None:
    squared = []
    for seed in range(12):
        estimates, truth = estimated(wander_m=1.0, seed=seed)
        smoothed = smooth(estimates, estimates.time_us[::50])
        assert (smoothed.std_m > 0.7).all()  # a minute of reports does not average out a slow error
        squared.append(((smoothed.position_ned - truth[::50]) / smoothed.std_m) ** 2)
    assert 0.5 < np.mean(squared) < 1.6  # over many flights the mean is 1


def test_a_jump_of_the_estimate_is_smoothed() -> None:
    estimates, _ = estimated(jump=(2.0, 0.0, 0.0))
    assert np.abs(np.diff(estimates.position_ned[:, 0])).max() > 1.8
    smoothed = smooth(estimates, estimates.time_us)
    assert np.abs(np.diff(smoothed.position_ned[:, 0])).max() < 0.35


def test_a_gap_is_interpolated_with_a_larger_standard_deviation() -> None:
    estimates, truth = estimated(60.0)
    seconds = (estimates.time_us - 7e6) / 1e6
    has_report = (seconds < 20.0) | (seconds > 30.0)
    thinned = Estimates(*(getattr(estimates, name)[has_report] for name in Estimates.__slots__))
    smoothed = smooth(thinned, np.array([10.0, 25.0, 45.0]) * 1e6 + 7e6)
    assert len(smoothed.time_us) == 3
    assert smoothed.std_m[1, 0] > 2.0 * max(smoothed.std_m[0, 0], smoothed.std_m[2, 0])
    assert abs(smoothed.position_ned[1, 0] - truth[250, 0]) < 2.0 * smoothed.std_m[1, 0]


def test_a_better_receiver_gives_a_smaller_std_and_an_unreported_std_stays_nan() -> None:
    std = [smooth(estimated(std_m=s)[0], np.array([37e6])).std_m[0, 0] for s in (0.02, 0.5, 2.0)]
    assert std == sorted(std)
    assert std[0] < 0.06
    unreported = smooth(estimated(std_m=math.nan)[0], np.array([37e6]))
    assert np.isnan(unreported.std_m).all()
    assert np.isfinite(unreported.position_ned).all()


def test_times_outside_of_the_reports_are_omitted_and_times_between_are_interpolated() -> None:
    estimates, truth = estimated(10.0)
    smoothed = smooth(estimates, np.array([6.9e6, 7.0e6, 9.05e6, 99e6]))
    assert list(smoothed.time_us) == [7.0e6, 9.05e6]
    assert smoothed.position_ned[1, 0] == pytest.approx((truth[20, 0] + truth[21, 0]) / 2, abs=0.15)


def test_repeated_reports_do_not_lower_the_standard_deviation() -> None:
    few, _ = estimated(20.0)
    fine = np.linspace(few.time_us[0], few.time_us[-1], 5 * len(few.time_us))
    rows = np.searchsorted(few.time_us, fine, "right") - 1
    many = Estimates(fine, *(getattr(few, name)[rows] for name in Estimates.__slots__ if name != "time_us"))
    at = np.array([17e6])
    assert smooth(many, at).std_m[0, 0] == pytest.approx(smooth(few, at).std_m[0, 0], rel=0.05)
