"""The rules for a suite: even layouts pass, and each way to reveal the target's position fails its rule."""

import dataclasses
import json
import math
import random
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.cli.main import main
from episodes.authoring.check import rules, sight
from episodes.authoring.check.finding import SPOTTED_PX
from episodes.authoring.check.rules import Layout, check_all, fewest_candidate_pixels, layout
from episodes.authoring.propose.draft import shares
from episodes.records import catalogue
from episodes.records.record import HIDDEN, EpisodeRecord
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import bearing_deg, quat_from_euler

TEN = range(10)


def record(name: str) -> EpisodeRecord:
    return catalogue.load(name)


def layout_of_record(episode: EpisodeRecord) -> Layout:
    """Return a record's layout from its own numbers, without its scene."""
    off = math.remainder(episode.bearing_deg - episode.starts[0].yaw_deg, 360.0)
    hidden = episode.cell in HIDDEN
    column = None if hidden else 0.5 + 0.5 * math.tan(math.radians(off))
    row, fewest = None if hidden else 0.5, 500 if episode.cell == "commanding" else None
    return Layout(
        episode.id,
        episode.map,
        episode.cell,
        episode.seed,
        off,
        column,
        row,
        episode.start_distance_m,
        1.7,
        frozenset(),
        fewest,
    )


def made(map_name: str = "residential", cell: str = "approaching") -> list[Layout]:
    """Return ten even layouts of a cell. Straight flights within 10° of the target's bearing pass the target."""
    hidden, layouts = cell in HIDDEN, []
    for k in TEN:
        off = 50.0 + 28.0 * k if hidden else math.degrees(math.atan(-0.8 + 1.6 * k / 9.0))
        passed = frozenset(h for h in range(-180, 180, 2) if abs(math.remainder(h - off, 360.0)) < 10.0)
        column = None if hidden else 0.5 + 0.5 * math.tan(math.radians(off))
        distance = 16.0 if map_name == "residential" else 12.5 + 35.0 * k / 9.0
        name = f"{map_name}-{cell}-{k + 1:02d}"
        seed, height, row = zlib.crc32(name.encode()), 1.22 + 0.96 * k / 9.0, 0.5 + 0.01 * k
        layouts.append(
            Layout(name, map_name, cell, seed, off, column, None if hidden else row, distance, height, passed, None)
        )
    return layouts


def suite() -> list[Layout]:
    return [
        *made(), *made(cell="searching"), *made("campus"), *made("campus", "searching"),
    ]  # fmt: skip


def red(layouts: list[Layout]) -> set[str]:
    return {f.rule for f in rules.check_suite(layouts) if not f.passed}


def change(layouts: list[Layout], cell: str, **values: Any) -> list[Layout]:
    """Return the layouts with some values changed in one cell's records."""
    return [dataclasses.replace(one, **values) if f"{one.map} {one.cell}" == cell else one for one in layouts]


def test_an_even_suite_passes_all_rules() -> None:
    assert red(suite()) == set()


@pytest.mark.parametrize(
    ("worse", "rule"),
    [
        (lambda s: [dataclasses.replace(one, seed=7) for one in s], "the seeds"),
        (lambda s: [*s[:-1], dataclasses.replace(s[-1], seed=s[0].seed)], "the seeds"),
        (lambda s: change(s, "residential approaching", off_deg=9.0), "targets more than 15° off the nose"),
        (lambda s: change(s, "residential approaching", column=0.7), "the unevenness of the targets' columns"),
        (
            lambda s: change(s, "campus searching", off_deg=-90.0),
            "the unevenness of the bearings of hidden targets",
        ),
        (
            lambda s: change(s, "residential approaching", straight_deg=frozenset({0})),
            "records that a flight straight ahead passes",
        ),
        (
            lambda s: change(s, "residential searching", straight_deg=frozenset({90})),
            "records that a straight flight passes on any one heading",
        ),
        (lambda s: change(change(s, "campus approaching", distance_m=20.0), "campus searching", distance_m=20.0),
         "the farthest start on campus"),
        (lambda s: [dataclasses.replace(one, height_m=1.7) for one in s], "the highest start"),
        (lambda s: [dataclasses.replace(one, row=one.row and 0.5) for one in s],
         "the spread of the targets' heights in the picture, as a share of the picture"),
    ],
)  # fmt: skip
def test_layouts_that_reveal_the_target_position_fail_their_rule(
    worse: Callable[[list[Layout]], list[Layout]], rule: str
) -> None:
    assert any(rule in one for one in red(worse(suite())))


