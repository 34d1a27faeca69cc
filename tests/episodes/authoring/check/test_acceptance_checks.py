"""The acceptance checks: a sound record passes all rules, and each fault fails its own rule."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from episodes.authoring.check import placement, rules, sight
from episodes.authoring.check.finding import RuleFinding
from episodes.authoring.check.placement import Box, StaticObstacles, overlaps
from episodes.authoring.check.rules import check
from episodes.camera.renderer.renderer import Renderer
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, Path3D
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.frames import Vec3, bearing_deg, quat_from_euler

Change = Callable[[EpisodeRecord], EpisodeRecord]
STANDING = catalogue.load("residential-approaching-01")
HIDDEN = catalogue.load("residential-searching-01")
MOVING = catalogue.load("residential-tracking-01")


def red(record: EpisodeRecord) -> dict[str, RuleFinding]:
    return {f.rule: f for f in check(World(record)) if not f.passed}


def start_at(record: EpisodeRecord, place: Vec3, yaw_deg: float | None = None) -> EpisodeRecord:
    """Return a record with another start, and with the distance and bearing that fit it."""
    goal = World(record).target_centre(0.0)
    ahead = bearing_deg(place, goal)
    one = replace(record.starts[0], position_ned=place, yaw_deg=ahead if yaw_deg is None else yaw_deg)
    return replace(record, starts=(one,), start_distance_m=math.dist(place, goal), bearing_deg=ahead)


def turned(record: EpisodeRecord, off_deg: float) -> EpisodeRecord:
    """Return a record whose drone faces `off_deg` away from its target."""
    return start_at(record, record.starts[0].position_ned, record.bearing_deg + off_deg)


def moved(record: EpisodeRecord, north: float, east: float, down: float) -> EpisodeRecord:
    n, e, d = record.starts[0].position_ned
    return start_at(record, (n + north, e + east, d + down))


def standing_at(record: EpisodeRecord, place: Vec3) -> EpisodeRecord:
    return replace(record, target=replace(record.target, position_ned=place))


def on_path(record: EpisodeRecord, *points: Vec3) -> EpisodeRecord:
    path = record.target.path
    return replace(record, target=replace(record.target, path=Path3D(points, path.speed_mps if path else 0.3)))


def painted(record: EpisodeRecord, paint: str) -> EpisodeRecord:
    return replace(record, target=replace(record.target, paint=paint))


def house(record: EpisodeRecord) -> Vec3:
    return next(i.position_ned for i in World(record).scene.instances if i.kind == "house")


@pytest.mark.parametrize("record", [STANDING, HIDDEN, MOVING], ids=lambda r: r.id)
def test_a_sound_record_passes_all_rules(record: EpisodeRecord) -> None:
    assert red(record) == {}


@pytest.mark.parametrize(
    ("record", "change", "rule", "field"),
    [
        (STANDING, lambda r: replace(r, start_distance_m=16.02), "distance measured", "start_distance_m"),
        (STANDING, lambda r: replace(r, bearing_deg=11.3), "bearing measured", "bearing_deg"),
        (STANDING, lambda r: moved(r, -2.0, 0.0, 0.0), "distance from start", "starts"),
        (STANDING, lambda r: moved(r, 0.0, 0.0, 0.7), "height of a start", "starts"),
        (STANDING, lambda r: moved(r, 0.0, 0.0, -0.7), "height of a start", "starts"),
        (STANDING, lambda r: replace(r, starts=r.starts * 2), "number of drones", "starts"),
        (STANDING, lambda r: start_at(r, r.starts[0].position_ned, 150.0), "first frame", "visible_at_start"),
        (HIDDEN, lambda r: start_at(r, r.starts[0].position_ned), "first frame", "visible_at_start"),
        (STANDING, lambda r: turned(r, 43.0), "in the first picture", "starts"),
        (STANDING, lambda r: standing_at(r, (-1.0, 2.7, 0.02)), "foot from the ground", "target.position_ned"),
        (STANDING, lambda r: standing_at(r, house(r)), "obstacle at the target", "target.position_ned"),
        (STANDING, lambda r: standing_at(r, house(r)), "visible share", "starts"),
        (STANDING, lambda r: replace(r, instruction="go to the blue SUV"), "instruction's colour", "instruction"),
        (STANDING, lambda r: replace(r, instruction="go to the cyan thing"), "instruction's noun", "instruction"),
        (STANDING, lambda r: painted(r, "black"), "in the target's colour", "instruction"),
        (MOVING, lambda r: on_path(r, *r.target.path.waypoints_ned[:8]), "path's length", "target.path"),
        (MOVING, lambda r: on_path(r, r.target.path.waypoints_ned[0], house(r)), "obstacle on", "target.path"),
        (MOVING, lambda r: on_path(r, *r.target.path.waypoints_ned[::9]), "path from the ground", "target.path"),
    ],
)  # fmt: skip
def test_each_fault_fails_its_own_rule(record: EpisodeRecord, change: Change, rule: str, field: str) -> None:
    findings = [f for name, f in red(change(record)).items() if rule in name]
    assert [f.field for f in findings] == [field]
    assert findings[0].measured in findings[0].sentence
    assert findings[0].wanted in findings[0].sentence


def test_a_start_beside_a_lamp_fails_the_free_space_rule() -> None:
    lamp = next(i for i in World(STANDING).scene.instances if i.kind == "lamp")
    n, e, d = lamp.position_ned
    assert "the free space around a drone's start and climb" in red(start_at(STANDING, (n, e + 0.5, d - 1.8)))


def test_a_start_over_a_kerb_fails_the_unevenness_rule() -> None:
    world = World(STANDING)
    kerb = next(e / 20 for e in range(60, 120) if placement.unevenness_m(world, -10.0, e / 20) > 0.1)
    rule = "the unevenness of the ground under a start"
    assert rule in red(start_at(STANDING, (-10.0, kerb, world.ground_down(-10.0, kerb) - 1.6)))
    assert rule not in red(start_at(STANDING, (-10.0, 0.0, world.ground_down(-10.0, 0.0) - 1.6)))


def test_a_path_near_the_start_fails_the_distance_rule() -> None:
    n, e, d = World(MOVING).target_pose(60.0)[0]
    assert "the path's distance from the start" in red(start_at(MOVING, (n + 2.0, e, d - 1.8)))


def test_a_slanted_path_over_a_kerb_fails_the_wheel_rule() -> None:
    """The path itself is on the ground, but the four wheels cannot all touch it."""
    world = World(MOVING)
    drive = world.target_pose(0.0)[0]
    slant = [(drive[0] + k * 0.1, drive[1] + k * 0.1) for k in range(-150, 151)]
    rule = "the distance of a wheel from the ground"
    assert rule in red(on_path(MOVING, *((n, e, world.ground_down(n, e)) for n, e in slant)))
    assert rule in {f.rule for f in check(world)}


def test_pixel_counts_match_the_renderer() -> None:
    world, camera = World(STANDING), CameraModel(640, 360)
    renderer = Renderer(world.scene, camera)
    goal, rng = world.target_centre(0.0), np.random.default_rng(4)
    drawn_some = 0
    for _ in range(8):
        turned, reach = rng.uniform(-math.pi, math.pi), rng.uniform(4.0, 20.0)
        spot = (goal[0] + reach * math.cos(turned), goal[1] + reach * math.sin(turned), -float(rng.uniform(1.5, 3.0)))
        attitude = quat_from_euler(0.0, 0.0, math.radians(bearing_deg(spot, goal)) + rng.uniform(-0.8, 0.8))
        mine = sight.patch(world.target, world.solids, spot, attitude, camera)
        drawn = renderer.render(camera_pose(spot, attitude, camera)).ids == world.target_id
        assert mine.pixels == pytest.approx(int(drawn.sum()), rel=0.01, abs=3)
        drawn_some += bool(drawn.any())
        if drawn.any():
            rows, columns = np.nonzero(drawn)
            box = (np.ptp(rows) + 1) * (np.ptp(columns) + 1) / drawn.size
            assert mine.box_share == pytest.approx(box, rel=0.03)
    assert drawn_some >= 3


def test_a_triangle_overlaps_a_box_when_one_of_its_points_is_inside() -> None:
    """Compares `overlaps` with random points of the triangle.

    If a box contains a point, they overlap. If they overlap, a slightly larger box contains a point.
    """
    rng = np.random.default_rng(8)
    weights = rng.dirichlet((1.0, 1.0, 1.0), 4000)
    met = 0
    for _ in range(300):
        box = Box(rng.normal(size=3), rng.uniform(0.3, 1.5, 3), float(rng.uniform(-3, 3)))
        triangle = rng.normal(size=(1, 3, 3)) * 2.0
        c, s = math.cos(box.yaw), math.sin(box.yaw)
        local = (weights @ triangle[0] - box.centre_ned) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        inside = bool((np.abs(local) <= box.half).all(axis=1).any())
        met += inside
        assert overlaps(triangle, box) or not inside
        grown = Box(box.centre_ned, box.half + 0.35, box.yaw)  # the margin exceeds the distance between the points
        assert (np.abs(local) <= grown.half).all(axis=1).any() or not overlaps(triangle, box)
    assert 50 < met < 250


def test_nearest_returns_the_gap_and_the_name() -> None:
    scene = World(STANDING).scene
    lamp = next(i for i in scene.instances if i.kind == "lamp")
    n, e, d = lamp.position_ned
    gap, name = StaticObstacles(scene.instances).nearest((n, e + 0.4, d - 2.0), 1.0)
    assert name == lamp.name
    assert 0.2 < gap < 0.4
    assert StaticObstacles(scene.instances).nearest((0.0, 0.0, -30.0), 0.7) == (0.7, "")


def test_reports_name_file_field_and_reason(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text(replace(STANDING, id="mine", bearing_deg=90.0).to_json())
    broken = tmp_path / "broken.json"
    document = json.loads(STANDING.to_json())
    del document["map"]
    broken.write_text(json.dumps(document))
    reports = {r.name: r for r in rules.check_all([STANDING.id, str(wrong), str(broken)], jobs=1)}
    assert reports[STANDING.id].reason is None
    reasons = {name: report.reason or "" for name, report in reports.items()}
    assert str(wrong) in reasons["mine"]
    assert "'bearing_deg'" in reasons["mine"]
    assert "'map'" in reasons[str(broken)]
    assert all("\n" not in r.reason for r in reports.values() if r.reason)
