"""An episode begins only at its record's start pose, with an autopilot that has a position and attitude estimate."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.run.truth import TrueStart, estimate_faults, start_faults
from dronecats.flight.sitl.episode_world import Placement, load_world
from foundation.errors import InfrastructureError
from foundation.frames import quat_from_euler
from foundation.truth import TruthSample
from hil.link.link import Link
from hil.link.telemetry import VehicleState
from tests.hil.link.scripted_vehicle import ScriptedVehicle

HOME = (47.4, 8.5, 488.0)
HERE = Placement(HOME, (0.0, 0.0, 0.0), 0.0)
PLACE, YAW = (3.0, -4.0, -1.8), 2.0


def true(*, place=(0.0, 0.0, 0.0), euler=(0.0, 0.0, YAW)):
    return TruthSample(0, 0, place, (0.0, 0.0, 0.0), quat_from_euler(*euler))


def believed(*, place=(0.0, 0.0, 0.0), euler=(0.0, 0.0, YAW)):
    return VehicleState(position_ned=place, euler=euler, origin=HOME)


@pytest.mark.parametrize(
    ("estimate", "word"),
    [
        ({"euler": (0.0, 0.0, YAW + math.radians(105.0))}, "heading is 105.0°"),
        ({"euler": (0.0, 0.0, YAW - math.radians(5.2))}, "heading is 5.2°"),
        ({"euler": (math.radians(2.5), math.radians(2.5), YAW)}, "level is 3.5°"),
        ({"place": (1.5, 1.5, 0.0)}, "position is 2.12 m"),
    ],
)
def test_an_estimate_beyond_its_limit_is_reported(estimate, word):
    [fault] = estimate_faults(believed(**estimate), true(), HERE)
    assert word in fault


def test_an_estimate_within_its_limits_has_no_fault():
    near = believed(place=(1.2, -1.2, 30.0), euler=(0.03, -0.03, YAW + math.radians(4.8)))
    assert estimate_faults(near, true(), HERE) == []
    assert estimate_faults(VehicleState(), true(), HERE) == []


def test_an_estimate_is_placed_on_the_map_before_the_comparison():
    moved = Placement(HOME, (100.0, 50.0, 0.0), math.pi / 2)
    turned = true(place=(100.0, 60.0, 0.0), euler=(0.0, 0.0, YAW + math.pi / 2))
    assert estimate_faults(believed(place=(10.0, 0.0, 0.0)), turned, moved) == []
    assert estimate_faults(believed(place=(10.0, 0.0, 0.0)), turned, HERE) != []


@pytest.mark.parametrize(
    ("place", "yaw", "words"),
    [
        (PLACE, YAW, []),
        ((3.5, -4.5, -1.2), YAW + math.radians(4.5), []),
        ((3.0, -4.0, -0.36), YAW, ["1.44 m too low"]),
        ((3.0, -4.0, -3.9), YAW, ["2.10 m too high"]),
        ((4.2, -4.0, -1.8), YAW, ["1.20 m off"]),
        (PLACE, YAW + math.radians(16.6), ["nose is 16.6°"]),
    ],
)
def test_a_start_beyond_its_limits_is_reported(place, yaw, words):
    faults = start_faults(true(place=place, euler=(0.1, 0.0, yaw)), PLACE, YAW)
    assert len(faults) == len(words)
    assert all(word in fault for word, fault in zip(words, faults, strict=True))


def test_a_vehicle_with_a_wrong_heading_estimate_is_not_armed():
    world, vehicle = load_world("v1-residential-searching-01"), ScriptedVehicle()
    vehicle.armed, vehicle.landed, vehicle.yaw = False, True, 0.0
    link = Link(vehicle.transport())
    stage: Any = SimpleNamespace(tap=lambda feed: lambda: None)
    check: Any = TrueStart(stage, world)
    check._truth = SimpleNamespace(of=lambda drone: true(euler=(0.0, 0.0, math.radians(105.0))))
    with pytest.raises(InfrastructureError, match=r"does not begin.*heading is 105\.0° off"):
        ascend([link], [StartOffset((0.0, 0.0, -2.5), None)], lambda line: None, check.check_estimates)
    assert 400 not in [command for command, *_ in vehicle.commands]  # MAV_CMD_COMPONENT_ARM_DISARM
