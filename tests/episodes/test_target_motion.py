"""Moving targets have a constant speed in three dimensions, stop at the end of their path, and turn gradually."""

import itertools
import json
import math
import os
import subprocess
import sys

import pytest

from episodes.records import catalogue
from episodes.records.record import Path3D, TargetRecord
from episodes.world.target import motion

CORNER = TargetRecord(
    "suv", "cyan", path=Path3D(((0.0, 0.0, 0.0), (10.0, 0.0, -0.5), (10.0, 20.0, 0.5), (4.0, 20.0, 0.5)), 0.3)
)


def test_speed_is_constant_in_three_dimensions() -> None:
    way = motion(CORNER)
    for t in (0.0, 7.0, 21.3, 50.0, 90.0):
        (a, _), (b, _) = way.pose(t), way.pose(t + 0.01)
        assert math.dist(a, b) == pytest.approx(0.003, rel=1e-6)


def test_a_target_reaches_each_waypoint_on_time_and_stays_at_the_last() -> None:
    assert CORNER.path is not None
    way, points = motion(CORNER), CORNER.path.waypoints_ned
    reached = 0.0
    for a, b in itertools.pairwise(points):
        reached += math.dist(a, b)
        assert way.pose(reached / 0.3)[0] == pytest.approx(b, abs=1e-9)
    assert way.pose(1e6) == way.pose(reached / 0.3)
    assert way.pose(-5.0) == way.pose(0.0)


def test_heading_follows_the_path_and_turns_gradually() -> None:
    way = motion(CORNER)
    assert way.pose(0.0)[1] == pytest.approx(0.0)
    assert way.pose(60.0)[1] == pytest.approx(math.pi / 2)
    assert abs(way.pose(1e6)[1]) == pytest.approx(math.pi)
    yaws = [way.pose(t / 10)[1] for t in range(1300)]
    steps = [abs(math.remainder(b - a, 2 * math.pi)) for a, b in itertools.pairwise(yaws)]
    assert max(steps) < math.radians(3.0)  # 30 °/s at most; a polyline would jump by 90°


def test_height_is_interpolated() -> None:
    assert motion(CORNER).pose(5.0 / 0.3)[0][2] == pytest.approx(-0.25, abs=2e-3)


def test_a_target_without_a_path_stands_still() -> None:
    still = motion(TargetRecord("suv", "cyan", None, (1.0, 2.0, 3.0), 90.0))
    assert still.pose(0.0) == still.pose(299.0) == ((1.0, 2.0, 3.0), math.radians(90.0))


@pytest.mark.parametrize(("asset", "longest_s"), [("bus", 40.0), ("suv", 20.0), ("person", 5.0)])
def test_the_time_to_turn_a_corner_depends_on_the_kind_of_target(asset: str, longest_s: float) -> None:
    way = motion(TargetRecord(asset, "red", path=Path3D(((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (20.0, 20.0, 0.0)), 0.3)))
    yaws = [way.pose(t / 10)[1] for t in range(1300)]
    turning = sum(math.radians(1.0) < yaw < math.radians(89.0) for yaw in yaws) / 10
    assert 0.25 * longest_s < turning <= longest_s


def test_processes_compute_the_same_poses_to_the_last_bit() -> None:
    """Agent, logger and verifier each compute the pose in their own process, with their own hash seed."""
    request = "residential-tracking-01", [0.0, 0.1, 17.3, 123.456, 299.99]
    program = (
        "import json, sys\nfrom episodes.records import catalogue\nfrom episodes.world.target import motion\n"
        "name, times = json.loads(sys.argv[1])\nway = motion(catalogue.load(name).target)\n"
        "print(json.dumps([[*p, y] for p, y in map(way.pose, times)]))"
    )
    outputs = [
        subprocess.run(
            [sys.executable, "-c", program, json.dumps(request)],
            capture_output=True, text=True, check=True, env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    ]  # fmt: skip
    way = motion(catalogue.load(request[0]).target)
    here = [[*place, yaw] for place, yaw in map(way.pose, request[1])]
    assert [json.loads(text) for text in outputs] == [here, here]
