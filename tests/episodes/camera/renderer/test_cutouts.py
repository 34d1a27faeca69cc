"""Cut-out surfaces: picture, shadows, rays and obstacles have the same holes."""

import numpy as np
import pytest

from episodes.camera.renderer import Renderer
from episodes.maps.scene import Material
from episodes.world.obstacles import obstacles
from episodes.world.rays import NOTHING, RayScene
from episodes.world.visibility import Solids
from foundation.camera import CameraModel
from tests.episodes.camera.renderer.scenes import EASTERN, box_mesh, ground_mesh, instance, looking, quad_mesh, scene_of
from tests.episodes.camera.renderer.test_geometry import pixel_rays

CAMERA = CameraModel(width=160, height=90)
LEFT = np.array([[True, False]])  # only the left half is solid
UPRIGHT = [(0.0, -2.0, -4.0), (0.0, 2.0, -4.0), (0.0, 2.0, 0.0), (0.0, -2.0, 0.0)]  # seen from the south
WHITE = np.full((1, 2, 3), 255, np.uint8)


def board(there=LEFT, foliage=False, corners=UPRIGHT):
    return quad_mesh(corners, Material("holed", (1.0, 1.0, 1.0), WHITE, cutout=there, foliage=foliage))


def leafy(seed):
    """Return a scene of ground, boxes and boards with random holes, texture repeats and yaw."""
    rng = np.random.default_rng(seed)
    things = [instance(1, ground_mesh(), (0.0, 0.0, 0.0), "ground")]
    for k in range(60):
        place = (float(rng.uniform(-30, 30)), float(rng.uniform(-30, 30)), float(-rng.uniform(0.0, 4.0)))
        mesh = box_mesh(*rng.uniform(0.5, 3.0, 3)) if k % 4 == 0 else board(rng.random((8, 8)) < 0.5)
        mesh.uv[:] = mesh.uv * rng.uniform(0.5, 3.0) - rng.uniform(0.0, 2.0)
        things.append(instance(k + 2, mesh, place, yaw=float(rng.uniform(-3, 3))))
    return scene_of(things, EASTERN)


@pytest.mark.parametrize("seed", [0, 1])
def test_depth_and_ids_match_rays_through_the_holes(seed):
    scene = leafy(seed)
    renderer = Renderer(scene, CAMERA, shadow_cells=64)
    rays_through = RayScene.of_instances(scene.instances)
    id_of = np.repeat([i.id for i in scene.instances], [len(i.mesh.triangles) for i in scene.instances])
    rng = np.random.default_rng(seed)
    for _ in range(4):
        pose = looking(tuple(rng.uniform((-25, -25, -5), (25, 25, -1))), *rng.uniform((-180, -20, -20), (180, 20, 20)))
        view = renderer.render(pose)
        way = pixel_rays(CAMERA, pose).reshape(-1, 3)
        start = np.array(pose.position_ned) + 0.05 * way
        hits = rays_through.first_hits(start.astype(np.float32), np.ascontiguousarray(way, np.float32))
        agree = np.where(hits.triangle == NOTHING, 0, id_of[hits.triangle]) == view.ids.ravel()
        assert agree.mean() > 0.998
        both = agree & (view.ids.ravel() > 0)
        np.testing.assert_allclose(hits.distance[both] + 0.05, view.depth.ravel()[both], rtol=1e-3)


def test_the_wall_behind_a_hole_is_visible():
    wall = instance(2, box_mesh(1.0, 40.0, 40.0), (10.5, 0.0, 10.0))
    view = Renderer(scene_of([instance(1, board(), (0.0, 0.0, 0.0)), wall]), CAMERA, shadow_cells=64).render(
        looking((-5.0, 0.0, -2.0))
    )
    assert view.ids[45, 60] == 1
    assert view.depth[45, 60] == pytest.approx(5.0, abs=1e-4)
    assert view.ids[45, 100] == 2
    assert view.depth[45, 100] == pytest.approx(15.0, abs=1e-4)


def test_the_sun_shines_through_holes():
    level = [(2.0, -2.0, -3.0), (2.0, 2.0, -3.0), (-2.0, 2.0, -3.0), (-2.0, -2.0, -3.0)]
    things = [instance(1, ground_mesh(20.0), (0.0, 0.0, 0.0), "ground"), instance(2, board(corners=level), (0, 0, 0))]
    renderer = Renderer(scene_of(things), CAMERA, shadow_cells=256)
    rgb = renderer.render(looking((-8.0, 0.0, -1.0))).rgb.astype(int).sum(axis=2)
    row = 45 + 80 // 8  # the row of the ground below the board's middle
    assert rgb[row, 70] < 0.7 * rgb[row, 90]


def test_rays_pass_through_holes_and_stop_at_solid_parts():
    solids = Solids([instance(1, board(), (0.0, 0.0, 0.0))])
    behind = np.array([(3.0, -1.0, -2.0), (3.0, 1.0, -2.0)])
    assert solids.hidden((-3.0, -1.0, -2.0), behind[:1]).tolist() == [True]
    assert solids.hidden((-3.0, 1.0, -2.0), behind[1:]).tolist() == [False]
    assert solids.range_m((-3.0, -1.0, -2.0), (1.0, 0.0, 0.0)) == pytest.approx(3.0)
    assert solids.range_m((-3.0, 1.0, -2.0), (1.0, 0.0, 0.0)) == np.inf


def test_only_foliage_does_not_stop_a_vehicle():
    fence, crown = (instance(1, board(foliage=foliage), (0.0, 0.0, 0.0)) for foliage in (False, True))
    assert len(obstacles(scene_of([fence])).corners) == 2
    trunk = instance(2, box_mesh(1.0, 1.0, 1.0), (9.0, 0.0, 0.0))
    assert len(obstacles(scene_of([crown, trunk])).corners) == len(trunk.mesh.triangles)
    assert Solids([fence, trunk]).clearance_m((-1.0, 0.0, -2.0)) == pytest.approx(1.0)
    assert Solids([crown, trunk]).clearance_m((-1.0, 0.0, -0.5)) == pytest.approx(9.5)


def test_only_foliage_has_the_same_light_on_both_sides():
    """Foliage uses its mesh normals on both sides."""
    lit = []
    for foliage in (False, True):
        mesh = board(np.array([[True, True]]), foliage)
        mesh.normals[:] = (0.6, 0.48, -0.64)
        renderer = Renderer(scene_of([instance(1, mesh, (0.0, 0.0, 0.0))], EASTERN), CAMERA, shadow_cells=64)
        front, back = (renderer.render(looking((n, 0.0, -2.0), yaw)) for n, yaw in ((-4.0, 0.0), (4.0, 180.0)))
        assert front.ids[45, 80] == back.ids[45, 80] == 1
        lit.append(np.array_equal(front.rgb[45, 80], back.rgb[45, 80]))
    assert lit == [False, True]
