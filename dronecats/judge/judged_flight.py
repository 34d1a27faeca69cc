"""A flight read from its folder, with the files that the judge may use: the input of every metric.

`dronecats.report.recorded.flight` adds the data of MAVLink and of the world.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from dronecats.judge.episode import outcome
from dronecats.judge.verdict import SAME_S, Measured, declarations, finished, in_order, measured
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, json_object, read
from foundation.run_folder.results import SCORED, Verdict
from foundation.run_folder.rows import Decision, FrameTruth, PointedGo


@dataclass(frozen=True, slots=True)
class FlightStep:
    """One decision of one drone with the truth of its picture."""

    decision: Decision
    truth: FrameTruth | None  # of its picture; None: the logger has none, or one of another time
    is_question: bool  # the first decision of its reply, which carries the cost of the reply for the fleet
    counts: bool  # it was made within the cap
    go: PointedGo | None  # None: another action, or none

    @property
    def in_view(self) -> FrameTruth | None:
        """The truth if the target was visible in the picture."""
        return self.truth if self.truth is not None and self.truth.visible else None


@dataclass(frozen=True)
class JudgedFlight:
    """One flight of one episode, read from its folder alone; verdict and steps are computed once."""

    folder: Path
    record: dict[str, Any]  # the record that was flown, as episode.json holds it; {}: there is none
    logs: Logs
    delta_m: float = RADIUS_M  # m, success radius
    cap_s: float = CAP_S  # s, declarations after it do not count

    @classmethod
    def read(cls, folder: Path, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Self:
        """Return the flight of an episode folder. Raises UsageError when a log is missing or damaged."""
        return cls(folder, json_object(folder / layout.EPISODE) or {}, read(folder), delta_m, cap_s)

    @property
    def id(self) -> str:
        """The id of the record, or the folder's name without a record."""
        return str(self.record.get("id", self.folder.resolve().name))

    @property
    def cell(self) -> str:
        """approaching, searching, tracking, search-and-track or commanding; empty: unknown."""
        return str(self.record.get("cell", ""))

    @property
    def map(self) -> str:
        """The map's name; empty: unknown."""
        return str(self.record.get("map", ""))

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict, derived anew from the logs."""
        return outcome(self.logs, self.delta_m, self.cap_s)

    @property
    def scored(self) -> bool:
        """Whether it is a success or a failure."""
        return self.verdict.outcome in SCORED

    @cached_property
    def steps(self) -> tuple[FlightStep, ...]:
        """Its decisions, in the order of the log."""
        steps, answered_steps = [], set[int]()
        for decision in self.logs.decisions:
            frame = self.logs.frames.get((decision.drone, decision.frame_id))
            is_same = frame is not None and abs(frame.t - decision.t_frame) <= SAME_S
            is_question, counts = decision.step not in answered_steps, decision.t_decided <= self.cap_s
            answered_steps.add(decision.step)
            steps.append(FlightStep(decision, frame if is_same else None, is_question, counts, decision.go))
        return tuple(steps)

    @cached_property
    def declarations(self) -> tuple[Measured, ...]:
        """The declarations that count, pooled over the fleet, in their order; none without truth."""
        return tuple(in_order(declarations(self.logs, self.cap_s), self.cap_s)) if self.logs.true else ()

    @cached_property
    def all_declarations(self) -> tuple[Measured, ...]:
        """All declarations, also after the cap, in the order of the log."""
        return tuple(measured(decision, self.logs) for decision in finished(self.logs))

    def picture_path(self, decision: Decision) -> Path | None:
        """Return the file of a decision's picture; None if the folder has none."""
        path = self.folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
        return path if path.is_file() else None
