"""Proposes records that pass every check, from a map, a cell and a seed."""

import math
import random
from collections.abc import Generator
from dataclasses import dataclass

from episodes import maps
from episodes.authoring.check import rules
from episodes.authoring.check.finding import SPOTTED_PX
from episodes.authoring.check.rules import Layout, check, layout
from episodes.authoring.propose import commanding, one_drone
from episodes.authoring.propose.draft import Draw, Proposal, shares
from episodes.authoring.propose.site import Site
from episodes.records import catalogue
from episodes.records.record import CELLS, HIDDEN, MAX_SEED, VERSION, EpisodeRecord
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3, bearing_deg

RECORDS_MAX = 99  # highest number in an id, which has two digits
APART_M = 6.0  # the targets of a request are usually this far apart
SPACED_TRIES = 40  # after this many drafts, a target may be nearer than APART_M to the target of another record
TRIES = 160  # at most this many drafts for one record


@dataclass(frozen=True, slots=True)
class RecordRequest:
    """A request for records."""

    map: str
    cell: str  # kind of episode, one of CELLS
    first: int  # number in the first record's id
    count: int
    seed: int
    map_seed: int = 1


def propose(request: RecordRequest) -> list[EpisodeRecord]:
    """Return the requested number of records, which all pass the checks; equal requests give equal records.

    Raises UsageError for an impossible request, or if the map has no room for so many records.
    """
    validate(request)
    site = Site(request.map, request.map_seed)
    rng = random.Random(f"{request.map} {request.map_seed} {request.cell} {request.seed}")
    drafts = _source(site, request.cell, rng)
    next(drafts, None)
    records: list[EpisodeRecord] = []
    places: list[Vec3] = []
    layouts: list[Layout] = []
    no_room = UsageError(
        f"no {request.cell} episode on {request.map} passes the checks. Lower --count, or try another --seed or"
        " --map-seed."
    )
    for number, share in enumerate(shares(request.count, rng), request.first):
        for tried in range(TRIES):
            try:
                draft = drafts.send(share)
            except StopIteration:
                raise no_room from None
            assert draft is not None  # a source yields None only once, before the first `Draw`
            if tried < SPACED_TRIES and any(math.dist(draft.placed.position_ned, place) < APART_M for place in places):
                continue
            record = _record(request, number, draft)
            world = World(record)
            if not all(finding.passed for finding in check(world)):
                continue
            layouts.append(layout(world))
            if _keeps_suite_rules(request, layouts):
                records.append(record)
                places.append(draft.placed.position_ned)
                break
            layouts.pop()
        else:
            raise no_room
    return records


def first_free(name: str, cell: str) -> int:
    """Return the number after the highest number of the shipped episodes of a map and cell."""
    numbers = [id_.removeprefix(f"{name}-{cell}-") for id_ in catalogue.ids()]
    return max((int(number) for number in numbers if number.isdigit()), default=0) + 1


def validate(request: RecordRequest) -> None:
    """Raise UsageError for an unknown cell or map, or for a number out of range."""
    if request.cell not in CELLS:
        raise UsageError(f"cell '{request.cell}' does not exist. Choose one of {', '.join(CELLS)}.")
    if request.map not in maps.names():
        raise UsageError(f"map '{request.map}' does not exist. Choose one of {', '.join(maps.names())}.")
    if (
        not 1 <= request.count <= RECORDS_MAX
        or not 1 <= request.first <= RECORDS_MAX
        or request.first + request.count - 1 > RECORDS_MAX
    ):
        raise UsageError(f"--count and --first must keep the numbers of the ids within 01 … {RECORDS_MAX}.")
    if not 0 <= request.seed <= MAX_SEED or not 0 <= request.map_seed <= MAX_SEED:
        raise UsageError(f"--seed and --map-seed must be whole numbers from 0 to {MAX_SEED}.")


def _keeps_suite_rules(request: RecordRequest, layouts: list[Layout]) -> bool:
    """Return whether the records so far keep the rules about a suite that the search can check early."""
    if request.cell == "commanding":
        return (layouts[-1].fewest_px or 0) >= SPOTTED_PX
    limits = rules.passable(request.cell not in HIDDEN, request.count)
    within = all(count <= limit for count, limit in zip(rules.passed(layouts), limits, strict=True))
    return request.count < rules.ENOUGH or within


def _source(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Return the generator of a cell's drafts. It yields None first, then a draft for each `Draw` sent in."""
    if cell == "commanding":
        return commanding.drafts(site, rng)
    if site.places.landmarks:  # the instruction identifies targets by place
        return one_drone.referred_drafts(site, cell, rng)
    return one_drone.painted_drafts(site, cell, rng)


def _record(request: RecordRequest, number: int, draft: Proposal) -> EpisodeRecord:
    here, goal = draft.starts[0].position_ned, draft.placed.centre_ned
    return EpisodeRecord(
        version=VERSION,
        id=f"{request.map}-{request.cell}-{number:02d}",
        map=request.map,
        map_seed=request.map_seed,
        cell=request.cell,
        instruction=draft.instruction,
        target=draft.target,
        starts=draft.starts,
        start_distance_m=round(math.dist(here, goal), 2),
        bearing_deg=round(bearing_deg(here, goal), 1) % 360.0,
        visible_at_start=draft.visible,
        seed=draft.seed,
        candidates=draft.candidates,
    )
