"""What is told of single steps at each level: the rate that was served, and how far targets moved meanwhile."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from dronecats.judge.metrics.metric import quantile
from dronecats.study.analysis.levels import LevelStep, level_steps
from dronecats.study.analysis.studied import Studied, StudiedFlight, comparable
from dronecats.study.analysis.target_motion import MOVES_M

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RATE, LATENCY, MOVED, WIDTH, PERIOD = "rate_hz", "latency_s", "target_moved_m", "view_width_m", "decision_period_s"


@dataclass(frozen=True, slots=True)
class StepQuantiles:
    """A metric of steps over all steps that have it."""

    steps: int
    at: tuple[float, ...]  # one of each of QUANTILES; empty: no step has it


@dataclass(frozen=True, slots=True)
class ServedAt:
    """At which rate an entrant was served at a level."""

    entrant: str
    step: LevelStep
    rate_hz: StepQuantiles
    latency_s: StepQuantiles


@dataclass(frozen=True, slots=True)
class MotionAt:
    """How moving targets moved during one decision at a level, of one entrant and cell or all."""

    entrant: str
    cell: str
    step: LevelStep
    episodes: int  # whose target moves
    period_s: StepQuantiles
    moved_m: StepQuantiles
    width_m: StepQuantiles  # of the view, at the target
    share: StepQuantiles  # of the first in the second, step by step


def served(studied: Studied, factor: int) -> list[ServedAt]:
    """Return the rates and latencies of every entrant at each level of a factor; fleets' joint questions once."""
    found = []
    for entrant in studied.entrants:
        flown = comparable(studied.of(entrant), factor)
        for step in level_steps(studied.factors[factor]):
            there = [each for each in flown if each.levels[factor] in step.members]
            told = ServedAt(entrant, step, _quantiles(_steps(there, RATE)), _quantiles(_steps(there, LATENCY)))
            found += [told] if told.rate_hz.at else []
    return found


def motions(studied: Studied, factor: int) -> list[MotionAt]:
    """Return how targets that move have moved, for every entrant and cell at each level of a factor."""
    found = []
    for entrant, cell in studied.lines():
        flown = [each for each in comparable(studied.of(entrant, cell), factor) if moves(each)]
        for step in level_steps(studied.factors[factor]):
            there = [each for each in flown if each.levels[factor] in step.members]
            if there:
                found.append(_motion(entrant, cell, step, there))
    return found


def moves(flight: StudiedFlight) -> bool:
    """Return whether a flight's target moves: on more than half of its steps, by more than a log rounds."""
    told = _steps([flight], MOVED)
    return bool(told) and statistics.median(told) > MOVES_M


def _motion(entrant: str, cell: str, step: LevelStep, flights: Sequence[StudiedFlight]) -> MotionAt:
    shares = [
        float(moved) / float(width)
        for each in flights
        for moved, width in zip(each.scored.steps[MOVED], each.scored.steps[WIDTH], strict=True)
        if moved is not None and width
    ]
    return MotionAt(
        entrant=entrant,
        cell=cell,
        step=step,
        episodes=len({each.scored.episode for each in flights}),
        period_s=_quantiles(_steps(flights, PERIOD)),
        moved_m=_quantiles(_steps(flights, MOVED)),
        width_m=_quantiles(_steps(flights, WIDTH)),
        share=_quantiles(shares),
    )


def _steps(flights: Sequence[StudiedFlight], metric: str) -> list[float]:
    return [float(v) for each in flights for v in each.scored.steps.get(metric, ()) if v is not None]


def _quantiles(values: Sequence[float]) -> StepQuantiles:
    told = [quantile(values, share) for share in QUANTILES]
    return StepQuantiles(len(values), tuple(value for value in told if value is not None))
