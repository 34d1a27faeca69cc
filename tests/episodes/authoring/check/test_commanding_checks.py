"""The rules for fleets and look-alike candidates. Each test case breaks one rule."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from episodes.authoring.check import candidates, sight
from episodes.authoring.check.rules import check
from episodes.maps.scene import Instance
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, StartPose
from episodes.world.visibility import Solids
from episodes.world.world import World
from foundation.frames import Vec3, bearing_deg

SIGNS = catalogue.load("blocks-commanding-01")
FACING = catalogue.load("v1-blocks-commanding-01")  # its square faces its goal
PLATES = catalogue.load("residential-commanding-01")


def red(record: EpisodeRecord) -> set[str]:
    return {f.rule for f in check(World(record)) if not f.passed}


def candidate(record: EpisodeRecord, number: int, **change: Any) -> EpisodeRecord:
    others = list(record.candidates)
    others[number] = replace(others[number], **change)
    return replace(record, candidates=tuple(others))


def beside(place: Vec3, metres: float) -> Vec3:
    return (place[0], place[1] + metres, place[2])


def fleet_at(record: EpisodeRecord, away_m: float) -> EpisodeRecord:
    """Return the record with its fleet moved along the first drone's line of sight to `away_m` from the target."""
    goal = World(record).target_centre(0.0)
    first = record.starts[0].position_ned
    share = 1.0 - away_m / math.dist(first[:2], goal[:2])
    north, east = share * (goal[0] - first[0]), share * (goal[1] - first[1])
    return replace(
        record,
        starts=tuple(
            StartPose((s.position_ned[0] + north, s.position_ned[1] + east, s.position_ned[2]), s.yaw_deg)
            for s in record.starts
        ),
    )


@pytest.mark.parametrize("record", [SIGNS, PLATES], ids=lambda r: r.id)
def test_shipped_records_pass_all_rules(record: EpisodeRecord) -> None:
    assert red(record) == set()


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda r: replace(r, candidates=r.candidates[:2]), "the number of candidates"),
        (lambda r: candidate(r, 1, paint="brown" if r.target.paint != "brown" else "red"), "the candidates' look"),
        (lambda r: candidate(r, 0, inscription=r.target.inscription), "the inscriptions"),
        (lambda r: candidate(r, 0, inscription=None), "the inscriptions"),
        (lambda r: candidate(r, 0, position_ned=beside(r.target.position_ned, 3.0)), "the nearest pair of candidates"),
        (lambda r: candidate(r, 0, position_ned=beside(r.target.position_ned, 40.0)), "the widest pair of candidates"),
        (lambda r: candidate(r, 0, position_ned=(*r.candidates[0].position_ned[:2], -0.3)), "candidate-1's footing"),
        (lambda r: fleet_at(r, 40.0), "the grid's distance from the named target"),
        (lambda r: fleet_at(r, 6.0), "the best view of an inscription from a start"),
        (lambda r: replace(r, starts=r.starts[:3]), "the number of drones"),
        (lambda r: replace(r, starts=(*r.starts[:3], fleet_at(r, 30.0).starts[3])), "the distances among the drones"),
        (
            lambda r: replace(r, starts=tuple(replace(s, yaw_deg=s.yaw_deg + 150.0) for s in r.starts)),
            "the smallest visible part of a candidate",
        ),
        (lambda r: replace(r, instruction="go to the sign"), "the instruction's inscription"),
        (
            lambda r: replace(r, instruction=f"{r.instruction}, not {r.candidates[0].inscription}"),
            "other inscriptions in the instruction",
        ),
    ],
)
def test_each_fault_fails_its_own_rule(change: Callable[[EpisodeRecord], EpisodeRecord], rule: str) -> None:
    assert rule in red(change(SIGNS))


