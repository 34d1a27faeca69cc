"""The chase camera's view, compared with an independent projection by the object id of each pixel."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dronecats.report.recorded.tracks import FlightTrack
from dronecats.view.film.chase import BOOM_M, SHORTEST_M, FilmStage, chase, chase_lens, obstacles_of
from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.scene import Instance
from episodes.world.visibility import Solids
from foundation.camera import CameraPose
from foundation.frames import quat_from_euler, quat_yaw
from foundation.run_folder.reading import read

LENS = chase_lens(640, 360)


@pytest.fixture(scope="module")
def stage(flight):
    made = FilmStage(flight, LENS)
    yield made
    made.close()


@pytest.fixture(scope="module")
def way(flight):
    return chase(flight.tracks[0], flight.end_s, obstacles_of(flight))


def seen_at(pose, place):
    """Return the pixel (x, y) and the depth (m) of a position, computed independently."""
    w, x, y, z = pose.attitude
    ahead, right, down = Rotation.from_quat([x, y, z, w]).inv().apply(np.subtract(place, pose.position_ned))
    focal = 320.0 / math.tan(math.radians(LENS.hfov_deg) / 2.0)
    return 320.0 + focal * right / ahead, 180.0 + focal * down / ahead, ahead


def test_the_target_is_drawn_at_its_logged_position(flight_folder, flight, stage):
    targets = [
        (pose.t, pose.target_ned) for pose in read(flight_folder).poses if pose.target_ned and pose.t <= flight.end_s
    ]
    assert math.dist(targets[0][1], targets[-1][1]) > 1.5
    for t, target in targets[::3]:
        eye = (target[0] - 7.0, target[1] - 1.0, target[2] - 3.0)
        camera = CameraPose(eye, quat_from_euler(0.0, math.radians(-20.0), 0.0))
        ids = stage.view(camera, t).ids
        rows, columns = np.nonzero(ids == flight.world.target_id)
        x, y, depth = seen_at(camera, target)
        reach = 640.0 / depth * 0.35  # a third of a metre
        assert len(rows) > 100
        assert abs((columns.min() + columns.max()) / 2 - x) < reach
        assert abs((rows.min() + rows.max()) / 2 - y) < reach


def test_the_drone_is_in_every_picture_at_its_position(flight, stage, way):
    for t in np.linspace(0.0, flight.end_s, 7):
        pose, place = way.at(float(t)), flight.tracks[0].at(float(t)).position_ned
        x, y, depth = seen_at(pose, place)
        assert 64 < x < 576
        assert 36 < y < 324
        assert SHORTEST_M * 0.9 < depth < BOOM_M * 1.3
        rows, columns = np.nonzero(stage.view(pose, float(t)).ids == stage.ids[0])
        assert len(rows) > 60
        assert abs(columns.mean() - x) < 0.3 * 640 / depth
        assert abs(rows.mean() - y) < 0.3 * 640 / depth


def test_the_chase_camera_moves_smoothly(flight, way):
    times = np.arange(0.0, flight.end_s, 1 / 30)
    eyes = np.array([way.at(float(t)).position_ned for t in times])
    speeds = np.diff(eyes, axis=0) * 30
    assert np.abs(speeds).max() < 8.0
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.8  # m/s from one picture to the next


def test_walls_never_block_the_chase_camera():
    """A drone flies away from one wall and past another. The line from camera to drone never meets a wall."""
    t = np.linspace(0.0, 20.0, 400)
    places = np.column_stack([0.6 + 0.3 * t, np.zeros(400), np.full(400, -2.0)])
    track = FlightTrack(t, places, np.zeros_like(places), np.tile((1.0, 0.0, 0.0, 0.0), (400, 1)), level=True)
    grey = materials.plain("wall", (120, 120, 120), 0.0)
    walls = {
        1: ((-0.4, -6.0), (-0.2, 6.0)),  # north and east of two corners, m; 6 m high
        2: ((2.0, 0.9), (5.0, 1.1)),
    }
    things = [
        Instance(k, f"wall-{k}", "wall", g.assemble([g.box((n0, -e1, 0.0), (n1, -e0, 6.0), grey)]), (0.0, 0.0, 0.0))
        for k, ((n0, e0), (n1, e1)) in walls.items()
    ]
    way = chase(track, 20.0, Solids(things))
    for s in np.arange(0.0, 20.0, 0.05):
        eye, drone = np.array(way.at(float(s)).position_ned), np.array(track.at(float(s)).position_ned)
        for share, ((n0, e0), (n1, e1)) in itertools.product(np.linspace(0.0, 1.0, 60), walls.values()):
            north, east, down = eye + share * (drone - eye)
            assert not (n0 <= north <= n1 and e0 <= east <= e1 and -6.0 <= down <= 0.0), (s, eye)
    # far from both walls, the camera keeps its full distance
    assert math.dist(way.at(19.0).position_ned, track.at(19.0).position_ned) > 0.9 * BOOM_M
    # near a wall, the camera goes around it instead of up to it
    assert math.dist(way.at(1.0).position_ned, track.at(1.0).position_ned) > 1.2


def test_the_chase_camera_turns_more_slowly_than_the_drone():
    t = np.linspace(0.0, 10.0, 400)
    yaw = np.radians(np.clip(60.0 * (t - 4.0), 0.0, 90.0))  # a quarter turn in a second and a half
    places = np.tile((0.0, 0.0, -2.0), (400, 1))
    attitude = np.array([quat_from_euler(0.0, 0.0, angle) for angle in yaw])
    track = FlightTrack(t, places, np.zeros_like(places), attitude, level=True)
    far = g.assemble([g.box((90.0, 90.0, 0.0), (91.0, 91.0, 1.0), materials.plain("far", (120, 120, 120), 0.0))])
    way = chase(track, 10.0, Solids([Instance(1, "far", "wall", far, (0.0, 0.0, 0.0))]))
    turned = np.unwrap([quat_yaw(way.at(float(s)).attitude) for s in np.arange(0.0, 10.0, 1 / 30)])
    rates = np.degrees(np.diff(turned)) * 30
    assert np.abs(rates).max() < 45.0
    assert math.degrees(turned[-1] - turned[0]) == pytest.approx(90.0, abs=3.0)
