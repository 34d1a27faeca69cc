"""A commanding record with another number of drones: the first of its four starts, or more on the same lattice."""

import itertools
import math
from dataclasses import replace

import pytest

from episodes.authoring.check.rules import check
from episodes.records import catalogue, formation
from episodes.records.formation import with_drones
from episodes.records.record import parse
from episodes.world.world import World
from foundation.errors import UsageError

BLOCKS = "blocks-commanding-01"


def test_up_to_four_drones_use_the_first_starts_of_the_record():
    for drones in (1, 2, 3, 4):
        record = catalogue.load(BLOCKS)
        assert with_drones(record, drones) == replace(record, starts=record.starts[:drones]), drones


@pytest.mark.parametrize(("episode", "drones"), [(BLOCKS, 6), (BLOCKS, 8), ("residential-commanding-10", 8)])
def test_more_drones_extend_the_lattice_and_fail_only_the_number_rule(episode, drones):
    record = catalogue.load(episode)
    more = with_drones(record, drones)
    assert parse(more.to_json(), "flown") == more
    assert (more.starts[:4], len(more.starts)) == (record.starts, drones)
    (first, second, third, _), right, ahead = record.starts, [], []
    for a, b, c in zip(first.position_ned[:2], second.position_ned[:2], third.position_ned[:2], strict=True):
        right.append((b - a) / 2.0)
        ahead.append((a - c) / 2.0)
    for start in more.starts:
        off = [b - a for a, b in zip(first.position_ned, start.position_ned, strict=True)]
        for axis in (right, ahead):
            steps = sum(o * x for o, x in zip(off, axis, strict=False)) / 2.0
            assert steps == pytest.approx(round(steps), abs=0.01)
        assert start.yaw_deg == first.yaw_deg
        assert off[2] == pytest.approx(0.0, abs=1e-6)
    gaps = [math.dist(a.position_ned, b.position_ned) for a, b in itertools.combinations(more.starts, 2)]
    assert min(gaps) == pytest.approx(2.0, abs=0.01)
    red = [finding.rule for finding in check(World(more)) if not finding.passed]
    assert red == ["the number of drones"]


def test_the_starts_of_more_drones_are_reproducible():
    record = catalogue.load(BLOCKS)
    assert with_drones(record, 8) == with_drones(record, 8)


def test_additional_places_are_outside_the_square_and_not_ahead_of_it():
    starts = catalogue.load(BLOCKS).starts
    ahead = [a - b for a, b in zip(starts[0].position_ned, starts[2].position_ned, strict=True)]
    places = list(formation.places(starts))
    assert len(places) > 30
    for place in places:
        off = [b - a for a, b in zip(starts[0].position_ned, place.position_ned, strict=True)]
        assert sum(o * a for o, a in zip(off, ahead, strict=True)) < 0.1
        assert min(math.dist(place.position_ned, start.position_ned) for start in starts) > 1.9


def test_impossible_formations_are_rejected_in_one_sentence():
    for episode, drones, parts in (
        (BLOCKS, 0, "1 to 8, .*0"),
        (BLOCKS, 9, "1 to 8, .*9"),
        ("campus-approaching-01", 2, "campus-approaching-01"),
    ):
        with pytest.raises(UsageError, match=parts):
            with_drones(catalogue.load(episode), drones)


def test_starts_that_are_not_a_square_are_rejected():
    record = catalogue.load(BLOCKS)
    for starts in (record.starts[:3], (*record.starts[:3], replace(record.starts[3], position_ned=(0.0, 0.0, -1.5)))):
        with pytest.raises(UsageError, match="2 m"):
            with_drones(replace(record, starts=starts), 5)


def test_the_error_states_how_many_drones_have_room(monkeypatch):
    record = catalogue.load(BLOCKS)
    wide = with_drones(record, 6)
    monkeypatch.setattr(formation, "has_room", lambda world, standing, place: place == wide.starts[4])
    with pytest.raises(UsageError, match=rf"{BLOCKS}\b.*\b5\b"):
        with_drones(record, 6)
