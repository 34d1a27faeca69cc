"""The rendered picture: light, shadow, textures, moving objects, and identical bytes each time."""

import dataclasses
import hashlib
import threading

import cv2
import numpy as np
import pytest

from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.camera.renderer.textures import build_atlas
from episodes.maps.scene import Material
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_from_euler
from tests.episodes.camera.renderer.scenes import (
    EASTERN,
    OVERHEAD,
    box_mesh,
    ground_mesh,
    instance,
    looking,
    mesh_of,
    quad_mesh,
    random_boxes,
    scene_of,
)

CAMERA = CameraModel(width=160, height=120)
RED, GREEN, BLUE, WHITE = (200, 0, 0), (0, 200, 0), (0, 0, 200), (220, 220, 220)


def from_above(height):
    """Return a pose that looks straight down with north at the top of the picture."""
    return looking((0.0, 0.0, -height), pitch_deg=-90.0)


def digest(view):
    return hashlib.sha256(view.rgb.tobytes() + view.depth.tobytes() + view.ids.tobytes()).hexdigest()


@pytest.fixture(scope="module")
def post():
    """A post 4 m high on level ground with the sun in the east at 45°: its shadow reaches 4 m to the west."""
    things = [
        instance(1, ground_mesh(40.0), (0, 0, 0), "ground"),
        instance(2, box_mesh(1.0, 1.0, 4.0), (0, 0, 0), movable=True),
        instance(3, box_mesh(1.0, 1.0, 1.0), (15.0, 15.0, 0.0)),
    ]
    return Renderer(scene_of(things, EASTERN), CAMERA, shadow_cells=1024)


def ground_at(view, height, north, east):
    """Return the brightness of the ground at (north, east) in a view from `from_above(height)`."""
    x = CAMERA.width / 2 + CAMERA.focal_px * east / height
    y = CAMERA.height / 2 - CAMERA.focal_px * north / height
    assert view.ids[int(y), int(x)] == 1
    return float(view.rgb[int(y), int(x)].mean())


def test_only_the_side_away_from_the_sun_is_in_shadow(post):
    view = post.render(from_above(20.0))
    lit = ground_at(view, 20.0, 8.0, -8.0)
    for east in (-2.0, -3.0, -4.0):
        assert ground_at(view, 20.0, 0.0, east) < 0.75 * lit
    for north, east in ((0.0, 4.0), (0.0, -5.5), (2.0, -2.0), (-2.0, -2.0), (3.0, 3.0)):
        assert ground_at(view, 20.0, north, east) == pytest.approx(lit, abs=4.0)


