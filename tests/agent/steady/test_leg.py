"""A leg is flown without standing still, fades when no decision comes, and is over when it is no longer valid."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.steady.leg import LEFT_M, REACHED_M, leg_to, steer
from foundation.protocol import SPEED_MAX, STEP_S

HERE = (0.0, 0.0, -2.0)
FAR = (20.0, 0.0, -2.0)
NONE = (0.0, 0.0, 0.0)

places = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-9.0, 0.0))


def speed(flown):
    return math.hypot(flown.setpoint.forward, flown.setpoint.up or 0.0)


@given(places, places, st.floats(0.0, 20.0), st.floats(0.0, 60.0), st.booleans(), st.booleans())
def test_nothing_is_flown_faster_or_longer_than_it_may_be(goal, position, period_s, now_s, level, careful):
    one = leg_to(goal, NONE, HERE, 0.0, period_s, level=level, careful=careful)
    assert one.due_s <= one.ends_s <= 2.0 * max(STEP_S, period_s)
    flown = steer(one, position, now_s)
    if now_s >= one.ends_s or math.dist(goal[:2], position[:2]) <= REACHED_M:
        assert flown is None
    else:
        assert flown is not None
        assert flown.valid_s == one.ends_s - now_s
        assert speed(flown) <= one.pace * one.fade(now_s) + 1e-9 <= SPEED_MAX + 1e-9
        assert (flown.setpoint.up is None) or not level


def test_it_goes_at_full_pace_until_a_decision_is_due_and_fades_to_nothing():
    one = leg_to(FAR, NONE, HERE, 10.0, 4.0, level=True)
    assert [one.fade(t) for t in (10.0, 14.0, 15.0, 16.0, 18.0, 99.0)] == [1.0, 1.0, 0.75, 0.5, 0.0, 0.0]
    flown = [steer(one, HERE, t) for t in (10.0, 14.0, 16.0)]
    assert [speed(each) for each in flown if each] == pytest.approx([1.2, 1.2, 0.6])
    assert steer(one, HERE, 18.0) is None


def test_a_step_that_covers_the_way_is_flown_as_slowly_as_the_papers():
    assert leg_to((2.4, 0.0, -2.0), NONE, HERE, 0.0, 0.5, level=True).pace == pytest.approx(2.4 / STEP_S)
    assert leg_to(FAR, NONE, HERE, 0.0, 0.5, level=True).pace == SPEED_MAX


def test_a_goal_that_moves_is_flown_after_and_one_that_was_reached_is_left_until_it_has_gone():
    one = leg_to(FAR, (0.0, 0.5, 0.0), HERE, 0.0, 8.0, level=True)
    assert one.goal(4.0) == pytest.approx((20.0, 2.0, -2.0))
    flown = steer(one, HERE, 4.0)
    assert flown is not None
    assert flown.seen.heading == pytest.approx(math.atan2(2.0, 20.0))
    near = (20.0 - 0.5 * (REACHED_M + LEFT_M), 0.0, -2.0)
    still = leg_to(FAR, NONE, HERE, 0.0, 8.0, level=True)
    assert steer(still, near, 4.0, 0.0) is not None
    assert steer(still, near, 4.0, 0.0, resting=True) is None


def test_a_goal_that_has_been_passed_turns_no_nose():
    one = leg_to((1.0, 0.0, -2.0), NONE, HERE, 0.0, 2.5, level=True)
    assert steer(one, (1.5, 0.1, -2.0), 1.0, 0.0) is None
    beside = steer(one, (0.5, 0.4, -2.0), 1.0, 0.0)
    assert beside is not None
    assert beside.seen.heading == 0.0
