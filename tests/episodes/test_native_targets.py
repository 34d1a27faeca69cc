"""Native targets are instances of the map. A drone can collide with them, and they do not occlude themselves."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from episodes.maps.scene import Instance
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, TargetRecord, parse
from episodes.world.obstacles import obstacles
from episodes.world.visibility import Solids, SolidsExcept, SolidsUnion, TargetView
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

CAMERA = CameraModel()
KIND = "hydrant"


@pytest.fixture(scope="module")
def thing() -> Instance:
    return next(i for i in maps.build("residential", 1).instances if i.kind == KIND)


def record_of(thing: Instance) -> EpisodeRecord:
    n, e, d = (round(v, 3) for v in thing.position_ned)
    target = TargetRecord(thing.kind, None, None, (n, e, d), round(math.degrees(thing.yaw), 1), native=thing.name)
    return replace(catalogue.load(catalogue.DEFAULT), id="mine", target=target)


@pytest.fixture(scope="module")
def world(thing: Instance) -> World:
    return World(record_of(thing))


def test_a_native_target_is_the_instance_of_the_map(world: World, thing: Instance) -> None:
    assert world.target_id == thing.id
    assert [i.id for i in world.scene.instances] == [i.id for i in maps.build("residential", 1).instances]
    assert world.target_pose(3.0) == (thing.position_ned, thing.yaw)
    assert world.moved(3.0) == {}


def test_a_native_target_does_not_occlude_itself_and_has_the_drawn_depth(world: World) -> None:
    n, e, _ = world.target_centre(0.0)
    # from the side of the road, with a free view
    spot = (n - 1.5, e + 4.0, world.ground_down(n - 1.5, e + 4.0) - 1.2)
    attitude = quat_from_euler(0.0, 0.0, math.atan2(e - spot[1], n - spot[0]))
    seen = world.measure(0.0, spot, attitude, CAMERA)
    assert (seen.visible_fraction or 0.0) > 0.97
    view = Renderer(world.scene, CAMERA).render(camera_pose(spot, attitude, CAMERA))
    mine = view.ids == world.target_id
    assert mine.any()
    assert seen.oracle_depth_m == pytest.approx(float(view.depth[mine].mean()), rel=0.03)


@pytest.mark.parametrize("change", [{"movable": True}, {"solid": False}])
def test_an_object_that_can_move_or_is_not_solid_is_no_target_and_no_box(
    thing: Instance, change: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    built = maps.build("residential", 1)
    others = tuple(replace(i, **change) if i.name == thing.name else i for i in built.instances)
    monkeypatch.setattr(maps, "build", lambda name, seed: replace(built, instances=others))
    with pytest.raises(UsageError, match=f"{thing.name}.*cannot be a target"):
        World(record_of(thing))
    assert obstacles(World(catalogue.load(catalogue.DEFAULT)).scene).moving is None


def test_a_native_target_is_listed_once_among_the_obstacles(world: World, thing: Instance) -> None:
    assert obstacles(world.scene).names.count(thing.name) == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"native": "hydrant-9999"}, "hydrant-9999.*hydrant-"),
        ({"native": "road"}, "'road'"),
        ({"asset": "lamp"}, "'hydrant'"),
        ({"yaw_deg": 91.0}, "target"),
    ],
)
def test_targets_that_do_not_match_the_map_are_rejected(thing: Instance, change: dict[str, Any], says: str) -> None:
    record = record_of(thing)
    with pytest.raises(UsageError, match=says):
        World(replace(record, target=replace(record.target, **change)))


def test_a_target_two_millimetres_off_its_instance_is_rejected(thing: Instance) -> None:
    document = json.loads(record_of(thing).to_json())
    document["target"]["position_ned"][0] += 0.002
    with pytest.raises(UsageError, match="target"):
        World(parse(json.dumps(document), "mine.json"))


def test_solids_except_one_equal_solids_built_without_it(thing: Instance) -> None:
    """Rays through the shared map give the same results as rays through a map without the omitted instance."""
    instances = maps.build("residential", 1).instances
    instances = tuple(i for i in instances if i.kind not in ("wood", "conifer"))
    one = next(i for i in instances if i.name == thing.name)
    shared, apart = SolidsExcept(Solids(instances), one), Solids(i for i in instances if i is not one)
    n, e, d = one.position_ned
    views = [TargetView(one.mesh, solids) for solids in (shared, apart)]
    rng = np.random.default_rng(6)
    fractions = []
    for _ in range(30):
        spot = (n + float(rng.uniform(-9, 9)), e + float(rng.uniform(-9, 9)), d - float(rng.uniform(0.6, 3.0)))
        ahead = quat_from_euler(0.0, 0.0, math.atan2(e - spot[1], n - spot[0]))
        a, b = (view.sight(one.position_ned, one.yaw, CameraPose(spot, ahead), CAMERA) for view in views)
        assert a.fraction == pytest.approx(b.fraction, abs=0.02)
        fractions.append(a.fraction)
        assert shared.clearance_m(spot) == pytest.approx(apart.clearance_m(spot))
        toward = (n - spot[0], e - spot[1], d - 0.3 - spot[2])
        assert shared.range_m(spot, toward) == pytest.approx(apart.range_m(spot, toward), abs=0.01)
    assert min(fractions) < 0.3
    assert max(fractions) > 0.9
    with pytest.raises(ValueError, match=thing.name):
        SolidsExcept(apart, one)
    built_again = replace(one, position_ned=one.position_ned)  # an equal instance, but another object
    assert SolidsExcept(Solids(instances), built_again).clearance_m((n, e, d)) == shared.clearance_m((n, e, d))


def test_a_union_of_solids_equals_one_group_of_all_solids() -> None:
    instances = [i for i in maps.build("blocks", 1).instances if i.solid]
    whole, parts = Solids(instances), SolidsUnion(Solids(instances[::2]), Solids(instances[1::2]))
    rng = np.random.default_rng(7)
    hidden = []
    for _ in range(20):
        eye = (float(rng.uniform(-40, 40)), float(rng.uniform(-40, 40)), -1.5)
        points = np.column_stack([rng.uniform(-60, 60, 50), rng.uniform(-60, 60, 50), rng.uniform(-6, -0.2, 50)])
        assert np.array_equal(whole.hidden(eye, points), parts.hidden(eye, points))
        hidden += whole.hidden(eye, points).tolist()
        assert whole.clearance_m(eye) == parts.clearance_m(eye)
        way = (float(rng.normal()), float(rng.normal()), 0.1)
        assert whole.range_m(eye, way) == pytest.approx(parts.range_m(eye, way))
    assert 0.05 < np.mean(hidden) < 0.95
