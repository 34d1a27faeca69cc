"""Computes metrics of single steps at each level of a factor: served rate, latency, and motion of the target.

A step lasts from its picture to the next picture of the drone. The width of the view is measured in the plane normal to
the optical axis at the target's depth (paper, appendix "Execution": 90° field of view).
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue, known_values, quantile
from dronecats.study.analysis.study_results import LevelStep, StudiedFlight, StudyResults, comparable, level_steps
from foundation.camera import CameraModel

MOVES_M = 0.05  # m per step; a target that moves less counts as still, since logged positions are rounded
VIEW_WIDTH_PER_DEPTH = 2.0 * math.tan(
    math.radians(CameraModel().hfov_deg) / 2.0
)  # width of the view (m) per m of depth


def target_moved(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step the distance (m) that the target moves until the drone's next picture; None: not measured."""
    return [_moved_m(step, after) for step, after in _with_next(flight.steps)]


def view_width(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step the width (m) of the view at the target's depth; None: not measured, or target not ahead."""
    return [_width_m(step) for step in flight.steps]


def decision_period(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step the time (s) until the drone's next picture; None: last step, or beyond the cap (time limit)."""
    return [
        None if after is None or not step.counts else after.decision.t_frame - step.decision.t_frame
        for step, after in _with_next(flight.steps)
    ]


def _with_next(steps: Sequence[FlightStep]) -> list[tuple[FlightStep, FlightStep | None]]:
    """Return each step with the next step of the same drone."""
    later: dict[int, FlightStep] = {}
    pairs: list[tuple[FlightStep, FlightStep | None]] = []
    for step in reversed(steps):
        pairs.append((step, later.get(step.decision.drone)))
        later[step.decision.drone] = step
    return pairs[::-1]


def _moved_m(step: FlightStep, after: FlightStep | None) -> float | None:
    if after is None or not step.counts or step.truth is None or after.truth is None:
        return None
    here, there = step.truth.target_ned, after.truth.target_ned
    return None if here is None or there is None else math.dist(here, there)


def _width_m(step: FlightStep) -> float | None:
    truth = step.truth
    if truth is None or not step.counts or truth.target_frd is None or truth.target_frd[0] <= 0.0:
        return None
    return VIEW_WIDTH_PER_DEPTH * truth.target_frd[0]


NO_PAPER_SECTION = ""  # the paper has no such metrics
METRICS = (
    Metric(
        name="target_moved_m", title="Target moved", unit="m", level="step", better="less",
        definition="distance that the target moves from this picture to the drone's next picture",
        paper=NO_PAPER_SECTION, of=target_moved,
    ),
    Metric(
        name="view_width_m", title="Width of the view", unit="m", level="step", better=None,
        definition="width of the view at the target's depth, if the target is ahead",
        paper=NO_PAPER_SECTION, of=view_width,
    ),
    Metric(
        name="decision_period_s", title="Decision period", unit="s", level="step", better="less",
        definition="time from this picture to the drone's next picture",
        paper=NO_PAPER_SECTION, of=decision_period,
    ),
)  # fmt: skip


QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RATE, LATENCY, MOVED, WIDTH, PERIOD = "rate_hz", "latency_s", "target_moved_m", "view_width_m", "decision_period_s"


@dataclass(frozen=True, slots=True)
class StepQuantiles:
    """The quantiles of a step metric, over all steps that have a value."""

    steps: int
    at: tuple[float, ...]  # in the order of QUANTILES; empty: no step has a value

    def span(self, scale: float = 1.0) -> tuple[float, float, float]:
        """Return the 5 % quantile, the median and the 95 % quantile, each times `scale`.

        Raises IndexError if no step has a value.
        """
        return scale * self.at[0], scale * self.at[len(QUANTILES) // 2], scale * self.at[-1]


@dataclass(frozen=True, slots=True)
class ServedRate:
    """The rate and latency of the replies to one entrant (pilot)."""

    entrant: str
    step: LevelStep  # the level, or group of levels
    rate_hz: StepQuantiles
    latency_s: StepQuantiles


@dataclass(frozen=True, slots=True)
class TargetMotionResult:
    """Target motion during a decision, for one entrant at one level, in one kind of episode (cell) or in all."""

    entrant: str
    cell: str
    step: LevelStep
    episodes: int  # number of episodes with a moving target
    period_s: StepQuantiles
    moved_m: StepQuantiles
    width_m: StepQuantiles  # width of the view at the target's depth
    share: StepQuantiles  # moved_m / width_m of each step


def served_rates(results: StudyResults, factor: int) -> list[ServedRate]:
    """Return the rates and latencies of every entrant at each level. A question that drones share counts once."""
    rows = []
    for entrant in results.entrants:
        flights = comparable(results, results.of(entrant), factor)
        for step in level_steps(results.factors[factor]):
            at_step = [flight for flight in flights if flight.levels[factor] in step.members]
            row = ServedRate(entrant, step, _quantiles(_steps(at_step, RATE)), _quantiles(_steps(at_step, LATENCY)))
            rows += [row] if row.rate_hz.at else []
    return rows


def target_motions(results: StudyResults, factor: int) -> list[TargetMotionResult]:
    """Return the motion of moving targets, for every entrant and cell at each level of a factor."""
    rows = []
    for entrant, cell in results.lines():
        moving = [flight for flight in comparable(results, results.of(entrant, cell), factor) if moves(flight)]
        for step in level_steps(results.factors[factor]):
            at_step = [flight for flight in moving if flight.levels[factor] in step.members]
            if at_step:
                rows.append(_target_motion(entrant, cell, step, at_step))
    return rows


def moves(flight: StudiedFlight) -> bool:
    """Return whether the target of a flight moves by more than MOVES_M on more than half of its steps."""
    values = _steps([flight], MOVED)
    return bool(values) and statistics.median(values) > MOVES_M


def _target_motion(entrant: str, cell: str, step: LevelStep, flights: Sequence[StudiedFlight]) -> TargetMotionResult:
    shares = [
        float(moved) / float(width)
        for flight in flights
        for moved, width in zip(flight.scored.steps[MOVED], flight.scored.steps[WIDTH], strict=True)
        if moved is not None and width
    ]
    return TargetMotionResult(
        entrant=entrant,
        cell=cell,
        step=step,
        episodes=len({flight.scored.episode for flight in flights}),
        period_s=_quantiles(_steps(flights, PERIOD)),
        moved_m=_quantiles(_steps(flights, MOVED)),
        width_m=_quantiles(_steps(flights, WIDTH)),
        share=_quantiles(shares),
    )


def _steps(flights: Sequence[StudiedFlight], metric: str) -> list[float]:
    return [float(v) for flight in flights for v in flight.scored.steps.get(metric, ()) if v is not None]


def _quantiles(values: Sequence[float]) -> StepQuantiles:
    return StepQuantiles(len(values), tuple(known_values(quantile(values, share) for share in QUANTILES)))
