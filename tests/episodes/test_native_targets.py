"""A target that the map brings: the very instance, solid to a drone, and no screen before itself."""

import json
import math
from dataclasses import replace

import pytest

from dronecats.border.camera import CameraModel
from dronecats.border.errors import UsageError
from dronecats.border.frames import quat_from_euler
from episodes import catalogue, maps
from episodes.obstacles import obstacles
from episodes.record import EpisodeRecord, TargetRecord, parse
from episodes.render.pose import camera_pose
from episodes.render.renderer import Renderer
from episodes.scene import Instance
from episodes.world import World

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


def test_the_instance_itself_is_the_target(world: World, thing: Instance) -> None:
    assert world.target_id == thing.id
    assert [i.id for i in world.scene.instances] == [i.id for i in maps.build("residential", 1).instances]
    assert world.target_pose(3.0) == (thing.position_ned, thing.yaw)
    assert world.moved(3.0) == {}


def test_it_does_not_hide_itself_and_is_seen_as_it_is_drawn(world: World) -> None:
    n, e, _ = world.target_centre(0.0)
    # towards the road, where nothing else stands before it
    spot = (n - 1.5, e + 4.0, world.ground_down(n - 1.5, e + 4.0) - 1.2)
    attitude = quat_from_euler(0.0, 0.0, math.atan2(e - spot[1], n - spot[0]))
    seen = world.measure(0.0, spot, attitude, CAMERA)
    assert seen.visible_fraction > 0.97
    view = Renderer(world.scene, CAMERA).render(camera_pose(spot, attitude, CAMERA))
    mine = view.ids == world.target_id
    assert mine.any()
    assert seen.oracle_depth_m == pytest.approx(float(view.depth[mine].mean()), rel=0.03)


def test_a_drone_can_hit_it_once(world: World, thing: Instance) -> None:
    assert obstacles(world.scene).names.count(thing.name) == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"native": "hydrant-9999"}, "did you mean"),
        ({"native": "road"}, "does not have"),
        ({"asset": "lamp"}, "is a 'hydrant'"),
        ({"yaw_deg": 91.0}, "off where"),
    ],
)
def test_what_the_map_does_not_have_is_refused(thing: Instance, change: dict, says: str) -> None:
    record = record_of(thing)
    with pytest.raises(UsageError, match=says):
        World(replace(record, target=replace(record.target, **change)))


def test_two_millimetres_off_are_refused(thing: Instance) -> None:
    document = json.loads(record_of(thing).to_json())
    document["target"]["position_ned"][0] += 0.002
    with pytest.raises(UsageError, match="off where"):
        World(parse(json.dumps(document), "mine.json"))
