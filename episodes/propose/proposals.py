"""From a map, a cell and a seed to records that pass every check."""

import math
import random
from collections.abc import Generator
from dataclasses import dataclass

from episodes import catalogue, maps
from episodes.check import spread
from episodes.check.layout import Layout, layout
from episodes.check.limits import SPOTTED_PX
from episodes.check.rules import check
from episodes.check.sight import bearing_deg
from episodes.propose import commanding, painted, referred
from episodes.propose.draft import Draft, flight_seed, yaw_deg
from episodes.propose.site import Site, no_room, start
from episodes.propose.spread import Share, shares
from episodes.record import CELLS, HIDDEN, MAX_SEED, VERSION, EpisodeRecord
from episodes.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3

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
    kept: str | None = None  # id of a shipped record whose target, place and words the first one takes over


def propose(batch: Batch) -> list[EpisodeRecord]:
    """Return as many records as are asked for, all of which pass the checks; equal requests give equal records.

    Raises UsageError for a request that cannot be, or when the map has no room for so many.
    """
    must_be_possible(batch)
    site = Site(batch.map, batch.map_seed)
    rng = random.Random(f"{batch.map} {batch.map_seed} {batch.cell} {batch.seed}")
    drafts = _source(site, batch.cell, rng)
    next(drafts, None)
    found: list[EpisodeRecord] = []
    places: list[Vec3] = []
    layouts: list[Layout] = []
    for number, share in enumerate(shares(batch.count, rng), batch.first):
        for tried in range(TRIES):
            if batch.kept and number == batch.first:
                draft = _kept(site, catalogue.load(batch.kept), share, rng)
            else:
                draft = _sent(drafts, share)
            if draft is None:
                raise no_room(f"{batch.cell} episode on {batch.map}")
            if tried < EAGER and any(math.dist(draft.place_ned, other) < APART_M for other in places):
                continue
            record = _record(batch, number, draft)
            world = World(record)
            if not all(finding.passed for finding in check(world)):
                continue
            layouts.append(layout(world))
            if _evens(batch, layouts):
                found.append(record)
                places.append(draft.place_ned)
                break
            layouts.pop()
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


def _evens(batch: Batch, layouts: list[Layout]) -> bool:
    """Return whether a batch that is judged by its spread may still come to be even with these among its records."""
    if batch.cell == "commanding":
        return (layouts[-1].fewest_px or 0) >= SPOTTED_PX
    limits = spread.passable(batch.cell not in HIDDEN, batch.count)
    within = all(count <= limit for count, limit in zip(spread.passed(layouts), limits, strict=True))
    return batch.count < spread.ENOUGH or within


def _kept(site: Site, record: EpisodeRecord, share: Share, rng: random.Random) -> Draft | None:
    """Return the draft of a record that stands, with a yaw that is drawn; None where the target fits no picture."""
    thing, place = site.placed(record.target), record.starts[0].position_ned
    yaw = yaw_deg(record.cell, bearing_deg(place, thing.centre_ned), site.framed(thing, place), share.turn)
    if yaw is None:
        return None
    return Draft(
        target=record.target,
        place_ned=thing.position_ned,
        goal_ned=thing.centre_ned,
        starts=(start(place, yaw),),
        visible=record.visible_at_start,
        instruction=record.instruction,
        seed=flight_seed(rng),
    )


def _sent(drafts: Generator[Draft | None, Share, None], share: Share) -> Draft | None:
    """Return the next draft for a share; None when there are no more."""
    try:
        return drafts.send(share)
    except StopIteration:
        return None


def _source(site: Site, cell: str, rng: random.Random) -> Generator[Draft | None, Share, None]:
    """Return the drafts of a cell, without end while the map has places; it waits for the first share."""
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
