"""Optics options of the simulated camera change its pictures, but no measurement."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.cli.main import main
from dronecats.flight.sitl.camera import WorldCamera, rates_between
from dronecats.flight.sitl.episode_world import origin
from dronecats.flight.spec.flight import CAMERA, look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from episodes.camera.optics.file import load
from episodes.camera.optics.options import Exposure, Optics, Rain, Sensor
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler, quat_integrate
from foundation.mavlink import Packer
from foundation.truth import TruthSample, truth_message

SMALL = CameraModel(160, 90)


def sample(time_us, attitude):
    return TruthSample(0, time_us, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), attitude)


RATE = st.floats(-5.0, 5.0)


@given(st.tuples(RATE, RATE, RATE), st.floats(-3.0, 3.0))
def test_the_rates_between_two_attitudes_are_recovered(rates, yaw):
    before = quat_from_euler(0.1, -0.2, yaw)
    after = quat_integrate(before, tuple(0.02 * w for w in rates))
    assert rates_between(sample(0, before), sample(20_000, after)) == pytest.approx(rates, abs=1e-4)


def test_samples_too_far_apart_or_at_the_same_time_give_zero_rates():
    turned = quat_from_euler(0.0, 0.0, 1.0)
    assert rates_between(sample(0, (1.0, 0.0, 0.0, 0.0)), sample(2_000_000, turned)) == (0.0, 0.0, 0.0)
    assert rates_between(sample(5, turned), sample(5, turned)) == (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load(catalogue.DEFAULT))


def bus(world, time_us, yaw, drone=0):
    spawn = world.scene.spawn_ned
    place = (spawn[0], spawn[1], spawn[2] - 3.0)
    zero = (0.0, 0.0, 0.0)
    message = truth_message(time_us, place, zero, quat_from_euler(0.0, 0.0, yaw), zero, zero, origin(world))
    return Packer(drone + 1, 51).pack(message)


def frames(world, optics, turn, seed=0, count=2):
    """Return the first pictures and announcements of a vehicle that turns by `turn` (rad) in 20 ms."""
    announced: list[bytes] = []
    camera = WorldCamera(world, SMALL, announced.append, optics=optics, seed=seed)
    camera.feed(bus(world, 1_000_000, 0.3))
    camera.feed(bus(world, 1_020_000, 0.3 + turn))
    return [camera.newest().image_rgb for _ in range(count)], announced


def test_a_turn_blurs_the_frame_and_does_not_change_its_announcement(world):
    plain, announced = frames(world, None, 0.02)
    still, _ = frames(world, Optics(exposure=Exposure(0.05, 6)), 0.0)
    blurred, announced_blurred = frames(world, Optics(exposure=Exposure(0.05, 6)), 0.02)
    sharpness = [np.abs(np.diff(p[0].astype(float), axis=1)).mean() for p in (plain, still, blurred)]
    assert sharpness[2] < 0.9 * sharpness[0]
    assert sharpness[1] > 0.9 * sharpness[0]
    assert announced == announced_blurred


def test_a_turn_also_blurs_frames_of_drones_beyond_those_of_the_record(world):
    camera = WorldCamera(world, SMALL, lambda data: None, optics=Optics(exposure=Exposure(0.05, 6)))
    for drone, turn in ((1, 0.0), (2, 0.02)):
        camera.feed(bus(world, 1_000_000, 0.3, drone) + bus(world, 1_020_000, 0.3 + turn, drone))
    still, turned = (np.abs(np.diff(camera.newest(k).image_rgb.astype(float), axis=1)).mean() for k in (1, 2))
    assert turned < 0.9 * still


def test_a_request_for_a_past_frame_does_not_change_the_blur_of_the_newest(world):
    def newest(asks_for_the_past):
        camera = WorldCamera(world, SMALL, lambda data: None, optics=Optics(exposure=Exposure(0.05, 6)))
        for k in range(10):
            camera.feed(bus(world, 1_000_000 + 20_000 * k, 0.3))
        if asks_for_the_past:
            camera.at(1_020_000)
        camera.feed(bus(world, 1_200_000, 0.32))
        return camera.newest().image_rgb

    np.testing.assert_array_equal(newest(True), newest(False))


def test_two_frames_of_one_instant_differ_only_by_their_noise(world):
    (first, second), _ = frames(world, Optics(sensor=Sensor(2000.0, 5.0)), 0.0)
    assert (first != second).mean() > 0.5
    assert np.abs(first.astype(float) - second.astype(float)).mean() < 15.0
    np.testing.assert_array_equal(frames(world, Optics(sensor=Sensor(2000.0, 5.0)), 0.0)[0][1], second)


@pytest.mark.parametrize("optics", [Optics(sensor=Sensor(2000.0, 5.0)), Optics(rain=Rain(100.0))])
def test_noise_and_rain_drops_depend_on_the_seed(world, optics):
    (one,), (other,), (again,) = (frames(world, optics, 0.0, seed, count=1)[0] for seed in (1, 2, 2))
    assert (one != other).any()
    np.testing.assert_array_equal(again, other)
    plain = [frames(world, None, 0.0, seed, count=1)[0][0] for seed in (1, 2)]
    np.testing.assert_array_equal(*plain)


def test_two_drones_at_the_same_place_have_different_noise():
    fleet, seen = World(catalogue.load("residential-commanding-01")), []
    for drone in (0, 1):
        camera = WorldCamera(fleet, SMALL, lambda data: None, optics=Optics(sensor=Sensor(2000.0, 5.0)))
        camera.feed(bus(fleet, 1_000_000, 0.3, drone))
        seen.append(camera.newest(drone).image_rgb)
    assert (seen[0] != seen[1]).mean() > 0.5
    assert np.abs(seen[0].astype(float) - seen[1].astype(float)).mean() < 15.0


def test_a_run_records_its_optics(tmp_path):
    file = tmp_path / "hazy.toml"
    file.write_text("[haze]\ndensity_per_m = 0.02\n")
    flight = look_up(FlightSpec(pilot="oracle", simulated=Simulated(optics=load(file).as_dict())))
    assert json.loads(json.dumps(flight.camera))["optics"]["haze"]["density_per_m"] == 0.02
    assert look_up(FlightSpec(pilot="oracle", simulated=Simulated())).camera == CAMERA


@pytest.mark.parametrize("verb", [["fly", "--sitl"], ["sitl", "--camera"]])
def test_an_invalid_optics_file_is_rejected_before_anything_starts(verb, tmp_path, capsys):
    file = tmp_path / "broken.toml"
    file.write_text("[haze]\ndensity_per_m = -1\n")
    assert main([*verb, "--optics", str(file)]) == 2
    assert "density_per_m" in capsys.readouterr().err
