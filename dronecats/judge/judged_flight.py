"""A flight read back from its folder, as far as the judge may look: what every metric is a function of.

`dronecats.report.recorded.flight` adds what MAVLink and the world tell of it.
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
    """One decision of one drone, beside what was true of its picture."""

    decision: Decision
    truth: FrameTruth | None  # of the picture that it was made on; None: the logger has none, or of another time
    asks: bool  # the first of the decisions that one reply brought: of a fleet the others share what it cost
    counts: bool  # it was made within the cap
    go: PointedGo | None  # None: another action, or none

    @property
    def in_view(self) -> FrameTruth | None:
        """The truth where the target was in the picture and seen."""
        return self.truth if self.truth is not None and self.truth.visible else None


@dataclass(frozen=True)
class JudgedFlight:
    """One flight of one episode. Nothing in it comes from anywhere but its folder; verdict and steps are made once."""

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
        """The record's id, of a folder without one its name."""
        return str(self.record.get("id", self.folder.resolve().name))

    @property
    def cell(self) -> str:
        """approaching, searching, tracking, search-and-track or commanding; empty: not known."""
        return str(self.record.get("cell", ""))

    @property
    def map(self) -> str:
        """The map's name; empty: not known."""
        return str(self.record.get("map", ""))

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict, derived anew from the logs."""
        return outcome(self.logs, self.delta_m, self.cap_s)

    @property
    def scored(self) -> bool:
        """Whether it is somebody's success or failure."""
        return self.verdict.outcome in SCORED

    @cached_property
    def steps(self) -> tuple[FlightStep, ...]:
        """Its decisions, in the order of the log."""
        steps, asked = [], set[int]()
        for decision in self.logs.decisions:
            frame = self.logs.frames.get((decision.drone, decision.frame_id))
            same = frame is not None and abs(frame.t - decision.t_frame) <= SAME_S
            asks, counts = decision.step not in asked, decision.t_decided <= self.cap_s
            asked.add(decision.step)
            steps.append(FlightStep(decision, frame if same else None, asks, counts, decision.go))
        return tuple(steps)

    @cached_property
    def declarations(self) -> tuple[Measured, ...]:
        """Those that count, pooled over the fleet, in their order; nothing where nobody knew the truth."""
        return tuple(in_order(declarations(self.logs, self.cap_s), self.cap_s)) if self.logs.true else ()

    @cached_property
    def all_declarations(self) -> tuple[Measured, ...]:
        """All of them, those after the cap too, in the order of the log."""
        return tuple(measured(decision, self.logs) for decision in finished(self.logs))

    def picture_path(self, decision: Decision) -> Path | None:
        """Return the file of the picture that a decision was made on; None where the folder has none."""
        path = self.folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
        return path if path.is_file() else None
