"""The first hit of a ray, compared with a search over all triangles, and the rangefinder that uses it."""

import math

import numpy as np
import pytest

from foundation.frames import quat_from_euler
from tests.vehicles.fleet import vehicle
from tests.vehicles.test_collisions import CAR, block, solid
from vehicles.sensors import PERFECT
from vehicles.solids import first_solid

MOST = 12.0


def nearest(triangles, eye, way):
    """Return the least distance along the ray, solved for each triangle separately; inf without a hit."""
    shortest = math.inf
    for a, b, c in triangles:
        matrix = np.column_stack([b - a, c - a, -way])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        u, v, distance = np.linalg.solve(matrix, eye - a)
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= distance <= MOST:
            shortest = min(shortest, distance)
    return shortest


def cast(craft, eye, way):
    return first_solid(craft.solids, craft.kernel_args[3], int(craft.state["time_us"]), tuple(eye), tuple(way), MOST)


def test_the_first_hit_equals_a_search_over_all_triangles():
    rng = np.random.default_rng(3)
    stones = [block(tuple(rng.uniform(-9.0, 9.0, 3) - (0, 0, 8)), tuple(rng.uniform(0.2, 2.0, 3))) for _ in range(120)]
    scene = solid(*stones)
    craft, triangles = vehicle(obstacles=scene), scene.corners.reshape(-1, 3, 3).astype(float)
    hits = 0
    for case in range(600):
        eye = rng.uniform(-14.0, 14.0, 3) - (0, 0, 8)
        way = np.eye(3)[case % 3] * (1.0 if case % 2 else -1.0) if case < 60 else rng.normal(size=3)
        way = way / np.linalg.norm(way)
        expected = nearest(triangles, eye, way)
        assert cast(craft, eye, way) == pytest.approx(expected, abs=1e-4)
        hits += math.isfinite(expected)
    assert hits > 100


def test_a_ray_hits_a_moving_box_at_its_current_position():
    craft = vehicle(obstacles=solid(block((40.0, 0.0, -1.0), (1.0, 1.0, 1.0)), moving=CAR))
    solids = craft.solids
    solids["box"], solids["box_half"] = 1, CAR.half_m
    solids["box_centre"], solids["box_velocity"], solids["box_yaw"] = (3.0, 0.0, -0.8), (2.0, 0.0, 0.0), math.pi / 2
    craft.state["time_us"] = int(solids["box_time_us"]) + 500_000  # it is now 1 m further north, turned by 90°
    assert cast(craft, (4.0, 0.0, -5.0), (0.0, 0.0, 1.0)) == pytest.approx(5.0 - 1.6)
    assert cast(craft, (0.0, 0.0, -0.8), (1.0, 0.0, 0.0)) == pytest.approx(4.0 - 0.9)
    assert cast(craft, (4.0, 2.1, -5.0), (0.0, 0.0, 1.0)) == math.inf


@pytest.mark.parametrize(("north", "roll_deg", "expected"), [(0.0, 0.0, 2.0), (5.0, 0.0, 4.0), (0.0, 20.0, 2.128)])
def test_the_rangefinder_measures_the_distance_to_the_roof_or_the_ground(north, roll_deg, expected):
    roof = solid(block((0.0, 0.0, -1.0), (3.0, 3.0, 1.0)))
    craft = vehicle(obstacles=roof, position_ned=(north, 0.0, -4.0), suite=PERFECT)
    craft.state["attitude"] = quat_from_euler(math.radians(roll_deg), 0.0, 0.0)
    craft.advance(20)  # its period, in which it falls by 2 mm
    assert craft.sensors["range_m"] == pytest.approx(expected, abs=0.01)
