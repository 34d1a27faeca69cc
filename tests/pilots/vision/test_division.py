"""Tests the assignment of things to drones, a pure function of the pictures."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.pilots.vision.division import GroundPoint, assign_things


def back(spots):
    """Return the ground position of the spot of each drone. Every drone must have a spot."""
    assert None not in spots
    return [(s.right_m + x, s.ahead_m + z) for s, (x, z) in zip(spots, SQUARE, strict=True)]


SQUARE = ((0.0, 0.0), (2.0, 0.0), (0.0, -2.0), (2.0, -2.0))  # positions of the drones: right, ahead


def seen_from(place, things):
    """Return the things as seen by a drone that looks ahead from a place."""
    return [GroundPoint(x - place[0], z - place[1]) for x, z in things]


@st.composite
def apart(draw, most=4):
    """Draw positions of things at least 5.5 m apart, 8 … 34 m ahead and well within the picture."""
    places: list[tuple[float, float]] = []
    for _ in range(draw(st.integers(1, most))):
        ahead = draw(st.floats(8.0, 34.0))
        place = (draw(st.floats(-0.8, 0.8)) * ahead, ahead)
        if all(math.dist(place, other) >= 5.5 for other in places):
            places.append(place)
    return places


@settings(deadline=None)
@given(apart())
def test_drones_get_different_things_if_there_are_enough(things):
    spots = assign_things([seen_from(place, things) for place in SQUARE])
    places = back(spots)
    nearest = [min(range(len(things)), key=lambda k: math.dist(place, things[k])) for place in places]
    assert all(math.dist(place, things[k]) < 1e-6 for place, k in zip(places, nearest, strict=True))
    assert len(set(nearest)) == min(len(SQUARE), len(things))


@settings(deadline=None)
@given(apart(), st.integers(0, 3), st.data())
def test_drones_do_not_all_get_one_thing_if_a_drone_misses_a_thing(things, blind, data):
    views = [seen_from(place, things) for place in SQUARE]
    if len(things) > 1:
        views[blind].pop(data.draw(st.integers(0, len(things) - 1)))
    spots = assign_things(views)
    places = back(spots)
    # a drone that sees few things may get a wrong spot, but with two things not all drones go to one
    assert len(things) == 1 or len({min(things, key=lambda t: math.dist(t, place)) for place in places}) > 1


def test_spots_are_assigned_from_the_left_in_picture_order():
    things = [(6.0, 20.0), (-9.0, 25.0), (0.0, 15.0), (12.0, 22.0)]
    spots = assign_things([seen_from(place, things) for place in SQUARE])
    bearings = [math.atan2(right, ahead) for right, ahead in back(spots)]
    assert bearings == sorted(bearings)


def test_small_distance_errors_do_not_change_the_assignment():
    things = [(-12.0, 24.0), (-4.0, 16.0), (3.0, 26.0), (10.0, 14.0)]
    wrong = (1.04, 0.97, 1.02, 0.96)
    views = [
        [GroundPoint(s.right_m * w, s.ahead_m * w) for s in seen_from(p, things)]
        for p, w in zip(SQUARE, wrong, strict=True)
    ]
    spots = assign_things(views)
    nearest = [min(range(4), key=lambda k: math.dist(place, things[k])) for place in back(spots)]
    assert nearest == [0, 1, 2, 3]


def test_without_things_no_drone_gets_a_spot():
    assert assign_things([[], [], [], []]) == [None] * 4
