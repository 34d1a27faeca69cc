"""Episodes of one process share what is laid out of their map, and are, byte for byte, those laid out alone."""

import dataclasses

import numpy as np
import pytest

from episodes import catalogue
from episodes.obstacles import obstacles, sorted_into_cells, with_more
from episodes.render import layout, renderer
from episodes.render.renderer import Renderer
from episodes.world import World
from foundation.camera import CameraModel
from foundation.obstacles import MovingBox

SMALL = CameraModel(64, 36)
# a placed target, one that moves, a fleet with its look-alikes, and a target that the map has already
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
    """Return a scene that knows nothing of the map that it was added to."""
    return dataclasses.replace(scene, base=None)


@pytest.mark.parametrize("episode", EPISODES)
def test_what_is_gone_on_from_is_what_is_laid_out_anew(episode):
    world = World(catalogue.load(episode))
    assert world.filmed.base is not None
    layout.laid_out(world.filmed.base)  # the first to ask makes nothing that is kept
    of_map = layout.laid_out(world.filmed.base)
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
    assert same(tuple(one._sun), tuple(other._sun))
    for each in (one, other):
        each.close()


@pytest.mark.parametrize("episode", EPISODES)
def test_solids_are_those_sorted_anew(episode):
    scene = World(catalogue.load(episode)).scene
    for _ in range(2):
        shared = obstacles(scene)
    own = obstacles(alone(scene))
    for field in dataclasses.fields(own):
        one, other = getattr(shared, field.name), getattr(own, field.name)
        assert isinstance(one, MovingBox) or same(one, other), field.name
    assert (shared.moving is None) == (own.moving is None)


def test_what_stands_among_other_things_comes_after_them():
    """The order within a cell is the order in which a vehicle is pushed."""
    middle = np.random.default_rng(3).uniform(0.0, 9.0, (300, 1, 3))
    triangles = middle + np.random.default_rng(4).uniform(-0.8, 0.8, (300, 3, 3))
    triangles[0], triangles[1] = np.eye(3) * 12.0 - 2.0, -np.eye(3) * 12.0 + 10.0  # the grid is the first ones'
    owner = np.arange(300, dtype=np.int32)
    whole = sorted_into_cells(triangles, owner, tuple(map(str, owner)), 0.7)
    first = sorted_into_cells(triangles[:200], owner[:200], tuple(map(str, owner[:200])), 0.7)
    more = with_more(first, triangles[200:], owner[:100], tuple(map(str, owner[200:])))
    assert more is not None
    for field in dataclasses.fields(whole):
        assert same(getattr(more, field.name), getattr(whole, field.name)), field.name


def test_what_reaches_beyond_the_map_makes_its_own_grid():
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
    assert same(tuple(made[1]._sun), tuple(made[2]._sun))
    for each in made:
        each.close()


def test_one_flight_keeps_nothing(monkeypatch):
    """What is kept for the next costs memory, and a process that flies once has no next."""
    kept = []
    monkeypatch.setattr(renderer, "_shadows_of_map", lambda *arguments: kept.append(arguments))
    scene = World(dataclasses.replace(catalogue.load("blocks-commanding-01"), map_seed=77)).filmed
    Renderer(scene, SMALL, shadow_cells=64).close()
    assert not kept
    Renderer(scene, SMALL, shadow_cells=64).close()
    assert len(kept) == 1
