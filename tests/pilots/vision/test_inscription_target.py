"""Tests how a drone of a fleet chooses its own candidate and acts on it, from the history alone."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import boards, inscription_target, plates
from dronecats.pilots.vision.command import SIZES
from dronecats.pilots.vision.division import Candidate, GroundPoint
from foundation.protocol import FINISHED, GO, HISTORY_LENGTH, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M, THINK

CAR = SIZES["car"]


def at(right_m: float, ahead_m: float) -> Candidate:
    """Return a candidate at a place, with the apparent size of a car there."""
    half = 320.0 * 2.3 / ahead_m
    x = 320.0 + 320.0 * right_m / ahead_m
    return Candidate(
        round(x - half), 180, round(x + half), 180 + round(320.0 * 1.4 / ahead_m), GroundPoint(right_m, ahead_m)
    )


def past_go(depth_m, y_px=360.0):
    return PastAction(GO, x_px=640.0, y_px=y_px, depth_m=depth_m)


def test_the_own_candidate_is_the_destination_of_the_last_stride():
    far, passed = at(0.4, 17.0), at(-3.5, 6.0)
    assert inscription_target.own_candidate([passed, far], (past_go(20.0),)) is far
    assert inscription_target.own_candidate([passed], (past_go(20.0),)) is None


def test_a_turn_away_from_a_read_candidate_selects_another_one():
    read, other = at(0.0, 5.0), at(3.0, 12.0)
    assert inscription_target.own_candidate([read, other], (PastAction(ROTATE, angle_deg=60.0),)) is other
    assert inscription_target.own_candidate([read, other], (PastAction(ROTATE, angle_deg=50.0),)) is read


def test_a_full_history_without_strides_is_settled():
    for past, is_settled in (
        ((PastAction(THINK),) * HISTORY_LENGTH, True),
        ((PastAction(ROTATE, angle_deg=50.0),) * HISTORY_LENGTH, True),
        ((PastAction(THINK),) * (HISTORY_LENGTH - 1), False),
        ((past_go(8.0),) + (PastAction(THINK),) * (HISTORY_LENGTH - 1), False),
    ):
        assert inscription_target.is_settled(past) is is_settled, past


def test_a_single_drone_goes_to_the_named_place_or_the_nearest():
    for place, index in ((None, 1), (0, 0), (2, 2), (-1, 2), (7, 1)):
        view = [at(-8.0, 20.0), at(0.0, 12.0), at(9.0, 18.0)]
        assert inscription_target.first_destination(view, place) == view[index].spot, place


@given(st.floats(-0.9, 0.9), st.floats(3.4, 45.0))
def test_a_stride_never_ends_in_the_board(side, ahead_m):
    action = json.loads(boards.stride_towards(GroundPoint(side * ahead_m, ahead_m)))
    depth = action["depth_m"]
    stride = min(STRIDE_MAX_M, depth) if depth >= 5.0 else 0.6 * depth
    assert stride >= STRIDE_MIN_M
    assert ahead_m - stride > 1.2


@given(st.floats(0.0, math.pi / 2.0), st.sampled_from((-1, 1)), st.floats(-8.0, 8.0), st.floats(8.0, 20.0))
def test_the_vantage_point_is_beyond_the_chosen_end_of_the_car(heading, end, right_m, ahead_m):
    middle = GroundPoint(right_m, ahead_m)
    place = plates.vantage_point(middle, heading, end, CAR)
    off = math.hypot(place.right_m - right_m, place.ahead_m - ahead_m)
    assert off == pytest.approx(0.5 * CAR.length_m + plates.VANTAGE_OFF_M)
    # nearer to the drone than the middle, or just beside it
    assert place.distance_m <= math.hypot(middle.distance_m, off) + 1e-6
    if heading > 0.1:
        assert math.copysign(1.0, place.bearing_rad - middle.bearing_rad) == end


def test_the_heading_of_a_car_follows_from_its_visible_width():
    def seen(wide_m, depth_m=10.0):
        return plates.heading_rad(320.0 * wide_m / depth_m, depth_m, CAR, 320.0)

    assert seen(CAR.width_m) == 0.0
    assert math.degrees(seen(CAR.length_m)) == pytest.approx(
        90.0 - math.degrees(math.atan(CAR.width_m / CAR.length_m)), abs=22
    )
    assert seen(2.5) < seen(3.5) < seen(4.5)


def test_a_drone_declares_four_times_and_no_more():
    """The drone declares twice, flies one stride nearer, declares twice more, and waits. The plate may be wrong."""
    car, past, actions = at(0.0, 4.0), [past_go(2.5), PastAction(FINISHED)], []
    for _ in range(5):
        action = json.loads(plates._declare_again(car, tuple(past[-HISTORY_LENGTH:])))
        actions.append(action["action"])
        past.append(PastAction(action["action"], y_px=360.0, depth_m=action.get("depth_m", 0.0)))
        if actions[-1] == GO:
            past.append(PastAction(FINISHED))  # like `decide` after a stride to a plate that was read
            actions.append(FINISHED)
    assert actions[:5] == [FINISHED, GO, FINISHED, FINISHED, THINK]


def test_after_the_stride_to_a_read_plate_the_drone_declares_without_seeing_it():
    assert plates.was_plate_read((past_go(2.2),))
    assert not plates.was_plate_read((past_go(3.2),))
    assert json.loads(plates.decide_unseen((past_go(2.2),)))["action"] == FINISHED


def test_the_drone_turns_to_the_side_of_a_lost_car():
    for y_px, sign in ((373.0, 1.0), (347.0, -1.0)):
        assert math.copysign(1.0, json.loads(plates.decide_unseen((past_go(8.0, y_px),)))["angle_deg"]) == sign, y_px
