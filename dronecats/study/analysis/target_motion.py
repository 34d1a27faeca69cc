"""How far a target moves while one decision is made, beside how wide the picture is where it stands.

From what the logger wrote of the pictures: a step is the time from its picture to the next one of its drone. The width
is that of the plane across the optical axis at the target's depth (paper, appendix "Execution": 90° across).
"""

import math
from collections.abc import Sequence

from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue
from foundation.camera import CameraModel

MOVES_M = 0.05  # m from one picture to the next, below which a target stands: what a place in a log is rounded to
ACROSS = 2.0 * math.tan(math.radians(CameraModel().hfov_deg) / 2.0)  # m of width for each m of depth


def target_moved(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step the distance (m) between the target's places at its picture and at the next; None of the last."""
    following = _following(flight.steps)
    return [_moved(step, after) for step, after in zip(flight.steps, following, strict=True)]


def view_width(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step how wide (m) the picture is at the target's depth; None where it is not ahead."""
    return [_width(step) for step in flight.steps]


def decision_period(flight: JudgedFlight) -> list[MetricValue]:
    """Return per step the time (s) from its picture to the next one of its drone; None of the last."""
    following = _following(flight.steps)
    return [
        None if after is None or not step.counts else after.decision.t_frame - step.decision.t_frame
        for step, after in zip(flight.steps, following, strict=True)
    ]


def _following(steps: Sequence[FlightStep]) -> list[FlightStep | None]:
    """Return the next step of the same drone for each."""
    later: dict[int, FlightStep] = {}
    found: list[FlightStep | None] = []
    for step in reversed(steps):
        found.append(later.get(step.decision.drone))
        later[step.decision.drone] = step
    return found[::-1]


def _moved(step: FlightStep, after: FlightStep | None) -> float | None:
    if after is None or not step.counts or step.truth is None or after.truth is None:
        return None
    here, there = step.truth.target_ned, after.truth.target_ned
    return None if here is None or there is None else math.dist(here, there)


def _width(step: FlightStep) -> float | None:
    truth = step.truth
    if truth is None or not step.counts or truth.target_frd is None or truth.target_frd[0] <= 0.0:
        return None
    return ACROSS * truth.target_frd[0]


OURS = ""  # no section of the paper
METRICS = (
    Metric(
        name="target_moved_m", title="Target moved", unit="m", level="step", better="less",
        definition="distance between the target's places at this picture and at the drone's next",
        paper=OURS, of=target_moved,
    ),
    Metric(
        name="view_width_m", title="Width of the view", unit="m", level="step", better=None,
        definition="width of the picture at the target's depth, where it is ahead",
        paper=OURS, of=view_width,
    ),
    Metric(
        name="decision_period_s", title="Decision period", unit="s", level="step", better="less",
        definition="time from this picture to the drone's next",
        paper=OURS, of=decision_period,
    ),
)  # fmt: skip
