"""Collisions between the drones of a fleet."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.flight.sitl.collisions import CollisionReport, Encounters
from foundation.truth import hit_of, seconds_of
from tests.vehicles.fleet import spin, vehicle
from vehicles.airframe import names
from vehicles.encounter import DRONE, Ball, _first_touch, bounding_radius
from vehicles.multirotor import Multirotor
from vehicles.sensors import PERFECT

TICK = 10


def pair(name: str, apart: float, aside: float, speed: float) -> tuple[Multirotor, Multirotor]:
    """Return two hovering vehicles that fly at one another."""
    crafts = []
    for sign in (-1.0, 1.0):
        craft = vehicle(name, position_ned=(sign * apart / 2, sign * aside / 2, -60.0), suite=PERFECT)
        spin(craft, craft.airframe.hover_speed)
        craft.state["velocity"] = (-sign * speed, 0.0, 0.0)
        crafts.append(craft)
    return crafts[0], crafts[1]


def live(fleet: tuple[Multirotor, Multirotor], ticks: int) -> None:
    encounters = Encounters(fleet)
    for _ in range(ticks):
        encounters.part(TICK * 1e-3)
        for craft in fleet:
            craft.advance(TICK)
    encounters.part(TICK * 1e-3)


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("speed", [0.4, 1.0, 6.0])
def test_colliding_drones_do_not_pass_through_and_conserve_momentum(name: str, speed: float) -> None:
    apart = 2.0 * bounding_radius(vehicle(name)) + 0.1
    fleet = pair(name, apart, 0.02, speed)
    live(fleet, round(100 * 0.05 / speed) + 20)
    gap = fleet[1].state["position"][0] - fleet[0].state["position"][0]
    assert gap > 0.0
    if speed <= 1.0:
        assert fleet[1].state["velocity"][0] - fleet[0].state["velocity"][0] > -0.05  # no longer closing
    momentum = fleet[0].state["velocity"][0] + fleet[1].state["velocity"][0]
    assert abs(momentum) < 0.35 * speed  # tilted rotors add the rest
    for craft in fleet:
        assert craft.state["hits"] >= 1
        assert craft.state["hit_owner"] == DRONE
        assert np.isfinite(craft.state["attitude"]).all()
        assert craft.state["crashed"] == (2.0 * speed > 1.0)


def test_an_off_centre_contact_turns_both_drones_and_is_measured() -> None:
    fleet = pair("x500", 1.2, 0.3, 0.45)
    felt = 0.0
    encounters = Encounters(fleet)
    for _ in range(160):
        encounters.part(TICK * 1e-3)
        for craft in fleet:
            craft.advance(TICK)
        felt = max(felt, float(np.abs(fleet[0].truth["accel_frd"][:2]).max()))
    assert felt > 3.0
    assert all(abs(craft.state["rates"]).max() > 0.1 for craft in fleet)


def test_drones_that_stay_apart_do_not_affect_each_other() -> None:
    fleet, alone = pair("x500", 3.0, 0.0, 0.0), pair("x500", 3.0, 0.0, 0.0)
    live(fleet, 100)
    for craft in alone:
        craft.advance(100 * TICK)
    assert [craft.state.tobytes() for craft in fleet] == [craft.state.tobytes() for craft in alone]


def test_a_collision_is_reported_once_per_drone() -> None:
    fleet = pair("x500", 1.2, 0.0, 1.0)
    reports = [CollisionReport(craft) for craft in fleet]
    encounters, texts = Encounters(fleet), []
    for _ in range(80):
        encounters.part(TICK * 1e-3)
        for craft, report in zip(fleet, reports, strict=True):
            craft.advance(TICK)
            message = report.message()
            if message:
                texts.append(message.text)
    hits, ends = [hit_of(text) for text in texts[:2]], [seconds_of(text) for text in texts[2:]]
    assert all(hit and hit.crash and hit.what == "another drone" for hit in hits)
    assert len(ends) == 2
    assert all(seconds is not None and seconds < 0.1 for seconds in ends)


def test_a_lasting_contact_is_reported_once_per_drone() -> None:
    fleet = pair("x500", 2.0 * bounding_radius(vehicle("x500")) + 0.01, 0.0, 0.04)
    reports = [CollisionReport(craft) for craft in fleet]
    encounters, timed_hits = Encounters(fleet), []
    for tick in range(120):
        encounters.part(TICK * 1e-3)
        for sign, craft, report in zip((-1.0, 1.0), fleet, reports, strict=True):
            craft.advance(TICK)
            craft.state["velocity"] = (-sign * 0.04, 0.0, 0.0)  # as if their autopilots kept them there
            message = report.message()
            timed_hits += [(tick, hit_of(message.text))] if message else []
    assert not any(craft.state["hits"] for craft in fleet)
    assert [hit and hit.what for _, hit in timed_hits] == ["another drone"] * 2
    assert all(tick > 50 and hit and 0.0 < (hit.closing_speed or 0.0) < 0.15 for tick, hit in timed_hits)


COORDINATE, SPEED = st.floats(-3.0, 3.0), st.floats(-40.0, 40.0)


@given(
    st.tuples(COORDINATE, COORDINATE, COORDINATE),
    st.tuples(SPEED, SPEED, SPEED),
    st.floats(0.05, 0.6),
    st.floats(0.05, 0.6),
)
def test_balls_never_touch_if_may_touch_is_false(gap, speed, size, other_size):
    one = Ball(list(gap), list(speed), size)
    other = Ball([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], other_size)
    touches = _first_touch(gap, speed, size + other_size, TICK * 1e-3) >= 0.0
    assert one.may_touch(other, TICK * 1e-3) or not touches


def test_distant_balls_may_touch_only_after_enough_time():
    one, other = Ball([0.0] * 3, [0.0] * 3, 0.4), Ball([2.0, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.4)
    assert not one.may_touch(other, TICK * 1e-3)
    assert one.may_touch(other, 1.2)
