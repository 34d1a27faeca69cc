"""The command `dronecats sitl`: its camera port and the start positions of its vehicles."""

import math
import re

import numpy as np
import pytest

from dronecats.cli import options
from dronecats.cli.main import main
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl import compile_ahead, simulator_process
from dronecats.flight.sitl.episode_world import load_world
from dronecats.flight.sitl.simulation import SimulatedVehicle, build
from episodes.records import catalogue
from episodes.world.obstacles import obstacles

OPEN_M = 30.0


class StartError(Exception):
    """Raised when a process would start, after its configuration is recorded."""


def configuration(monkeypatch, tmp_path, *words):
    """Return the SimulatorConfig that a command line produces."""
    configs = []

    def start(config):
        configs.append(config)
        raise StartError

    monkeypatch.setattr(simulator_process, "Simulator", start)
    with pytest.raises(StartError):
        main(["sitl", "--state", str(tmp_path), *words])
    return configs[0]


def camera_configuration(monkeypatch, tmp_path, *words):
    """Return the CameraConfig that a command line produces."""
    configs = []

    class Simulated:
        def __init__(self, config):
            pass

        def ready(self):
            return {"truth": 1}

        def close(self):
            pass

    def start(supervisor, kind, config):
        configs.append(config)
        raise StartError

    monkeypatch.setattr(simulator_process, "Simulator", Simulated)
    monkeypatch.setattr(Supervisor, "start", start)
    with pytest.raises(StartError):
        main(["sitl", "--state", str(tmp_path), *words])
    return configs[0]


def test_the_camera_uses_the_documented_port_unless_a_port_is_set(monkeypatch, tmp_path):
    for words, port, or_next_free in (
        (["--camera"], 8080, True),
        (["--camera", "--instance", "2"], 8082, True),
        (["--camera", "9000", "--instance", "2"], 9000, False),
        (["--camera", "0"], 0, False),
    ):
        config = camera_configuration(monkeypatch, tmp_path, *words)
        assert (config.port, config.or_next_free) == (port, or_next_free), words
    assert options.PAGE_PORT - 8080 >= 10  # the camera ports of ten simulators are below the page ports


def test_an_invalid_camera_port_is_rejected(tmp_path, capsys):
    for port in ("-1", "70000"):
        assert main(["sitl", "--state", str(tmp_path), f"--camera={port}"]) == 2
        assert re.search(f"--camera {port} .*65535", capsys.readouterr().err)


def to_the_segment(point, a, b):
    along = b - a
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - a) * along).sum(axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(point - a - share[:, None] * along, axis=1)


def test_ten_vehicles_without_an_episode_start_on_open_level_ground(monkeypatch, tmp_path):
    config = configuration(monkeypatch, tmp_path, "--count", "10")
    world = load_world(config.episode)
    solid = obstacles(world.scene)
    assert solid.moving is None
    a, b, c = np.moveaxis(np.asarray(solid.corners, np.float64).reshape(-1, 3, 3)[:, :, :2], 1, 0)
    vehicles = build(SimulatedVehicle, world, config).vehicles
    assert len(vehicles) == 10
    for vehicle in vehicles:
        place = vehicle.plant.truth["position_ned"][:2]
        gap = min(to_the_segment(place, *edge).min() for edge in ((a, b), (b, c), (c, a)))
        assert gap > OPEN_M
        below = world.ground_down(*place)
        for angle in np.radians(np.arange(0.0, 360.0, 10.0)):
            for away in (1.0, 5.0, 10.0, 20.0, OPEN_M):
                north, east = place + away * np.array([math.cos(angle), math.sin(angle)])
                assert abs(world.ground_down(north, east) - below) < 0.01 * away


def test_episode_option_sets_the_start(monkeypatch, tmp_path):
    assert configuration(monkeypatch, tmp_path, "--episode", "campus-searching-01").episode == "campus-searching-01"


def test_open_ground_is_loadable_but_is_not_a_benchmark_episode():
    assert catalogue.OPEN_GROUND not in catalogue.all_ids()
    assert not catalogue.is_shipped(catalogue.load(catalogue.OPEN_GROUND))


@pytest.mark.parametrize("is_compiled", [True, False])
def test_compiling_is_announced_only_when_it_is_necessary(monkeypatch, tmp_path, capsys, is_compiled):
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda: is_compiled)
    configuration(monkeypatch, tmp_path)
    assert ("compil" in capsys.readouterr().out) is not is_compiled
