"""Compares each effect with its physical law, on scenes whose picture is known."""

import dataclasses
import hashlib
import math

import cv2
import numpy as np
import pytest

from episodes.camera.optics.camera import (
    BentLens,
    Codes,
    OpticalRenderer,
    VehicleMotion,
    noisy,
    pinhole_rays,
    wide_camera,
)
from episodes.camera.optics.options import Exposure, Haze, LensModel, Optics, Rain, Sensor
from episodes.camera.optics.weather import drops_per_m3, fall_speed, streaks
from episodes.camera.renderer import Renderer
from episodes.camera.renderer.sky import WHITE
from episodes.maps.scene import Instance, Material, Mesh, Scene, Sun
from foundation.camera import CameraModel, camera_pose
from foundation.frames import quat_from_euler
from foundation.terrain import FLAT

CAMERA = CameraModel(160, 90, 90.0, (0.0, 0.0, 0.0))
STILL = VehicleMotion(0.0, (0.0, 0.0, -2.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
SUN = Sun((-0.6, 0.0, -0.8))


def wall(north, width, height, color=(0.02, 0.02, 0.02), centre=(0.0, -2.0)):
    """Return the mesh and position of an upright board at `north` m that faces south, with its middle at `centre`.

    `centre` is (east, down) in m.
    """
    (e, d), w, h = centre, width / 2, height / 2
    v = np.array([(0, e - w, d + h), (0, e + w, d + h), (0, e + w, d - h), (0, e - w, d - h)], np.float32)
    normals = np.tile(np.array((-1.0, 0.0, 0.0), np.float32), (4, 1))
    triangles = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    mesh = Mesh(v, normals, np.zeros((4, 2), np.float32), triangles, np.zeros(2, np.int32), (Material("w", color),))
    return mesh, (north, 0.0, 0.0)


def scene_of(*walls, movable=False):
    things = [Instance(k + 1, f"w{k}", "wall", mesh, at, movable=movable) for k, (mesh, at) in enumerate(walls)]
    return Scene("test", tuple(things), FLAT, SUN, 47.0, 8.0, 400.0)


def nothing(_):
    return {}


def picture(scene, optics, motion=STILL, frame_id=1, camera=CAMERA, moved=nothing, threads=1):
    renderer = OpticalRenderer(scene, camera, optics, threads)
    try:
        return renderer.picture(motion, moved, (frame_id,))
    finally:
        renderer.close()


BOARD = scene_of(wall(10.0, 6.0, 6.0), wall(40.0, 30.0, 12.0, (0.5, 0.1, 0.1)))
EVERYTHING = Optics(
    LensModel(k1=-0.1, p1=0.01, vignetting=0.6), Sensor(2000.0, 5.0), Exposure(0.02, 3), Haze(0.01), Rain(20.0), 3
)


def test_codes_survive_conversion_to_light_and_back():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    both = Codes()
    np.testing.assert_array_equal(both.shown(both.light(codes)), codes)
    assert (np.diff(both.light(codes)[..., 0].ravel()) > 0).all()


def test_without_options_the_picture_equals_the_plain_render():
    pose = camera_pose(STILL.position_ned, STILL.attitude, CAMERA)
    plain = Renderer(BOARD, CAMERA, 1).render(pose).rgb
    np.testing.assert_array_equal(picture(BOARD, Optics()), plain)


def test_the_bytes_depend_on_frame_and_seed_but_not_on_threads():
    made = [
        hashlib.sha256(picture(BOARD, optics, frame_id=frame, threads=threads).tobytes()).hexdigest()
        for optics, frame, threads in (
            (EVERYTHING, 5, 1),
            (EVERYTHING, 5, 2),
            (EVERYTHING, 6, 1),
            (dataclasses.replace(EVERYTHING, seed=4), 5, 1),
        )
    ]
    assert made[0] == made[1]
    assert len(set(made)) == 3


def test_haze_follows_koschmieders_law():
    """The contrast of a dark board against the horizon falls as exp(−density · distance along the ray)."""
    density, light = 0.02, Codes()
    air = (0.8, 0.8, 0.8)
    for north in (10.0, 40.0, 80.0):
        scene = scene_of(wall(north, north, north))
        near, far = (
            light.light(picture(scene, Optics(haze=haze)))[45, 80]
            for haze in (Haze(0.0, color=air), Haze(density, color=air))
        )
        assert (0.8 - far) / (0.8 - near) == pytest.approx(math.exp(-density * north), abs=0.02)


def test_haze_depends_on_the_ray_length_not_on_the_planar_depth():
    scene = scene_of(wall(30.0, 200.0, 100.0))
    seen = Codes().light(picture(scene, Optics(haze=Haze(0.03, color=(1.0, 1.0, 1.0)))))
    assert seen[45, 2].mean() > 1.15 * seen[45, 80].mean()  # 42 m and 30 m


def test_a_haze_layer_hides_the_horizon_but_not_the_sky_overhead():
    up = dataclasses.replace(STILL, attitude=quat_from_euler(0.0, math.radians(80.0), 0.0))
    layer = Optics(haze=Haze(0.004, 50.0, (1.0, 0.2, 0.2)))
    clear = picture(scene_of(), Optics(), up)[45, 80].astype(int)
    overhead = picture(scene_of(), layer, up)[45, 80].astype(int)
    level = picture(scene_of(), layer)[44, 80].astype(int)
    assert np.abs(clear - overhead).max() < 60
    assert overhead[2] > overhead[0]  # still blue
    assert level[0] > level[2] + 60  # at the horizon only haze is visible


@pytest.mark.parametrize(
    "lens", [LensModel(k1=-0.12, k2=0.01), LensModel(k1=0.2), LensModel(k1=-0.1, p1=0.02, p2=-0.015, k3=0.004)]
)
def test_the_lens_model_matches_opencv(lens):
    """cv2.projectPoints maps the rays back to their pixels."""
    x, y = pinhole_rays(lens, CAMERA)
    matrix = np.array([[CAMERA.focal_px, 0, 79.5], [0, CAMERA.focal_px, 44.5], [0, 0, 1]])
    rays = np.stack((x, y, np.ones_like(x)), axis=-1).reshape(-1, 3)
    terms = np.array((lens.k1, lens.k2, lens.p1, lens.p2, lens.k3))
    shown = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, terms)[0].reshape(90, 160, 2)
    j, i = np.indices((90, 160))
    np.testing.assert_allclose(shown, np.stack((i, j), axis=-1), atol=1e-3)


def test_distortion_moves_edges_to_opencvs_columns_and_uses_a_wider_render():
    """The right edge of a board is at the column that OpenCV's model predicts."""
    lens, camera = LensModel(k1=-0.12, k2=0.01), CameraModel(640, 360, 90.0, (0.0, 0.0, 0.0))
    scene = scene_of(wall(10.0, 14.0, 8.0))
    row = Codes().light(picture(scene, Optics(lens=lens), camera=camera))[180, :, 0]
    edge = 320 + np.argmax(row[320:] > 0.5 * (row[330] + row[-1]))
    assert edge == pytest.approx(320 + camera.focal_px * 0.7 * (1 - 0.12 * 0.49 + 0.01 * 0.49**2), abs=1.5)
    assert wide_camera(lens, camera).width > camera.width
    assert wide_camera(LensModel(vignetting=1.0), camera) == camera


def test_full_vignetting_is_the_fourth_power_of_the_cosine():
    lit = BentLens(LensModel(vignetting=1.0), CAMERA).through(np.ones((90, 160, 3), np.float32))
    assert lit[45, 80] == pytest.approx(1.0, abs=1e-3)
    assert lit[44, 159] == pytest.approx(math.cos(math.atan(79.5 / 80)) ** 4, rel=1e-2)


def test_noise_variance_is_shot_noise_plus_read_noise():
    rng, sensor = np.random.default_rng(1), Sensor(1000.0, 10.0)
    for electrons in (100.0, 400.0, 900.0):
        light = np.full((300, 300, 3), electrons / 1000.0 * WHITE, np.float32)
        counted = noisy(light, sensor, rng) * (1000.0 / WHITE)
        assert counted.mean() == pytest.approx(electrons, abs=0.5)
        assert counted.var() == pytest.approx(electrons + 100.0, rel=0.02)


def test_blur_length_matches_the_motion_during_the_exposure():
    """In sideways flight, a board's edge becomes a ramp of f · v · T / depth pixels around its position."""
    camera = CameraModel(640, 64, 90.0, (0.0, 0.0, 0.0))
    scene = scene_of(wall(8.0, 8.0, 20.0, centre=(-4.0, -2.0)))
    flying = dataclasses.replace(STILL, velocity_ned=(0.0, 4.0, 0.0))
    row = Codes().light(picture(scene, Optics(exposure=Exposure(0.1, 32)), flying, camera=camera))[32, :, 2]
    dark, bright = row[200], row[420]
    share = (row - dark) / (bright - dark)
    share[:200] = 0.0  # removes the other edge
    first, last = np.argmax(share > 0.05), np.argmax(share > 0.95)
    assert last - first == pytest.approx(0.9 * 320 * 0.4 / 8.0, abs=2)
    assert np.argmax(share > 0.5) == pytest.approx(320, abs=1.5)


def test_rotation_and_moving_targets_cause_blur():
    camera = CameraModel(640, 64, 90.0, (0.0, 0.0, 0.0))
    scene = scene_of(wall(8.0, 8.0, 20.0, centre=(-4.0, -2.0)), movable=True)
    optics = Optics(exposure=Exposure(0.1, 16))
    turning = dataclasses.replace(STILL, rates_frd=(0.0, 0.0, 0.5))
    sharp = picture(scene, optics, camera=camera)
    turned = picture(scene, optics, turning, camera=camera)
    moved = picture(scene, optics, camera=camera, moved=lambda t: {1: ((8.0, 4.0 * t, 0.0), 0.0)})

    def levels(rgb):
        return len(np.unique(rgb[32, 290:350, 2]))

    assert levels(turned) > levels(sharp) + 5
    assert levels(moved) > levels(sharp) + 5


def mask_of(depth, rate=20.0, shutter=0.01, velocity=(0.0, 0.0, 0.0), seed=1, camera=CAMERA):
    pose = camera_pose(STILL.position_ned, STILL.attitude, camera)
    far = np.full((camera.height, camera.width), depth, np.float32)
    return streaks(far, pose, velocity, (0.0, 0.0, 0.0), rate, shutter, camera, np.random.default_rng(seed))


def test_fall_speed_matches_its_source_and_drop_density_grows_with_rain():
    assert fall_speed(np.array([2.0]))[0] == pytest.approx(6.55, abs=0.01)
    assert drops_per_m3(50.0)[0] > 2.0 * drops_per_m3(5.0)[0]
    assert drops_per_m3(50.0)[1] > drops_per_m3(5.0)[1]


def test_rain_does_not_cover_objects_nearer_than_the_drops():
    assert not mask_of(0.1).any()
    assert 0.0 < mask_of(2.0).sum() < mask_of(np.inf).sum()


def test_streaks_are_vertical_when_hovering_and_slant_in_flight():
    def spread(mask):
        """Return the mask's total change along rows divided by its total change along columns."""
        return np.abs(np.diff(mask, axis=1)).sum() / np.abs(np.diff(mask, axis=0)).sum()

    camera = CameraModel(640, 360, 90.0, (0.0, 0.0, 0.0))
    hovering = spread(mask_of(np.inf, camera=camera))
    sideways = spread(mask_of(np.inf, velocity=(0.0, 20.0, 0.0), camera=camera))
    assert hovering > 1.5
    assert sideways < 0.7


def test_streak_cover_is_independent_of_exposure_and_grows_with_rain_rate():
    short, long = mask_of(np.inf, shutter=0.004).sum(), mask_of(np.inf, shutter=0.016).sum()
    assert long == pytest.approx(short, rel=0.1)  # the same drops, spread out
    assert mask_of(np.inf, rate=60.0).sum() > 1.8 * mask_of(np.inf, rate=10.0).sum()


def test_rain_changes_the_picture_without_adding_contrast():
    dry, wet = (picture(BOARD, optics)[:, :, 1].astype(float) for optics in (Optics(), Optics(rain=Rain(50.0))))
    near = np.s_[60:]  # below the horizon, where there are no clouds
    assert wet[near].std() <= dry[near].std() + 1.0
    assert np.abs(wet - dry).mean() > 3.0
