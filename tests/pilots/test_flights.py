"""Flies the pilots on the shipped episodes by the agent's rules, without dynamics."""

import math
from dataclasses import replace

import pytest

from dronecats.pilots import scripted as blind
from dronecats.pilots.oracle import oracle
from dronecats.pilots.vision import pilot
from episodes.records import catalogue
from episodes.world import world as worlds
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler

SINGLE = [i for i in catalogue.QUICK if i in catalogue.ids() and "commanding" not in i]  # `episodes audit` flies all
SEEN = ["residential-approaching-01", "residential-searching-01", "residential-tracking-01"]
SEEN = [i for i in SEEN if i in SINGLE]


def oracle_of(world, camera):
    def decide(prompt, position, yaw, t):
        here, soon = world.target_centre(t), world.target_centre(t + 0.5)
        velocity = tuple((b - a) / 0.5 for a, b in zip(here, soon, strict=True))
        attitude = quat_from_euler(0.0, 0.0, yaw)
        return oracle.next_action(oracle.TrueState(position, yaw, attitude, here, velocity, camera))

    return decide


@pytest.mark.parametrize("episode", SINGLE)
def test_the_oracle_arrives_well_within_the_radius_and_declares_at_once(episode, fly_kinematic):
    world = worlds.World(catalogue.load(episode))
    flight = fly_kinematic(world, oracle_of(world, CameraModel()))
    assert flight.success
    assert [d for _, d, _ in flight.declared] == [pytest.approx(flight.distances[-1])]
    assert flight.distances[-1] <= 4.5  # the oracle's rule: 4 m, or 4.5 m if the shortest stride is too long
    assert flight.declared[0][0] < 90.0  # 48 m at 1.2 m/s, plus turns
    assert min(flight.clearances) > 0.5  # hits neither the ground nor the target


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, -135.0])
@pytest.mark.parametrize("up", [0.0, 6.0])
def test_the_oracle_arrives_from_any_heading_and_from_above(turn, up, fly_kinematic):
    record = catalogue.load(SINGLE[0])
    world = worlds.World(record)
    start = record.starts[0]
    north, east, down = start.position_ned
    start = replace(start, position_ned=(north, east, down - up), yaw_deg=start.yaw_deg + turn)
    flight = fly_kinematic(world, oracle_of(world, CameraModel()), start=start)
    assert flight.success
    assert min(flight.clearances) > 0.4


@pytest.mark.parametrize("episode", SEEN)
def test_vision_finds_the_target_in_rendered_frames_and_declares_within_reach(episode, fly_kinematic, eye):
    world = worlds.World(catalogue.load(episode))
    see = eye(world)

    def decide(prompt, position, yaw, t):
        return pilot.answer(prompt, [see(position, yaw, t)])

    flight = fly_kinematic(world, decide, cap_s=120.0)
    assert flight.success
    assert all(distance <= 5.0 for _, distance, _ in flight.declared)
    assert min(flight.clearances) > 0.4


def test_blind_never_declares(fly_kinematic):
    world = worlds.World(catalogue.load(SINGLE[0]))
    flight = fly_kinematic(world, lambda prompt, position, yaw, t: blind.answer(prompt, [b""]), cap_s=60.0)
    assert flight.declared == []
    assert not math.isclose(flight.distances[0], flight.distances[-1])  # it flies
