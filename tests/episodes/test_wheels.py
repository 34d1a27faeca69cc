"""Every wheel of a driving target touches the ground, both in the pictures and in the judge's geometry."""

import math
from dataclasses import replace

import numpy as np
import pytest

from episodes.authoring.check import sight
from episodes.camera.renderer.renderer import Renderer
from episodes.maps.scene import turn
from episodes.records import catalogue
from episodes.world.target import motion
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.frames import quat_from_euler, quat_to_euler
from foundation.protocol import CAP_S

DRIVING = {
    "van": "residential-tracking-01",
    "pickup": "residential-tracking-07",
    "bus": "residential-search-and-track-01",
    "cyclist": "residential-search-and-track-08",
    "service_cart": "campus-search-and-track-02",
}
TIMES_S = np.arange(0.0, CAP_S, 1.0)


@pytest.fixture(scope="module", params=list(DRIVING.values()), ids=list(DRIVING))
def world(request):
    return World(catalogue.load(request.param))


def test_every_wheel_of_a_driving_target_touches_the_ground_at_all_times(world):
    points = world.target.mesh.vertices.astype(float)
    low = points[points[:, 2] > points[:, 2].max() - 0.01]
    for t_s in TIMES_S:
        place, turned = world.moved(float(t_s))[world.target_id]
        for n, e, d in low @ turn(turned).T + np.array(place):
            assert abs(d - world.ground_down(n, e)) <= 0.03, t_s


STANDING = ("residential-commanding-05", "residential-searching-04", "v1-residential-commanding-09")


@pytest.mark.parametrize("name", STANDING)
def test_wheels_of_standing_targets_touch_the_ground_and_pixel_counts_match(name):
    world, camera = World(catalogue.load(name)), CameraModel(640, 360)
    leaning = [one for one in world.target_and_lookalikes if one.attitude is not None]
    assert leaning
    for one in leaning:
        points = one.mesh.vertices.astype(float)
        low = points[points[:, 2] > points[:, 2].max() - 0.01]
        for n, e, d in low @ turn(one.turned).T + np.array(one.position_ned):
            assert abs(d - world.ground_down(n, e)) <= 0.03
    (north, east, down), level = world.target_centre(0.0), quat_from_euler(0.0, 0.0, 0.0)
    eye = (north - 7.0, east, down - 0.5)
    counted = sight.patch(world.target, world.solids, eye, level, camera)
    ids = Renderer(world.scene, camera).render(camera_pose(eye, level, camera)).ids
    assert counted.pixels == pytest.approx(int((ids == world.target_id).sum()), rel=0.01)
    assert counted.pixels > 1000


def test_the_centre_of_a_target_stays_on_its_path_on_a_slope(world):
    """The judge's reference point stays the same, except its height on a crest or in a dip."""
    low, high = world.target.mesh.vertices.min(axis=0), world.target.mesh.vertices.max(axis=0)
    for t_s in TIMES_S:
        place, yaw = motion(world.record.target).pose(float(t_s))
        level = turn(yaw) @ ((low + high) / 2) + np.array(place)
        upright, heading = world.target_upright(float(t_s))  # for hits on its box
        middle = turn(heading) @ ((low + high) / 2) + np.array(upright)
        assert math.dist(middle, world.target_centre(float(t_s))) < 1e-3
        off = np.array(world.target_centre(float(t_s))) - level
        assert math.hypot(off[0], off[1]) < 1e-3
        assert abs(off[2]) < 0.1


def test_two_wheelers_do_not_roll_and_walkers_stand_upright():
    rider, walker = (World(catalogue.load(name)) for name in (DRIVING["cyclist"], "campus-tracking-01"))
    tilts = [quat_to_euler(_attitude(rider, float(t)))[:2] for t in TIMES_S]
    assert max(abs(roll) for roll, _ in tilts) < 1e-9
    assert max(abs(pitch) for _, pitch in tilts) > math.radians(2)
    assert all(walker.target_pose(float(t)) == motion(walker.record.target).pose(float(t)) for t in TIMES_S)


def test_the_judge_counts_the_drawn_pixels_of_a_target_on_a_slope():
    world, camera = World(catalogue.load(DRIVING["van"])), CameraModel(640, 360)
    steepest = max(TIMES_S, key=lambda t: abs(quat_to_euler(_attitude(world, float(t)))[1]))
    place, turned = world.target_pose(float(steepest))
    assert abs(quat_to_euler(_attitude(world, float(steepest)))[1]) > math.radians(4)
    north, east, down = world.target_centre(float(steepest))
    eye, level = (north - 7.0, east, down - 0.5), quat_from_euler(0.0, 0.0, 0.0)
    assert isinstance(turned, tuple)
    target = replace(world.target, position_ned=place, attitude=turned)
    counted = sight.patch(target, world.solids, eye, level, camera)
    ids = Renderer(world.scene, camera).render(camera_pose(eye, level, camera), world.moved(float(steepest))).ids
    drawn = int((ids == world.target_id).sum())
    assert drawn > 3000
    assert counted.pixels == pytest.approx(drawn, rel=0.01)


def _attitude(world, t_s):
    turned = world.target_pose(t_s)[1]
    return turned if isinstance(turned, tuple) else quat_from_euler(0.0, 0.0, turned)
