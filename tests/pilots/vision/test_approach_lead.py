"""Tests the lead ahead of a target that moves across. It is computed from the past actions alone."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import color_target as approach
from dronecats.pilots.vision import search
from dronecats.pilots.vision.color_detector import Detection
from dronecats.pilots.vision.ranging import BoundingBox, Range

STRIDE_M, CAMERA_M = 3.0, 0.5


def sighted(x, depth):
    return Detection(BoundingBox(x - 0.02, 0.0, x + 0.02, 0.05), Range(depth, depth + CAMERA_M, 0.5, 0.9), 0.9)


def past_stride(depth, aside=0.0):
    return PastAction("go", 700.0, 380.0, float(f"{approach.encode_lead(depth, aside):.4g}"))


@given(st.floats(6.0, 40.0), st.integers(-5, 4))
def test_a_depth_encodes_a_lead_and_changes_by_at_most_0_11_m(depth, digit):
    past = past_stride(depth, 0.03 * digit)
    if not search.count_wander_strides((past,)):
        assert approach.decode_lead((past,)) == pytest.approx(0.03 * digit)
    assert past.depth_m == pytest.approx(depth, abs=0.11)


def chase(across_m, start_m=16.0):
    """Fly long strides at a target that moves `across_m` right in each; return the leads and the final distance (m)."""
    thing, drone, heading, leads = [start_m, 0.0], [0.0, 0.0], 0.0, []
    past: tuple[PastAction, ...] = ()
    for _ in range(3):
        ahead, right = thing[0] - drone[0], thing[1] - drone[1]
        bearing = math.atan2(right, ahead) - heading
        depth = math.hypot(ahead, right) * math.cos(bearing)
        seen = sighted(0.5 * math.tan(bearing), depth)
        aside = approach.compute_lead(seen, past)
        leads.append(aside)
        heading += math.atan(2.0 * (0.5 * math.tan(bearing) + aside))
        past = (past_stride(depth, aside),)
        drone = [drone[0] + STRIDE_M * math.cos(heading), drone[1] + STRIDE_M * math.sin(heading)]
        thing[1] += across_m
    return leads, math.dist(thing, drone)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_pilot_aims_ahead_of_a_target_that_moves_across(way):
    leads, _ = chase(0.9 * way)
    assert leads[0] == 0.0  # one picture shows no motion
    assert all(lead * way > 0.02 for lead in leads[1:])
    assert max(map(abs, leads)) <= 0.15


def test_a_standing_target_is_aimed_at_directly():
    leads, off = chase(0.0)
    assert leads == [0.0, 0.0, 0.0]
    assert off == pytest.approx(16.0 - 3 * STRIDE_M)


def test_a_small_sideways_offset_gives_no_lead():
    assert approach.compute_lead(sighted(0.5 * 0.3 / 10.0, 10.0), (past_stride(13.0),)) == 0.0
    assert approach.compute_lead(sighted(0.5 * 0.6 / 10.0, 10.0), (past_stride(13.0),)) > 0.0


def test_the_offset_due_to_the_last_lead_is_not_motion_of_the_target():
    """After a stride aimed to its right, a standing target appears on the left."""
    before = past_stride(12.0, 0.09)
    seen = sighted(-0.09 * before.depth_m / 9.0, 9.0)
    assert approach.compute_lead(seen, (before,)) == 0.0
    expected = approach.expected_place((before,))
    assert expected is not None
    assert expected.matches(seen.box, seen.range)


def test_other_strides_encode_no_lead():
    strides = ((5.1, (700.0, 360.0)), (3.0, (700.0, 380.0)), (20.0, (700.0, 360.0)), (11.0, approach.UNSEEN_PX))
    for depth, point in strides:
        past = (PastAction("go", *point, depth),)
        assert approach.decode_lead(past) is None
        assert approach.compute_lead(sighted(0.2, 10.0), past) == 0.0
        assert approach.expected_place(past) is None
    assert approach.decode_lead(()) is None
    assert approach.decode_lead((past_stride(12.0), PastAction("finished"))) is None
