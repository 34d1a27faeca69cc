"""Legs: the speed is constant until a decision is due, then fades, and is zero when the leg is no longer valid."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.steady.leg import FOLLOW_AGAIN_M, REACHED_M, leg_to, steer
from foundation.protocol import SPEED_MAX, STEP_S

HERE = (0.0, 0.0, -2.0)
FAR = (20.0, 0.0, -2.0)
NONE = (0.0, 0.0, 0.0)

places = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-9.0, 0.0))


def speed(command):
    return math.hypot(command.setpoint.forward, command.setpoint.up or 0.0)


@given(places, places, st.floats(0.0, 20.0), st.floats(0.0, 60.0), st.booleans(), st.booleans())
def test_a_leg_never_exceeds_its_speed_and_validity(goal, position, period_s, now_s, level, careful):
    leg = leg_to(goal, NONE, HERE, 0.0, period_s, level=level, careful=careful)
    assert leg.due_s <= leg.ends_s <= 2.0 * max(STEP_S, period_s)
    command = steer(leg, position, now_s)
    if now_s >= leg.ends_s or math.dist(goal[:2], position[:2]) <= REACHED_M:
        assert command is None
    else:
        assert command is not None
        assert command.valid_s == leg.ends_s - now_s
        assert speed(command) <= leg.pace * leg.fade(now_s) + 1e-9 <= SPEED_MAX + 1e-9
        assert (command.setpoint.up is None) or not level


def test_a_leg_has_full_pace_until_a_decision_is_due_and_then_fades_to_zero():
    leg = leg_to(FAR, NONE, HERE, 10.0, 4.0, level=True)
    assert [leg.fade(t) for t in (10.0, 14.0, 15.0, 16.0, 18.0, 99.0)] == [1.0, 1.0, 0.75, 0.5, 0.0, 0.0]
    commands = [steer(leg, HERE, t) for t in (10.0, 14.0, 16.0)]
    assert [speed(command) for command in commands if command] == pytest.approx([1.2, 1.2, 0.6])
    assert steer(leg, HERE, 18.0) is None


def test_a_short_leg_is_as_slow_as_the_papers_step():
    assert leg_to((2.4, 0.0, -2.0), NONE, HERE, 0.0, 0.5, level=True).pace == pytest.approx(2.4 / STEP_S)
    assert leg_to(FAR, NONE, HERE, 0.0, 0.5, level=True).pace == SPEED_MAX


def test_a_moving_goal_is_followed_and_a_resting_vehicle_ignores_a_near_goal():
    leg = leg_to(FAR, (0.0, 0.5, 0.0), HERE, 0.0, 8.0, level=True)
    assert leg.goal(4.0) == pytest.approx((20.0, 2.0, -2.0))
    command = steer(leg, HERE, 4.0)
    assert command is not None
    assert command.seen.heading == pytest.approx(math.atan2(2.0, 20.0))
    near = (20.0 - 0.5 * (REACHED_M + FOLLOW_AGAIN_M), 0.0, -2.0)
    still = leg_to(FAR, NONE, HERE, 0.0, 8.0, level=True)
    assert steer(still, near, 4.0, 0.0) is not None
    assert steer(still, near, 4.0, 0.0, resting=True) is None


def test_a_passed_goal_does_not_turn_the_vehicle():
    one = leg_to((1.0, 0.0, -2.0), NONE, HERE, 0.0, 2.5, level=True)
    assert steer(one, (1.5, 0.1, -2.0), 1.0, 0.0) is None
    beside = steer(one, (0.5, 0.4, -2.0), 1.0, 0.0)
    assert beside is not None
    assert beside.seen.heading == 0.0