def second_drone_before(record: EpisodeRecord, which: int, aside_m: float) -> EpisodeRecord:
    """Return the record with its second drone close to the lens of the first.

    The first drone faces the object `which`: 0 is the target, others are candidates. The second drone is `aside_m` to
    the side of this line of sight.
    """
    world = World(record)
    things = [world.target, *(i for i in world.scene.instances if i.name.startswith("candidate-"))]
    first, goal = record.starts[0], things[which].centre_ned
    ahead = bearing_deg(first.position_ned, goal)
    c, s = math.cos(math.radians(ahead)), math.sin(math.radians(ahead))
    x, _, z = sight.CAMERA.offset_frd
    lens = (first.position_ned[0] + x * c, first.position_ned[1] + x * s, first.position_ned[2] + z)
    share = 0.35 / math.dist(lens, goal)
    north, east, down = (a + share * (b - a) for a, b in zip(lens, goal, strict=True))
    there = StartPose((north - aside_m * s, east + aside_m * c, down), ahead)
    return replace(record, starts=(replace(first, yaw_deg=ahead), there, *record.starts[2:]))


@pytest.mark.parametrize(
    ("which", "rule"),
    [(0, "the visible share of the target when faced"), (2, "the smallest visible part of a candidate")],
)
def test_a_drone_in_the_line_of_sight_hides_the_target_or_candidate(which: int, rule: str) -> None:
    def measured(aside_m: float) -> str:
        findings = check(World(second_drone_before(FACING, which, aside_m)))
        return next(f.measured for f in findings if f.rule == rule)

    assert float(measured(0.0).split()[0]) == 0.0
    assert rule in red(second_drone_before(FACING, which, 0.0))
    assert float(measured(3.0).split()[0]) > 0.4


def test_an_asset_without_an_inscription_fails_the_inscription_rule() -> None:
    bare = replace(SIGNS, target=replace(SIGNS.target, asset="quadrotor"))
    bare = replace(bare, candidates=tuple(replace(c, asset="quadrotor") for c in bare.candidates))
    assert "the inscription" in red(bare)


def facing(distance_m: float, turned_deg: float) -> float:
    """Return the letter height (px) of the target sign, turned by `turned_deg`, for a drone in front of its board."""
    world = World(SIGNS)
    one = replace(world.target, position_ned=(0.0, 0.0, 0.0), yaw=math.pi + math.radians(turned_deg))
    other = Instance(99, "other", "sign", one.mesh, (500.0, 0.0, 0.0))
    here = (-distance_m - sight.CAMERA.offset_frd[0], 0.0, one.centre_ned[2])
    return candidates.letters_px(one, str(SIGNS.target.inscription), Solids([other]), here, 0.0)


def test_letter_height_matches_the_pinhole_model() -> None:
    assert facing(10.0, 0.0) == pytest.approx(320.0 * 0.136 / 10.0, rel=0.03)
    assert facing(20.0, 0.0) == pytest.approx(facing(10.0, 0.0) / 2.0, rel=0.03)
    assert facing(10.0, 60.0) == pytest.approx(facing(10.0, 0.0), rel=0.08)
    assert facing(10.0, 88.0) == 0.0


somewhere = st.tuples(*[st.floats(-1000.0, 1000.0)] * 3)
near = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-4.0, 1.0))


@settings(max_examples=12, deadline=None)
@given(place=somewhere | near, spot=somewhere | near, yaw=st.floats(-360.0, 360.0), count=st.integers(1, 8))
def test_every_readable_record_gets_findings(place: Vec3, spot: Vec3, yaw: float, count: int) -> None:
    """Nonsense fails rules and never raises: a drone inside its target, below the ground, or a kilometre away."""
    wild = replace(
        SIGNS,
        target=replace(SIGNS.target, position_ned=spot, yaw_deg=yaw),
        starts=tuple(StartPose((place[0] + 2.0 * k, place[1], place[2]), yaw) for k in range(count)),
    )
    findings = check(World(wild))
    assert any(not f.passed for f in findings)
    assert all(f.field and f.rule and "\n" not in f.sentence for f in findings)
