"""A decision of a flown episode beside what was true of its picture."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dronecats.judge.measured import SAME_S
from dronecats.judge.metrics.value import MetricValue
from foundation.measurement import LARGE
from foundation.protocol import GO
from foundation.run_folder.reading import Logs
from foundation.run_folder.rows import Decision, FrameTruth


@dataclass(frozen=True, slots=True)
class Pointed:
    """What a `go` says."""

    x: float  # 0 … 1000, left to right
    y: float  # 0 … 1000, top to bottom
    depth_m: float  # m along the optical axis


@dataclass(frozen=True, slots=True)
class FlownStep:
    """One decision, of one drone."""

    decision: Decision
    truth: FrameTruth | None  # of the picture that it was made on; None: the logger has none, or of another time
    asks: bool  # the first of the decisions that one reply brought: of a fleet the others share what it cost
    counts: bool  # it was made within the cap
    go: Pointed | None  # None: another action, or none

    @property
    def in_view(self) -> FrameTruth | None:
        """The truth where the target was in the picture and seen."""
        return self.truth if self.truth is not None and self.truth.visible else None


def flown_steps(logs: Logs, cap_s: float) -> tuple[FlownStep, ...]:
    """Return the decisions, in the order of the log."""
    told, asked = [], set[int]()
    for decision in logs.decisions:
        frame = logs.frames.get((decision.drone, decision.frame_id))
        same = frame is not None and abs(frame.t - decision.t_frame) <= SAME_S
        first = decision.step not in asked
        asked.add(decision.step)
        told.append(FlownStep(decision, frame if same else None, first, decision.t_decided <= cap_s, pointed(decision)))
    return tuple(told)


def pointed(decision: Decision) -> Pointed | None:
    """Return the point and the depth of a go; None of any other action, and of one that says neither."""
    if decision.kind != GO or decision.action is None:
        return None
    point, depth_m = decision.action.get("point"), decision.action.get("depth_m")
    numbers = [*point, depth_m] if isinstance(point, list) and len(point) == 2 else []
    told = [float(n) for n in numbers if isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < LARGE]
    return Pointed(*told) if len(told) == 3 else None


def of_counted(steps: Iterable[FlownStep], value: Callable[[FlownStep], MetricValue]) -> list[MetricValue]:
    """Return a value per decision, None after the cap."""
    return [value(step) if step.counts else None for step in steps]


def of_questions(steps: Iterable[FlownStep], value: Callable[[Decision], MetricValue]) -> list[MetricValue]:
    """Return what a question cost, once, at the first drone that it was for; None of the others and after the cap."""
    return [value(step.decision) if step.counts and step.asks else None for step in steps]
