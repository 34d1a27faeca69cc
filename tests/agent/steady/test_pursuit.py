"""The filter against its closed form, and what begins another track."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dronecats.agent.steady import pursuit
from dronecats.agent.steady.pursuit import Pursuit, process_noise, sighting_noise, transition

LENS = (0.0, 0.0, -2.0)


def seen(places, times, lens=LENS):
    one = Pursuit()
    told = [one.see(t, lens, (float(p[0]), float(p[1]), float(p[2]))) for t, p in zip(times, places, strict=True)]
    return one, told


@settings(max_examples=30)
@given(st.lists(st.floats(0.5, 9.0), min_size=2, max_size=6), st.integers(0, 2**31))
def test_it_is_the_least_squares_over_all_sightings_and_the_prior(gaps, seed):
    """Information form over the whole past: the state that explains sightings, prior and accelerations best."""
    times = np.cumsum([0.0, *gaps])
    draw = np.random.default_rng(seed)
    places = [np.array([15.0 + 0.2 * t, 3.0 - 0.1 * t, -1.0]) + draw.normal(0.0, 0.3, 3) for t in times]
    one, told = seen(places, times)
    assert told == [False] + [True] * len(gaps)
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
            # an acceleration of one number an axis: G a, of which Q = σ² G Gᵀ has no inverse, so a little is added
            q = np.linalg.inv(process_noise(dt) + 1e-9 * np.eye(6))
            both = np.hstack([-step, np.eye(6)])
            weight[6 * k - 6 : 6 * k + 6, 6 * k - 6 : 6 * k + 6] += both.T @ q @ both
    state = np.linalg.solve(weight, right)[-6:]
    assert one._filter is not None
    assert one._filter.x[:, 0] == pytest.approx(state, abs=2e-3)


def test_the_process_noise_is_that_of_an_acceleration_that_lasts():
    q = process_noise(2.0)
    assert q[0, 0] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**4 / 4.0)
    assert q[0, 3] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**3 / 2.0)
    assert q[3, 3] == pytest.approx(pursuit.ACCELERATION**2 * 2.0**2)
    assert q[0, 1] == q[0, 4] == 0.0


def test_a_depth_is_worse_than_a_direction():
    noise = sighting_noise(LENS, (10.0, 0.0, -2.0))
    assert noise[0, 0] == pytest.approx((pursuit.ALONG_M + 10.0 * pursuit.ALONG) ** 2)
    assert noise[1, 1] == noise[2, 2] == pytest.approx((pursuit.ACROSS_M + 10.0 * pursuit.ACROSS) ** 2)


def test_what_goes_on_is_carried_on_through_a_long_decision():
    times = np.arange(0.0, 40.0, 4.0)
    one, _ = seen([(12.0, -3.0 + 0.3 * t, 0.0) for t in times], times)
    now = one.at(44.0)
    assert now is not None
    assert now.velocity_ned == pytest.approx((0.0, 0.3, 0.0), abs=0.06)
    assert now.place_ned == pytest.approx((12.0, -3.0 + 0.3 * 44.0, 0.0), abs=0.7)


def test_of_what_stands_still_hardly_a_velocity_is_believed():
    """Depths that are off by a fifth look like motion: of the estimate what may as well be noise is taken away."""
    believed, raw, times = [], [], np.arange(0.0, 24.0, 4.0)
    for seed in range(20):
        draw = np.random.default_rng(seed)
        one, _ = seen([np.array([12.0, 0.0, 0.0]) + draw.normal(0.0, [2.4, 0.5, 0.3]) for _ in times], times)
        now = one.at(24.0)
        assert now is not None
        assert one._filter is not None
        believed.append(np.hypot(*now.velocity_ned[:2]))
        raw.append(np.hypot(*one._filter.x[3:5, 0]))
    assert np.mean(believed) < 0.5 * np.mean(raw)
    assert np.median(believed) < 0.03


def test_a_velocity_is_told_of_the_third_sighting_at_the_soonest():
    one, _ = seen([(12.0, 0.0, 0.0), (12.0, 3.0, 0.0)], [0.0, 4.0])
    now = one.at(4.0)
    assert now is not None
    assert now.velocity_ned == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("time_s", "place"),
    [(16.0, (12.0, 9.0, 0.0)), (16.0, (200.0, 0.0, 0.0)), (8.0, (12.0, 0.0, 0.0)), (300.0, (12.0, 0.0, 0.0))],
    ids=["aside", "far behind", "an older picture", "long after"],
)
def test_what_does_not_belong_to_the_track_begins_another(time_s, place):
    one, _ = seen([(12.0, 0.0, 0.0)] * 4, [0.0, 4.0, 8.0, 12.0])
    assert one.sightings == 4
    assert not one.see(time_s, LENS, place)
    now = one.at(time_s)
    assert one.sightings == 1
    assert now is not None
    assert now.place_ned == place


def test_nothing_is_believed_of_what_has_not_been_seen_for_long():
    one, _ = seen([(12.0, 0.0, 0.0)], [0.0])
    assert one.at(pursuit.FORGET_S) is not None
    assert one.at(pursuit.FORGET_S + 0.1) is None
    assert Pursuit().at(0.0) is None


@settings(max_examples=30)
@example([(0.0, 1), (0.0, 1), (1e-200, 1)])  # a speed whose square is 0
@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.integers(1, 4)), min_size=1, max_size=5))
def test_of_several_words_on_one_picture_the_last_counts_and_once(pictures):
    """As if the others had not been said, be they of the same thing, of another, or the first of all."""
    often, once = Pursuit(), Pursuit()
    for k, (east, words) in enumerate(pictures):
        for word in range(words, 0, -1):
            often.see(4.0 * k, LENS, (12.0 + 30.0 * (word - 1), east, 0.0))
        once.see(4.0 * k, LENS, (12.0, east, 0.0))
        assert often.sightings == once.sightings
        assert often.at(4.0 * k + 1.0) == once.at(4.0 * k + 1.0)