def test_shipped_records_are_evenly_spread_and_version_1_records_are_not() -> None:
    """Uses only the numbers in the records. A slow test builds the scenes."""
    drawn = [layout_of_record(record(name)) for name in catalogue.ids()]
    about = ("off the nose", "uneven", "seeds", "campus")
    assert not [rule for rule in red(drawn) if any(word in rule for word in about)]
    former = red([layout_of_record(record(name)) for name in catalogue.v1_ids()])
    assert sum("off the nose" in rule for rule in former) == 4
    assert sum("bearings" in rule for rule in former) == 4


def test_seeds_are_distinct() -> None:
    seeds = [record(name).seed for name in catalogue.ids()]
    assert len(set(seeds)) == len(seeds) == 100


@pytest.mark.slow("checks the hundred episodes")
def test_the_shipped_suite_passes_the_suite_rules() -> None:
    layouts = [report.layout for report in check_all(catalogue.ids(), laid_out=True)]
    assert [f.sentence for f in rules.check_suite([one for one in layouts if one]) if not f.passed] == []


def test_straight_deg_contains_only_headings_towards_the_target() -> None:
    world = World(record(catalogue.DEFAULT))
    measured = layout(world)
    middle = [h for h in measured.straight_deg if abs(math.remainder(h - measured.off_deg, 360.0)) < 3.0]
    assert middle  # straight at the target
    assert all(
        abs(math.remainder(h - measured.off_deg, 360.0)) < 20.0 for h in measured.straight_deg
    )  # asin 5/16 is 18°
    assert 15 <= 2 * len(measured.straight_deg) <= 38
    start = world.record.starts[0]
    turned = dataclasses.replace(world.record, starts=(dataclasses.replace(start, yaw_deg=start.yaw_deg + 40.0),))
    moved = layout(World(turned)).straight_deg
    assert {h - 40 for h in measured.straight_deg} == set(moved)


def test_each_heading_in_straight_deg_reaches_and_sees_the_target() -> None:
    """Recomputes the result independently, in steps of 0.1 m."""
    world = World(record(catalogue.DEFAULT))
    measured, start = layout(world), world.record.starts[0]
    for heading in range(-40, 80, 2):
        yaw = math.radians(start.yaw_deg + heading)
        attitude, met = quat_from_euler(0.0, 0.0, yaw), False
        for along in np.arange(9.0, 20.0, 0.1):
            n, e, d = start.position_ned
            place = (n + along * math.cos(yaw), e + along * math.sin(yaw), d)
            if math.dist(place, world.target_centre(0.0)) <= 5.0:
                met = met or bool(world.measure(0.0, place, attitude, CameraModel()).visible)
        assert met or heading not in measured.straight_deg


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_unevenness_is_the_kolmogorov_smirnov_statistic(values: list[float]) -> None:
    points = np.linspace(-0.01, 1.01, 3000)  # so the statistic on them is at most one step too small
    share = np.array([sum(v <= p for v in values) / len(values) for p in points])
    worst = float(np.abs(share - np.clip(points, 0.0, 1.0)).max())
    assert worst - 1e-9 <= rules.unevenness(values) <= worst + (points[1] - points[0]) + 1e-9


