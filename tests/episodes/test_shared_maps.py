"""Episodes in one process share the layout of their map. They equal separately built ones to the byte."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from episodes.camera.renderer import layout, renderer
from episodes.camera.renderer.renderer import Renderer
from episodes.records import catalogue
from episodes.world.obstacles import obstacles, sorted_into_cells, with_more
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.frames import quat_from_euler
from foundation.terrain import MovingBox

SMALL = CameraModel(64, 36)
# a fleet with look-alikes, a moving target, a placed target, and a native target of the map
EPISODES = ["blocks-commanding-01", "residential-tracking-01", "residential-approaching-02", "campus-approaching-01"]


def same(one, other):
    """Return whether two values are equal to the last bit and of one type."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one) and not isinstance(one, type):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one) if f.compare)
    return bool(one == other) or one is other


def alone(scene):
    """Return a scene without its link to the map."""
    return dataclasses.replace(scene, base=None)


def shadows(renderer):
    """Return the shadow map of the scene's static objects."""
    with renderer._shadows.cast(renderer._layout, ()) as sun:
        return sun._replace(height=sun.height.copy())


@pytest.mark.parametrize("episode", EPISODES)
def test_a_layout_built_on_the_shared_map_equals_a_new_layout(episode):
    world = World(catalogue.load(episode))
    assert world.filmed.base is not None
    layout.map_layout(world.filmed.base)  # the first request caches nothing
    of_map = layout.map_layout(world.filmed.base)
    assert of_map is not None
    shared, own = layout.lay_out(world.filmed, of_map), layout.lay_out(alone(world.filmed))
    assert same(tuple(shared.triangles), tuple(own.triangles))
    assert same(tuple(shared.surfaces), tuple(own.surfaces))
    assert same(tuple(shared.atlas), tuple(own.atlas))
    assert shared.static_count == own.static_count
    assert [(p.instance.id, p.triangles, p.chunks) for p in shared.movable] == [
        (p.instance.id, p.triangles, p.chunks) for p in own.movable
    ]
    one, other = Renderer(world.filmed, SMALL, shadow_cells=512), Renderer(alone(world.filmed), SMALL, shadow_cells=512)
    assert same(tuple(shadows(one)), tuple(shadows(other)))
    third = Renderer(world.filmed, SMALL, shadow_cells=512)  # reuses the shadows of the same map
    assert same(tuple(shadows(third)), tuple(shadows(one)))
    for each in (one, other, third):
        each.close()


def test_two_scenes_of_a_map_keep_their_shadows_separate():
    """Both scenes share the map's shadows and restore them, so no shadow of one scene appears in the other."""
    one, other = (World(catalogue.load(f"residential-approaching-0{k}")).filmed for k in (1, 2))
    assert one.base is not None
    assert one.base is other.base
    made = [Renderer(scene, SMALL, shadow_cells=512) for scene in (one, one, other)][1:]
    of_map = renderer._of_map(one.base, 512)
    assert of_map
    bare = of_map[0][0].height
    kept = bare.copy()
    first = shadows(made[0])
    assert not same(tuple(first), tuple(shadows(made[1])))
    assert same(tuple(first), tuple(shadows(made[0])))
    assert np.array_equal(bare, kept)
    for each in made:
        each.close()


def test_renderers_draw_the_same_pictures_concurrently_and_alone():
    """The renderers share a sheet and a shadow map: two scenes through one camera, one scene through another."""
    first, second = (World(catalogue.load(f"residential-approaching-0{k}")) for k in (1, 2))
    wide = CameraModel(320, 180)
    drawn = [(first, wide), (second, wide), (second, CameraModel(160, 90))]
    made = [Renderer(world.filmed, camera, shadow_cells=512) for world, camera in drawn]
    north, east, down = first.scene.spawn_ned
    poses = [
        camera_pose((north, east, down - 3.0), quat_from_euler(0.0, 0.0, yaw), wide) for yaw in np.linspace(0.0, 6.0, 8)
    ]

    def pictures(one, times):
        return [[one.picture(pose) for pose in poses] for _ in range(times)]

    alone = [pictures(picture, 1)[0] for picture in made]
    with ThreadPoolExecutor(3) as threads:
        together = [threads.submit(pictures, picture, 4) for picture in made]
        for expected, future in zip(alone, together, strict=True):
            for picture in future.result():
                assert same(picture, expected)
    for picture in made:
        picture.close()


def test_a_renderer_locks_the_sheet_and_the_shadows_while_it_draws(monkeypatch):
    scene = World(catalogue.load("residential-approaching-01")).filmed
    one, other = (Renderer(scene, SMALL, shadow_cells=512) for _ in range(2))
    assert one._sheet is other._sheet
    passes, drawing = [], Renderer._run_on_threads

    def together(self, kernel, *arguments):
        passes.append((other._sheet.turn.locked(), other._shadows._turn.locked()))
        drawing(self, kernel, *arguments)

    monkeypatch.setattr(Renderer, "_run_on_threads", together)
    one.picture(camera_pose((0.0, 0.0, -3.0), (1.0, 0.0, 0.0, 0.0), SMALL))
    assert passes
    assert set(passes) == {(True, True)}
    for each in (one, other):
        each.close()


@pytest.mark.parametrize("episode", EPISODES)
def test_shared_obstacles_equal_newly_sorted_obstacles(episode):
    scene = World(catalogue.load(episode)).scene
    for _ in range(2):
        shared = obstacles(scene)
    own = obstacles(alone(scene))
    for field in dataclasses.fields(own):
        one, other = getattr(shared, field.name), getattr(own, field.name)
        assert isinstance(one, MovingBox) or same(one, other), field.name
    assert (shared.moving is None) == (own.moving is None)


def test_added_triangles_follow_the_existing_ones_in_each_cell():
    """The order of triangles within a cell is the order in which they push a vehicle."""
    middle = np.random.default_rng(3).uniform(0.0, 9.0, (300, 1, 3))
    triangles = middle + np.random.default_rng(4).uniform(-0.8, 0.8, (300, 3, 3))
    triangles[0], triangles[1] = np.eye(3) * 12.0 - 2.0, -np.eye(3) * 12.0 + 10.0  # the first two span the grid
    owner = np.arange(300, dtype=np.int32)
    whole = sorted_into_cells(triangles, owner, tuple(map(str, owner)), 0.7)
    first = sorted_into_cells(triangles[:200], owner[:200], tuple(map(str, owner[:200])), 0.7)
    more = with_more(first, triangles[200:], owner[:100], tuple(map(str, owner[200:])))
    assert more is not None
    for field in dataclasses.fields(whole):
        assert same(getattr(more, field.name), getattr(whole, field.name)), field.name


def test_scenes_beyond_the_map_get_their_own_grid():
    world = World(catalogue.load("blocks-commanding-01"))
    far = dataclasses.replace(world.target, position_ned=(500.0, 0.0, 0.0), movable=False)
    rest = tuple(one for one in world.scene.instances if one.id != far.id)
    scene = dataclasses.replace(world.scene, instances=(*rest, far))
    for _ in range(2):
        shared = obstacles(scene)
    own = obstacles(alone(scene))
    assert shared.cells == own.cells
    assert same(shared.index, own.index)
    made = [Renderer(one, SMALL, shadow_cells=256) for one in (scene, scene, alone(scene))]
    assert same(tuple(shadows(made[1])), tuple(shadows(made[2])))
    for each in made:
        each.close()
