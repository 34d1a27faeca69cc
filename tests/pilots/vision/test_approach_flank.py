"""Tests the path past the end of a long target and along its flank."""

import json
import math

import pytest

from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import color_target as approach
from dronecats.pilots.vision.color_detector import Detection
from dronecats.pilots.vision.command import SIZES
from dronecats.pilots.vision.ranging import BoundingBox, Range

BUS, SUV = SIZES["bus"], SIZES["suv"]
CLAIM, TURN = PastAction("finished"), PastAction("rotate", angle_deg=-60.0)


def bus(left, right, depth=12.0, lean=0.05):
    return Detection(BoundingBox(left, -0.05, right, 0.1), Range(depth, depth + 0.5, 0.5, 0.9), 0.9, lean)


def end_on(middle=0.0, depth=12.0, lean=0.05):
    half = 0.5 * 0.5 * BUS.width_m / depth
    return bus(middle - half, middle + half, depth, lean)


def past_stride(reply):
    """Return a stride as the history shows it."""
    action = json.loads(reply)
    assert action["action"] == "go"
    return PastAction("go", 1.28 * action["point"][0], 0.72 * action["point"][1], action["depth_m"])


def test_only_a_near_long_target_seen_end_on_is_passed():
    assert approach.shows_long_end(end_on(), BUS)
    assert not approach.shows_long_end(bus(-0.21, 0.21), BUS)  # the whole flank is visible
    assert not approach.shows_long_end(end_on(depth=30.0), BUS)
    assert not approach.shows_long_end(bus(-0.04, 0.04), SUV)


@pytest.mark.parametrize("side", [1, -1])
def test_the_pilot_passes_on_the_side_of_the_flank_and_stays_there(side):
    first = past_stride(approach.stride_past_end(end_on(lean=0.05 * side), ()))
    assert side * (first.x_px - 640.0) > 1280.0 * 0.5 * 0.5 * BUS.width_m / 12.0
    assert first.y_px == 360.0
    assert first.depth_m >= 5.0  # at this depth or more, the stride has its full length
    assert approach.passing_side((first, CLAIM)) == side
    after = past_stride(approach.stride_past_end(end_on(lean=-0.05 * side, depth=8.0), (first,)))
    assert side * (after.x_px - 640.0) > 0.0


def test_the_path_keeps_clear_of_the_near_end():
    """From 12 m behind a bus, the path leaves more than 0.6 m beside its near end."""
    first = past_stride(approach.stride_past_end(end_on(), ()))
    near = 12.0 - 0.5 * BUS.length_m
    aside = (first.x_px / 1280.0 - 0.5) / 0.5 * near
    assert 0.5 * BUS.width_m + 0.6 < aside < 5.0


def test_a_target_cut_off_at_one_picture_edge_is_passed_on_the_other_side():
    assert past_stride(approach.stride_past_end(bus(-0.45, 0.5, 6.0, lean=0.1), ())).x_px < 640.0


def test_after_passing_the_pilot_turns_once_towards_the_target():
    right = past_stride(approach.stride_past_end(end_on(), ()))
    left = past_stride(approach.stride_past_end(end_on(lean=-0.05), ()))
    to_it = [json.loads(approach.turn_to_flank((way,)) or "{}")["angle_deg"] for way in (right, left)]
    assert to_it[0] < 0.0 < to_it[1]
    assert approach.turn_to_flank((right, TURN)) is None
    assert approach.has_turned_to_flank((right, TURN))
    assert not approach.has_turned_to_flank((left, TURN))
    assert not approach.has_turned_to_flank((right, CLAIM, TURN))
    assert approach.turn_to_flank((PastAction("go", 640.0, 360.0, 8.0),)) is None
    assert approach.turn_to_flank(()) is None


def test_at_a_flank_the_pilot_flies_along_it():
    right = past_stride(approach.stride_past_end(end_on(), ()))
    straight_on = approach.stride_along_flank(bus(-0.5, 0.2, 3.0), (right, CLAIM))
    assert past_stride(straight_on).x_px == pytest.approx(640.0)
    facing = (right, TURN, CLAIM)
    assert past_stride(approach.stride_along_flank(bus(-0.5, 0.2, 3.0), facing)).x_px < 100.0
    assert past_stride(approach.stride_along_flank(bus(-0.2, 0.5, 3.0), facing)).x_px > 1180.0
    assert approach.stride_along_flank(bus(-0.5, 0.5, 3.0), facing) is None
    assert approach.stride_along_flank(bus(-0.5, 0.2, 3.0), (CLAIM,)) is None


def test_every_stride_past_an_end_is_a_valid_action():
    for middle in (-0.45, -0.2, 0.0, 0.2, 0.45):
        for depth in (2.0, 5.0, 19.0):
            stride = past_stride(approach.stride_past_end(end_on(middle, depth), ()))
            assert 0.0 <= stride.x_px <= 1280.0
            assert math.isfinite(stride.depth_m)


def test_a_stride_beside_the_flank_is_less_to_the_side_than_one_before_the_end():
    """A target cut off on that side is beside the drone, so its visible edge is at the far end."""
    before = past_stride(approach.stride_past_end(end_on(), ()))
    before_end, beside = (
        past_stride(approach.stride_past_end(bus(left, 0.1, 6.0), (before,))) for left in (-0.3, -0.5)
    )
    assert before_end.x_px > beside.x_px > 640.0


def test_the_pilot_is_at_a_flank_that_fills_the_picture_or_that_it_passes():
    assert approach.is_at_flank(bus(-0.5, 0.5, 3.0), ())
    assert not approach.is_at_flank(bus(-0.5, 0.3, 3.0), ())
    assert approach.is_at_flank(bus(-0.5, 0.3, 3.0), (past_stride(approach.stride_past_end(end_on(), ())),))