@given(st.integers(1, 99), st.integers(0, 1000))
def test_shares_use_every_stratum_once(count: int, seed: int) -> None:
    drawn = shares(count, random.Random(seed))
    for values in zip(*[(s.turn, s.distance, s.height) for s in drawn], strict=True):
        assert all(0.0 <= v <= 1.0 for v in values)
        if count > 1:
            assert sorted(round(v * (count - 1)) for v in values) == list(range(count))


def test_framing_agrees_with_the_pixel_counts() -> None:
    """A shown target does not touch the image's edge. A hidden target has no pixel, but has some after a 4° turn."""
    world = World(record("residential-searching-01"))
    place, yaw = world.target_upright(0.0)
    here = world.record.starts[0].position_ned
    framed = sight.framing(sight.box_corners(world.target.mesh, place, yaw), here)
    goal = world.target_centre(0.0)
    ahead = bearing_deg(here, goal)
    from episodes.authoring.check.sight import seen

    for share in (0.0, 0.5, 1.0):
        across, away = sight.yaw_showing(framed, share), sight.yaw_hiding(framed, share)
        assert across is not None
        assert away is not None
        shown = seen(world, here, ahead + across)
        assert shown.pixels > 0
        assert not shown.cut
        assert seen(world, here, ahead + away).pixels == 0
    left, right = (sight.yaw_hiding(framed, share) for share in (0.0, 1.0))
    assert left is not None
    assert right is not None
    assert seen(world, here, ahead + left - 4.0).pixels > 0
    assert seen(world, here, ahead + right + 4.0).pixels > 0
    assert 45.0 < left < 60.0
    assert 300.0 < right < 315.0


def test_a_drone_that_hides_a_candidate_reduces_its_pixel_count() -> None:
    one = record("blocks-commanding-01")
    assert fewest_candidate_pixels(World(one)) >= SPOTTED_PX
    world = World(one)
    goal, eye = world.target_centre(0.0), one.starts[0].position_ned
    away = 2.0 / math.dist(goal, eye)
    north, east, down = (e + away * (g - e) for g, e in zip(goal, eye, strict=True))
    starts = (one.starts[0], dataclasses.replace(one.starts[1], position_ned=(north, east, down)), *one.starts[2:])
    assert fewest_candidate_pixels(World(dataclasses.replace(one, starts=starts))) < SPOTTED_PX


def test_check_reports_the_faults_of_a_suite(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    name = "residential-approaching-02"
    for one in (catalogue.DEFAULT, name):
        copy = dataclasses.replace(record(one), seed=5)
        (tmp_path / f"{one}.json").write_text(copy.to_json())
    monkeypatch.setattr(catalogue, "FOLDER", tmp_path)
    assert main(["episodes", "check", "--jobs", "1", "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["rejected"] == {}
    (wrong,) = answer["suite"]
    assert "'seed'" in wrong
    assert f"{catalogue.DEFAULT}, {name}" in wrong
    assert main(["episodes", "check", "--jobs", "1", name]) == 0  # suite rules do not apply to a single record


def test_equal_shares_are_equal_steps_in_image_columns() -> None:
    """So the target is as likely at the sides of the image as in its middle."""
    corners = sight.box_corners(World(record(catalogue.DEFAULT)).target.mesh, (16.0, 0.0, 0.0), 0.0)
    framed = sight.framing(corners, (0.0, 0.0, -1.7))
    camera = CameraModel()
    columns = []
    for share in np.linspace(0.0, 1.0, 9):
        across = sight.yaw_showing(framed, float(share))
        assert across is not None
        off = math.radians(across)
        eye = (0.5 * math.cos(off), 0.5 * math.sin(off))
        middle = corners.mean(axis=0)
        azimuth = math.atan2(middle[1] - eye[1], middle[0] - eye[0]) - off
        columns.append(camera.width / 2 + camera.focal_px * math.tan(azimuth))
    steps = np.diff(columns)
    assert steps == pytest.approx(steps.mean(), rel=0.05)