def test_the_shadow_begins_at_the_foot_of_the_object(post):
    """There is no visible gap between an object and its shadow (a few cells of the shadow map)."""
    view = post.render(from_above(12.0))
    assert ground_at(view, 12.0, 0.0, -2.2) < 0.75 * ground_at(view, 12.0, 4.0, -4.0)
    low = post.render(looking((0.0, -6.0, -1.0), 90.0, -10.0))
    foot = np.nonzero(low.ids[:, CAMERA.width // 2] == 2)[0].max() + 2
    assert low.rgb[foot, CAMERA.width // 2].mean() < 0.75 * low.rgb[foot, 5].mean()


def test_lit_planes_do_not_shade_themselves(post):
    """Shadow acne would increase the spread of the brightness on sunlit ground and walls."""
    view = post.render(looking((8.0, 8.0, -3.0), 20.0, -25.0))
    ground = view.rgb[(view.ids == 1) & (view.depth < 6.0)].mean(axis=1)
    assert ground.size > 500
    assert ground.std() < 3.0
    wall = post.render(looking((0.0, 5.0, -2.0), -90.0))
    face = wall.rgb[(wall.ids == 2)].mean(axis=1)
    assert face.size > 200
    assert np.percentile(face, 95) - np.percentile(face, 15) < 6.0


def test_a_moved_object_moves_its_shadow_and_returns_exactly(post):
    home = post.render(from_above(20.0))
    away = post.render(from_above(20.0), {2: ((5.0, 0.0, 0.0), 0.3)})
    assert away.ids[CAMERA.height // 2, CAMERA.width // 2] == 1
    assert ground_at(away, 20.0, 5.0, -3.0) < 0.75 * ground_at(away, 20.0, 0.0, -3.0)
    assert away.ids[int(CAMERA.height / 2 - CAMERA.focal_px * 5.0 / 18.0), CAMERA.width // 2] == 2
    assert digest(post.render(from_above(20.0))) == digest(home)


def test_a_movable_object_can_be_tilted_or_absent(post):
    place = (3.0, -2.0, -1.0)
    yawed = post.render(from_above(20.0), {2: (place, 0.7)})
    level = post.render(from_above(20.0), {2: (place, quat_from_euler(0.0, 0.0, 0.7))})
    assert (yawed.ids != level.ids).mean() < 1e-4
    rolled = post.render(from_above(20.0), {2: (place, quat_from_euler(np.pi / 2, 0.0, 0.0))})
    rows, columns = np.nonzero(rolled.ids == 2)  # its right side is down, so its top points to the right
    assert np.ptp(columns) > 3.0 * np.ptp(rows)
    assert columns.mean() > CAMERA.width / 2 + CAMERA.focal_px * -2.0 / 19.0
    assert (post.render(from_above(20.0)).ids == 2).any()
    gone = post.render(from_above(20.0), {2: None})
    assert not (gone.ids == 2).any()
    lit = ground_at(gone, 20.0, 8.0, -8.0)
    assert ground_at(gone, 20.0, 0.0, -3.0) == pytest.approx(lit, abs=4.0)  # its shadow is absent too


def test_only_movable_objects_can_be_moved(post):
    with pytest.raises(UsageError, match="3"):
        post.render(from_above(20.0), {3: ((0.0, 0.0, 0.0), 0.0)})


def test_faces_towards_the_sun_are_brighter():
    renderer = Renderer(scene_of([instance(2, box_mesh(2, 2, 2), (0, 0, 0))], EASTERN), CAMERA, shadow_cells=256)
    east = renderer.render(looking((0.0, 4.0, -1.0), -90.0)).rgb[60, 80].mean()
    west = renderer.render(looking((0.0, -4.0, -1.0), 90.0)).rgb[60, 80].mean()
    assert east > 1.5 * west


def test_both_sides_of_a_triangle_have_the_same_light():
    corners = [(0.0, -1.0, -1.0), (0.0, 1.0, -1.0), (0.0, 1.0, 1.0), (0.0, -1.0, 1.0)]
    shown = []
    for order in (corners, corners[::-1]):
        mesh = mesh_of(order, [(0, 2, 1), (0, 3, 2)])
        view = Renderer(scene_of([instance(1, mesh, (4.0, 0, 0))], EASTERN), CAMERA, shadow_cells=64).render(
            looking((0, 0, 0))
        )
        assert (view.ids == 1).any()
        shown.append(view.rgb)
    np.testing.assert_array_equal(shown[0], shown[1])


def quarters():
    """Return a picture whose quarters are red and green (top), and blue and white (bottom)."""
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :32], picture[:32, 32:], picture[32:, :32], picture[32:, 32:] = RED, GREEN, BLUE, WHITE
    return picture


def test_a_texture_is_upright_and_not_mirrored():
    """uv (0, 0) is the top-left corner of the texture, seen from the front."""
    material = Material("sign", (1.0, 1.0, 1.0), quarters())
    sign = quad_mesh([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)], material)
    view = Renderer(scene_of([instance(1, sign, (2.0, 0, 0))]), CAMERA, shadow_cells=64).render(looking((0, 0, 0)))
    colors = [view.rgb[y, x].astype(int) for y, x in ((40, 60), (40, 100), (80, 60), (80, 100))]
    assert [int(np.argmax(c)) for c in colors[:3]] == [0, 1, 2]
    assert np.ptp(colors[3]) < 60


def test_texture_coordinates_are_perspective_correct():
    """A striped floor has a boundary every metre. The drawn boundaries are at their analytic positions."""
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:32] = 255
    uv = [(0.0, 0.0), (1.0, 0.0), (1.0, 20.0), (0.0, 20.0)]  # two metres per repeat, counted from 40 m towards 0 m
    floor = mesh_of(
        [(40, -20, 0), (40, 20, 0), (0, 20, 0), (0, -20, 0)],
        [(0, 2, 1), (0, 3, 2)],
        Material("f", (1, 1, 1), stripes),
        uv,
    )
    camera = CameraModel(width=64, height=480, hfov_deg=8.0)
    view = Renderer(scene_of([instance(1, floor, (0, 0, 0))]), camera, shadow_cells=64).render(
        looking((0.0, 0.0, -2.0), pitch_deg=-40.0)
    )
    column = view.rgb[:, 32].mean(axis=1)
    y = np.arange(camera.height) + 0.5 - camera.height / 2
    below = np.radians(40.0) + np.arctan(y / camera.focal_px)
    north = 2.0 / np.tan(below)
    seen = (view.ids[:, 32] == 1) & (north < 6.0) & (np.abs(north - np.round(north)) > 0.06)
    white = ((40.0 - north) % 2.0) < 1.0
    assert seen.sum() > 200
    assert (column[seen & white].min()) > column[seen & ~white].max() + 50


def test_a_fine_distant_texture_becomes_its_mean():
    """A checkerboard finer than the pixels becomes grey, without a moiré pattern."""
    checks = np.where(np.indices((64, 64)).sum(axis=0) % 2, 255, 0).astype(np.uint8)
    material = Material("checks", (1.0, 1.0, 1.0), np.repeat(checks[..., None], 3, axis=2))
    wall = mesh_of(
        [(0, -50, -50), (0, 50, -50), (0, 50, 50), (0, -50, 50)],
        [(0, 2, 1), (0, 3, 2)],
        material,
        [(0, 0), (100, 0), (100, 100), (0, 100)],
    )
    view = Renderer(scene_of([instance(1, wall, (45.0, 0, 0))], EASTERN), CAMERA, shadow_cells=64).render(
        looking((0, 0, 0))
    )
    assert view.rgb[:55].std(axis=(0, 1)).max() < 6.0  # above the foot of the wall, which is darker


def test_letters_of_10_cm_keep_their_contrast_at_8_m():
    """Bars 2 cm wide with 2 cm between them (strokes of 0.1 m letters) keep their contrast at 1280 px."""
    bars = np.zeros((8, 160, 3), np.uint8)
    bars[:, (np.arange(160) // 8) % 2 == 0] = 255
    plate = quad_mesh(
        [(0, -0.2, -0.06), (0, 0.2, -0.06), (0, 0.2, 0.06), (0, -0.2, 0.06)], Material("p", (1, 1, 1), bars)
    )
    camera = CameraModel(width=1280, height=64)
    view = Renderer(scene_of([instance(1, plate, (8.0, 0, 0))], EASTERN), camera, shadow_cells=64).render(
        looking((0, 0, 0))
    )
    row = view.rgb[32, 626:654].mean(axis=1)
    assert np.ptp(row) > 60
    assert ((np.diff(np.sign(row - row.mean())) != 0).sum()) >= 12


def test_edges_are_antialiased():
    view = Renderer(scene_of([instance(1, box_mesh(1, 4, 4), (8.0, 0, 2.0))]), CAMERA, shadow_cells=64).render(
        looking((0, 0, 0), roll_deg=10.0)
    )
    levels = np.unique(view.rgb[10:110, 30:130, 0])
    assert len(levels) > 12


def test_more_samples_are_closer_to_a_downscaled_large_picture():
    scene = maps.build("blocks")
    n, e, d = scene.spawn_ned
    pose = looking((n, e, d - 3.0), 40.0, -5.0)
    large = Renderer(scene, CameraModel(640, 360)).picture(pose)
    reduced = cv2.resize(large, (320, 180), interpolation=cv2.INTER_AREA).astype(float)
    small = CameraModel(320, 180)
    solid = Renderer(scene, small).render(pose).ids > 0  # the sky is read once per pixel
    coarse, fine = (np.abs(Renderer(scene, small, grain=n).picture(pose) - reduced)[solid].mean() for n in (2, 4))
    assert fine < 0.7 * coarse


def test_thread_count_changes_no_byte():
    scene = random_boxes(7)
    pose = looking((-20.0, 3.0, -4.0), 20.0, -5.0, 4.0)
    digests = {digest(Renderer(scene, CAMERA, threads, shadow_cells=512).render(pose)) for threads in (1, 2, 3, 7)}
    assert len(digests) == 1


def test_the_same_pose_gives_the_same_bytes_from_any_thread():
    renderer = Renderer(random_boxes(8), CAMERA, shadow_cells=512)
    poses = [looking((-20.0, 3.0, -4.0), yaw) for yaw in (0.0, 90.0, 180.0, 270.0)]
    alone = [digest(renderer.render(pose)) for pose in poses]
    together: dict[int, str] = {}
    crowd = [
        threading.Thread(target=lambda k=k: together.update({k: digest(renderer.render(poses[k % 4]))}))
        for k in range(12)
    ]
    for one in crowd:
        one.start()
    for one in crowd:
        one.join()
    assert [together[k] for k in range(12)] == alone * 3
    renderer.close()


def test_an_empty_scene_shows_only_blue_sky():
    clear = dataclasses.replace(OVERHEAD, clouds=0.0)
    view = Renderer(scene_of([], clear), CAMERA, shadow_cells=64).render(looking((0, 0, -5.0)))
    assert not view.ids.any()
    assert np.isinf(view.depth).all()
    assert view.rgb[0].astype(int)[:, 2].min() > view.rgb[0].astype(int)[:, 0].max()  # blue


def test_more_clouds_hide_more_of_the_sky():
    """A pixel of the sky counts as hidden if it is less blue than in a clear sky."""

    def blue(clouds):
        sun = dataclasses.replace(OVERHEAD, toward_ned=(0.8, 0.0, -0.6), clouds=clouds)
        view = Renderer(scene_of([], sun), CAMERA, shadow_cells=64).render(looking((0, 0, 0), 180.0, 70.0))
        return view.rgb[..., 2].astype(int) - view.rgb[..., 0]

    clear, shares = blue(0.0), []
    for clouds in (0.2, 0.5, 1.0):
        shares.append(float((blue(clouds) < 0.8 * clear).mean()))
    assert shares[0] < shares[1] < shares[2]
    assert shares[2] > 0.99
    assert blue(1.0).max() < 0.5 * clear.min()


def test_sky_and_ground_have_the_same_colour_at_the_horizon():
    """The most distant ground has the colour of the sky directly above it, in each direction."""
    sun = dataclasses.replace(OVERHEAD, toward_ned=(0.6, 0.0, -0.8))
    level = instance(1, ground_mesh(60000.0), (0, 0, 0), "ground")
    renderer = Renderer(scene_of([level], sun), CameraModel(width=64, height=240, hfov_deg=4.0), shadow_cells=64)
    for yaw in (0.0, 90.0, 200.0):
        view = renderer.render(looking((0, 0, -20.0), yaw))
        sky, ground = view.rgb[118].astype(int), view.rgb[121].astype(int)
        assert (view.ids[118] == 0).all()
        assert (view.ids[121] == 1).all()
        assert np.abs(sky - ground).max() <= 16


def test_an_object_on_the_ground_darkens_the_ground_around_it():
    """In overcast light no object casts a shadow. The dark ground keeps it from looking as if it floats."""
    grey = dataclasses.replace(EASTERN, strength=0.0, clouds=1.0)
    things = [
        instance(1, ground_mesh(40.0), (0, 0, 0), "ground"),
        instance(2, box_mesh(2.0, 2.0, 1.0), (0, 0, 0), movable=True),
        instance(3, box_mesh(4.0, 4.0, 8.0), (15.0, 15.0, 0.0)),
    ]
    renderer = Renderer(scene_of(things, grey), CAMERA, shadow_cells=256)
    view = renderer.render(from_above(20.0))
    far = ground_at(view, 20.0, 8.0, -8.0)
    assert ground_at(view, 20.0, 1.25, 0.0) < 0.9 * far
    assert ground_at(view, 20.0, 12.7, 15.0) < 0.9 * far  # beside a static object
    away = renderer.render(from_above(20.0), {2: ((6.0, 0.0, 0.0), 0.3)})
    assert ground_at(away, 20.0, 0.0, 0.0) == pytest.approx(far, abs=4.0)
    flying = renderer.render(from_above(20.0), {2: ((0.0, 0.0, -3.0), 0.3)})
    assert ground_at(flying, 20.0, 2.0, 0.0) == pytest.approx(far, abs=4.0)
    assert digest(renderer.render(from_above(20.0))) == digest(view)


def test_a_roof_is_as_bright_as_open_ground():
    hall = instance(2, box_mesh(8.0, 10.0, 12.0), (0.0, 0.0, 0.0))
    renderer = Renderer(scene_of([instance(1, ground_mesh(60.0), (0, 0, 0), "ground"), hall]), CAMERA)
    view = renderer.render(from_above(40.0))
    roof = view.rgb[view.ids == 2].mean(axis=1)
    assert len(roof) > 100
    assert np.percentile(roof, 5) == pytest.approx(ground_at(view, 40.0, 20.0, 20.0), rel=0.02)


def test_the_far_side_of_a_cage_is_visible_through_its_holes():
    holes = np.zeros((8, 8), np.bool_)
    holes[:, :2] = True
    bars = Material("bars", (0.5, 0.0, 0.0), np.full((8, 8, 3), 255, np.uint8), cutout=holes)
    cage = box_mesh(1.0, 1.0, 1.0, bars)
    uv = np.repeat(cage.vertices[:, :1] + cage.vertices[:, 1:2], 2, axis=1) * 6.0
    cage = dataclasses.replace(cage, uv=np.asarray(uv, np.float32))
    hidden = dataclasses.replace(cage, materials=(dataclasses.replace(bars, cutout=None),))
    pose = looking((-4.0, 0.0, -0.5))
    shares = []
    for mesh in (cage, hidden):
        view = Renderer(scene_of([instance(1, mesh, (0.0, 0.0, 0.0))]), CAMERA).render(pose)
        depth = view.depth[view.ids == 1]
        shares.append((depth > 4.3).mean())
    assert shares[1] == 0.0
    assert shares[0] > 0.1


def test_a_glass_pane_reflects_the_sky():
    """Glass reflects the sky if it leans back, and the ground if it leans forward."""
    glass = Material("glass", (0.02, 0.02, 0.02), specular=1.0)
    pane = quad_mesh([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)], glass)
    clear = dataclasses.replace(EASTERN, clouds=0.0)
    shown = []
    for lean in (-40.0, 40.0):
        thing = dataclasses.replace(
            instance(1, pane, (2.0, 0, -3.0)), attitude=quat_from_euler(0.0, np.radians(lean), 0.0)
        )
        renderer = Renderer(scene_of([thing], clear), CAMERA, shadow_cells=64)
        shown.append(renderer.render(looking((0, 0, -3.0))).rgb[60, 80].astype(int))
    assert shown[0].sum() != shown[1].sum()
    assert max(shown, key=lambda c: c[2])[2] > max(shown, key=lambda c: c[2])[0]


def test_the_sun_is_in_the_direction_that_the_scene_sets():
    up = Renderer(scene_of([], OVERHEAD), CAMERA, shadow_cells=64).render(looking((0, 0, 0), pitch_deg=80.0))
    bright = np.argwhere(up.rgb.sum(axis=2) == up.rgb.sum(axis=2).max()).mean(axis=0)
    expected = CAMERA.height / 2 - CAMERA.focal_px * np.tan(np.radians(10.0))
    assert bright[0] == pytest.approx(expected, abs=1.5)
    assert bright[1] == pytest.approx(CAMERA.width / 2, abs=1.5)


def test_a_texture_of_the_wrong_shape_is_rejected():
    with pytest.raises(UsageError, match="texture 0"):
        build_atlas([np.zeros((4, 4), np.uint8)])


def test_a_mesh_with_infinite_texture_coordinates_is_rejected():
    uv = [(0, 0), (1, 0), (float("inf"), 1)]
    mesh = mesh_of([(0, -1, -1), (0, 1, -1), (0, 1, 1)], [(0, 1, 2)], uv=uv)
    with pytest.raises(UsageError, match="finite"):
        Renderer(scene_of([instance(1, mesh, (0, 0, 0))]), CAMERA, shadow_cells=64)


def test_picture_equals_the_rgb_of_render():
    renderer = Renderer(random_boxes(8), CAMERA, shadow_cells=512)
    for pose in (looking((0, 0, -2.0)), looking((-6.0, 3.0, -4.0), pitch_deg=-20.0)):
        assert (renderer.picture(pose) == renderer.render(pose).rgb).all()
