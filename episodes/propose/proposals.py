"""From a map, a cell and a seed to records that pass every check."""

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

from dronecats.border.errors import UsageError
from dronecats.border.frames import Vec3
from episodes import catalogue, maps
from episodes.check.rules import check
from episodes.propose import commanding, painted, referred
from episodes.propose.draft import Draft
from episodes.propose.site import Site, no_room
from episodes.record import CELLS, MAX_SEED, VERSION, EpisodeRecord
from episodes.world import World

MOST = 99  # records of one batch: their ids have two digits
APART_M = 6.0  # between the targets of a batch
EAGER = 40  # drafts after which targets may stand where another record of the batch has one
TRIES = 160  # drafts of one record


@dataclass(frozen=True, slots=True)
class Batch:
    """A request for records."""

    map: str
    cell: str
    first: int  # number in the first record's id
    count: int
    seed: int
    map_seed: int = 1


def propose(batch: Batch) -> list[EpisodeRecord]:
    """Return as many records as are asked for, all of which pass the checks; equal requests give equal records.

    Raises UsageError for a request that cannot be, or when the map has no room for so many.
    """
    must_be_possible(batch)
    site = Site(batch.map, batch.map_seed)
    rng = random.Random(f"{batch.map} {batch.map_seed} {batch.cell} {batch.seed}")
    drafts = _source(site, batch.cell, rng)
    found: list[EpisodeRecord] = []
    places: list[Vec3] = []
    for number in range(batch.first, batch.first + batch.count):
        for tried in range(TRIES):
            draft = next(drafts, None)
            if draft is None:
                raise no_room(f"{batch.cell} episode on {batch.map}")
            if tried < EAGER and any(math.dist(draft.place_ned, other) < APART_M for other in places):
                continue
            record = _record(batch, number, draft)
            if all(finding.passed for finding in check(World(record))):
                found.append(record)
                places.append(draft.place_ned)
                break
        else:
            raise no_room(f"{batch.cell} episode on {batch.map}")
    return found


def first_free(name: str, cell: str) -> int:
    """Return the number after those of the shipped episodes of a map and cell: an id means one episode only."""
    numbers = [one.removeprefix(f"{name}-{cell}-") for one in catalogue.ids()]
    return max((int(number) for number in numbers if number.isdigit()), default=0) + 1


def must_be_possible(batch: Batch) -> None:
    """Raise UsageError for a request that no map and no search could fulfil."""
    if batch.cell not in CELLS:
        raise UsageError(f"cell '{batch.cell}' does not exist: use one of {', '.join(CELLS)}.")
    if batch.map not in maps.names():
        raise UsageError(f"map '{batch.map}' does not exist: use one of {', '.join(maps.names())}.")
    if not 1 <= batch.count <= MOST or not 1 <= batch.first <= MOST or batch.first + batch.count - 1 > MOST:
        raise UsageError(f"--count and --first want numbers so that ids run within 01 … {MOST}.")
    if not 0 <= batch.seed <= MAX_SEED or not 0 <= batch.map_seed <= MAX_SEED:
        raise UsageError(f"--seed and --map-seed want a whole number from 0 to {MAX_SEED}.")


def _source(site: Site, cell: str, rng: random.Random) -> Iterator[Draft]:
    """Return the drafts of a cell, without end while the map has places."""
    if cell == "commanding":
        return commanding.drafts(site, rng)
    if site.places.landmarks:  # a map whose own fixtures are the targets, told apart by where they stand
        return referred.drafts(site, cell, rng)
    return painted.drafts(site, cell, rng)


def _record(batch: Batch, number: int, draft: Draft) -> EpisodeRecord:
    here, goal = draft.starts[0].position_ned, draft.goal_ned
    return EpisodeRecord(
        version=VERSION,
        id=f"{batch.map}-{batch.cell}-{number:02d}",
        map=batch.map,
        map_seed=batch.map_seed,
        cell=batch.cell,
        instruction=draft.instruction,
        target=draft.target,
        starts=draft.starts,
        start_distance_m=round(math.dist(here, goal), 2),
        bearing_deg=round(math.degrees(math.atan2(goal[1] - here[1], goal[0] - here[0])) % 360.0, 1) % 360.0,
        visible_at_start=draft.visible,
        seed=draft.seed,
        candidates=draft.candidates,
    )
