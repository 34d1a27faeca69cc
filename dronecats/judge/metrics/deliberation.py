"""What a `think` bought: the paper's three comparisons with ordinary steps. Paper, "Test-Time Deliberation".

They are observations of what was flown, no experiment: a pilot thinks where it is in trouble. The paper leaves open
over which steps it measures; here a step is looked at between the frames of the three steps before its own and those of
the three after it.
"""

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from foundation.protocol import THINK

AFTER = 3  # steps
MATCHED_M = 0.25  # m per step: steps whose closing rates fall into one such interval are matched
STALL_M, BROKEN_M = 0.5, 1.0  # m closed in three steps: less is a stall, as much after it has broken it


@dataclass(frozen=True, slots=True)
class StepOutlook:
    """One step of one drone, with what was before and what came after. None: too near to the begin or the end."""

    think: bool
    closing_m: float | None  # m closed between the frame before and its own
    gained_m: float | None  # m per step closed in the three steps after it
    stalled: bool | None  # less than 0.5 m was closed in the three steps before it
    broken: bool | None  # 1 m or more was closed in the three steps after it
    lost: bool | None  # the target was not in view
    regained: bool | None  # it was at one of the frames of the three steps after


@dataclass(frozen=True, slots=True)
class Followed:
    """How often something followed a think, and an ordinary step."""

    think: int
    of_thinks: int
    other: int
    of_others: int


@dataclass(frozen=True, slots=True)
class Deliberation:
    """The three comparisons."""

    thinks: int  # steps that think
    matched: int  # of these, those that have ordinary steps of the same closing rate
    gain_m_per_step: float | None  # mean closing rate after them less that after their matches; None: no matches
    stalls: Followed  # broken within three steps, of the stalled
    losses: Followed  # target seen again within three steps, of those without it in view


def outlooks(flight: JudgedFlight) -> list[StepOutlook]:
    """Return every step within the cap, drone by drone."""
    drones: dict[int, list[FlightStep]] = {}
    for step in flight.steps:
        if step.counts:
            drones.setdefault(step.decision.drone, []).append(step)
    return [outlook for _, steps in sorted(drones.items()) for outlook in _of_drone(steps)]


def deliberation(steps: Iterable[StepOutlook]) -> Deliberation:
    """Return the comparisons over all of these steps."""
    told = list(steps)
    alike: dict[int, list[float]] = {}  # what ordinary steps gained, by their closing rate
    for step in told:
        if not step.think and step.closing_m is not None and step.gained_m is not None:
            alike.setdefault(_interval(step.closing_m), []).append(step.gained_m)
    means = {rate: statistics.fmean(gained) for rate, gained in alike.items()}
    gains = [
        step.gained_m - means[_interval(step.closing_m)]
        for step in told
        if step.think and step.closing_m is not None and step.gained_m is not None
        if _interval(step.closing_m) in means
    ]
    return Deliberation(
        thinks=sum(step.think for step in told),
        matched=len(gains),
        gain_m_per_step=statistics.fmean(gains) if gains else None,
        stalls=_compared([(step.think, step.broken) for step in told if step.stalled]),
        losses=_compared([(step.think, step.regained) for step in told if step.lost]),
    )


def _of_drone(steps: Sequence[FlightStep]) -> list[StepOutlook]:
    away = [step.truth.distance_m if step.truth else None for step in steps]
    seen = [step.truth.visible if step.truth else None for step in steps]
    return [
        StepOutlook(
            think=step.decision.kind == THINK,
            closing_m=_closed(away, k - 1, k),
            gained_m=None if (gained := _closed(away, k + 1, k + 1 + AFTER)) is None else gained / AFTER,
            stalled=None if (before := _closed(away, k - AFTER, k)) is None else before < STALL_M,
            broken=None if gained is None else gained >= BROKEN_M,
            lost=None if seen[k] is None else not seen[k],
            regained=_regained(seen[k + 1 : k + 1 + AFTER]),
        )
        for k, step in enumerate(steps)
    ]


def _closed(away: Sequence[float | None], first: int, last: int) -> float | None:
    """Return the metres closed between two frames."""
    if first < 0 or last >= len(away):
        return None
    begin, end = away[first], away[last]
    return None if begin is None or end is None else begin - end


def _regained(seen: Sequence[bool | None]) -> bool | None:
    """Return whether it is seen at one of the frames that follow; None where they are too few to say no."""
    if any(seen):
        return True
    return False if len(seen) == AFTER and None not in seen else None


def _interval(closing_m: float) -> int:
    return math.floor(closing_m / MATCHED_M)


def _compared(told: Sequence[tuple[bool, bool | None]]) -> Followed:
    known = [(think, what) for think, what in told if what is not None]
    return Followed(
        think=sum(what for think, what in known if think),
        of_thinks=sum(think for think, _ in known),
        other=sum(what for think, what in known if not think),
        of_others=sum(not think for think, _ in known),
    )
