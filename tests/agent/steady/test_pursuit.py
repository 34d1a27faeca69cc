"""The pursuit filter agrees with its closed form, and outlying sightings begin a new track."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dronecats.agent.steady import pursuit
from dronecats.agent.steady.pursuit import Pursuit, process_noise, sighting_noise, transition

LENS = (0.0, 0.0, -2.0)


def seen(places, times, lens=LENS):
    track = Pursuit()
    continued = [
        track.see(t, lens, (float(p[0]), float(p[1]), float(p[2]))) for t, p in zip(times, places, strict=True)
    ]
    return track, continued


@settings(max_examples=30)
@given(st.lists(st.floats(0.5, 9.0), min_size=2, max_size=6), st.integers(0, 2**31))
def test_the_filter_equals_least_squares_over_all_sightings_and_the_prior(gaps, seed):
    """Reference in information form: the state that best explains all sightings, the prior and the accelerations."""
    times = np.cumsum([0.0, *gaps])
    draw = np.random.default_rng(seed)
    places = [np.array([15.0 + 0.2 * t, 3.0 - 0.1 * t, -1.0]) + draw.normal(0.0, 0.3, 3) for t in times]
    track, continued = seen(places, times)
    assert continued == [False] + [True] * len(gaps)
    n = len(times)
    weight, right = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    see, v0 = np.eye(3, 6), np.diag([0.0] * 3 + [1.0 / pursuit.SPEED_STD**2] * 3)
    weight[:6, :6] += v0
    for k, (t, place) in enumerate(zip(times, places, strict=True)):
        r = np.linalg.inv(sighting_noise(LENS, tuple(place)))
        weight[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += see.T @ r @ see
        right[6 * k : 6 * k + 6] += see.T @ r @ place
        if k:
            step, dt = transition(t - times[k - 1]), t - times[k - 1]
            # one acceleration per axis: G a. Its Q = σ² G Gᵀ has no inverse, so a small term is added.
            q = np.linalg.inv(process_noise(dt) + 1e-9 * np.eye(6))
            both = np.hstack([-step, np.eye(6)])
            weight[6 * k - 6 : 6 * k + 6, 6 * k - 6 : 6 * k + 6] += both.T @ q @ both
    state = np.linalg.solve(weight, right)[-6:]
    assert track._track is not None
    assert track._track.state[:, 0] == pytest.approx(state, abs=2e-3)


def test_process_noise_is_that_of_a_piecewise_constant_acceleration():
    q = process_noise(2.0)
    assert q[0, 0] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**4 / 4.0)
    assert q[0, 3] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**3 / 2.0)
    assert q[3, 3] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**2)
    assert q[0, 1] == q[0, 4] == 0.0


def test_sighting_noise_along_and_across_the_line_of_sight():
    noise = sighting_noise(LENS, (10.0, 0.0, -2.0))
    assert noise[0, 0] == pytest.approx((pursuit.ALONG_M + 10.0 * pursuit.ALONG) ** 2)
    assert noise[1, 1] == noise[2, 2] == pytest.approx((pursuit.ACROSS_M + 10.0 * pursuit.ACROSS) ** 2)


def test_steady_motion_is_predicted_through_a_long_decision():
    times = np.arange(0.0, 40.0, 4.0)
    track, _ = seen([(12.0, -3.0 + 0.3 * t, 0.0) for t in times], times)
    now = track.at(44.0)
    assert now is not None
    assert now.velocity_ned == pytest.approx((0.0, 0.3, 0.0), abs=0.06)
    assert now.place_ned == pytest.approx((12.0, -3.0 + 0.3 * 44.0, 0.0), abs=0.7)


def test_a_stationary_target_has_almost_no_velocity():
    """Depth errors of 20 % look like motion. The part of the estimate that can be noise is subtracted."""
    believed, raw, times = [], [], np.arange(0.0, 24.0, 4.0)
    for seed in range(20):
        draw = np.random.default_rng(seed)
        track, _ = seen([np.array([12.0, 0.0, 0.0]) + draw.normal(0.0, [2.4, 0.5, 0.3]) for _ in times], times)
        now = track.at(24.0)
        assert now is not None
        assert track._track is not None
        believed.append(np.hypot(*now.velocity_ned[:2]))
        raw.append(np.hypot(*track._track.state[3:5, 0]))
    assert np.mean(believed) < 0.5 * np.mean(raw)
    assert np.median(believed) < 0.03


def test_velocity_is_zero_until_the_third_sighting():
    track, _ = seen([(12.0, 0.0, 0.0), (12.0, 3.0, 0.0)], [0.0, 4.0])
    now = track.at(4.0)
    assert now is not None
    assert now.velocity_ned == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("time_s", "place"),
    [(16.0, (12.0, 9.0, 0.0)), (16.0, (200.0, 0.0, 0.0)), (8.0, (12.0, 0.0, 0.0)), (300.0, (12.0, 0.0, 0.0))],
    ids=["aside", "far behind", "an older picture", "long after"],
)
def test_sightings_outside_of_the_track_begin_a_new_one(time_s, place):
    track, _ = seen([(12.0, 0.0, 0.0)] * 4, [0.0, 4.0, 8.0, 12.0])
    assert track.sightings == 4
    assert not track.see(time_s, LENS, place)
    now = track.at(time_s)
    assert track.sightings == 1
    assert now is not None
    assert now.place_ned == place


def test_a_target_not_seen_for_long_has_no_estimate():
    track, _ = seen([(12.0, 0.0, 0.0)], [0.0])
    assert track.at(pursuit.FORGET_S) is not None
    assert track.at(pursuit.FORGET_S + 0.1) is None
    assert Pursuit().at(0.0) is None


@settings(max_examples=30)
@example([(0.0, 1), (0.0, 1), (1e-200, 1)])  # a speed whose square is 0
@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.integers(1, 4)), min_size=1, max_size=5))
def test_only_the_last_sighting_of_one_image_counts(pictures):
    """Earlier replies on the same image have no effect, also on another target and at the start of the track."""
    often, once = Pursuit(), Pursuit()
    for k, (east, words) in enumerate(pictures):
        for word in range(words, 0, -1):
            often.see(4.0 * k, LENS, (12.0 + 30.0 * (word - 1), east, 0.0))
        once.see(4.0 * k, LENS, (12.0, east, 0.0))
        assert often.sightings == once.sightings
        assert often.at(4.0 * k + 1.0) == once.at(4.0 * k + 1.0)
