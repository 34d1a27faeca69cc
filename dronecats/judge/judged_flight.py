"""Reads the files of a flight that the judge may use, and derives the verdict from its logs.

`JudgedFlight` is the input of every metric. `dronecats.report.recorded.flight` adds data of the MAVLink log and of the
episode's world.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from msgspec import UNSET

from dronecats.judge.commanding import commanding
from dronecats.judge.diagnostics import (
    contacts,
    distances,
    drone_diagnostics,
    estimator_resets,
    fleet_diagnostics,
    host_stalls,
    wide_rotations,
)
from dronecats.judge.verdict import (
    NOTHING_KNOWN,
    SAME_S,
    Judgement,
    Measured,
    declarations,
    declaring_decisions,
    in_order,
    judge,
    last_action,
    measured,
    measures,
    reasons,
)
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import Logs, json_object, read
from foundation.run_folder.results import SCORED, Deciding, Diagnostics, DroneDiagnostics, Outcome, Verdict
from foundation.run_folder.rows import Decision, FrameTruth, PointedGo, Pose, drone_label
from foundation.run_folder.writing import as_json


def outcome(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Verdict:
    """Return the verdict of an episode's logs. Table of the keys: docs/run-folder.md.

    A declaration until `cap_s` qualifies if the drone was within `delta_m` of the target's centre with the target in
    view. The flight is then a success, however it ended. Without such a declaration, the outcome is "error" (of the
    infrastructure) if a declaration was not measured, or if `ending` or `gaps` finds a fault. A flight is censored (its
    continuation is unknown) if it ended before `cap_s`, for example because it was decided at another radius. Without
    truth, `success` is None and the outcome is "error", "distance only" (the distances are estimated) or "unknown".
    """
    declared = declarations(logs, cap_s) if logs.true else []
    last = last_action(logs, cap_s) if logs.true else None
    verdict = judge(declared, last, delta_m, cap_s) if logs.true else Judgement(False, None, None)
    estimated = distances(logs, delta_m, cap_s)
    error = None if verdict.success else reasons(verdict.unknown) or ending(logs, cap_s) or gaps(logs)
    end = logs.end
    # a flight that ended at its own cap below CAP_S counts as if it had lasted for CAP_S
    asked_cap_s = max((logs.begin and logs.begin.cap_s) or CAP_S, CAP_S)
    seen = end is not None and (end.t >= cap_s or (end.reason == "cap" and cap_s <= asked_cap_s))
    named = "error" if error else _outcome_name(logs, verdict, seen, estimated is not None)
    scored = verdict if named in ("success", "failure") else Judgement(False, None, None)
    claims = declaring_decisions(logs)
    drones = drone_diagnostics(logs, delta_m, cap_s)
    is_whole = error is None and seen
    resets = estimator_resets(logs, cap_s)
    return Verdict(
        outcome=named,
        success=scored.success if logs.true and named != "censored" else None,
        ne_m=scored.ne_m,
        delta_m=delta_m,
        censored=named in ("success", "censored") and not is_whole,
        steps=max((d.step + 1 for d in logs.decisions), default=0),
        declarations=sum(d.t_decided <= cap_s for d in claims),
        declarations_after_cap=sum(d.t_decided > cap_s for d in claims),
        **asdict(measures(declared, delta_m, cap_s, is_whole=is_whole) if logs.true else NOTHING_KNOWN),
        deciding=_deciding(scored.deciding),
        error=error,
        note=_note(scored, last),
        diagnostics=fleet_diagnostics(drones),
        drones=tuple(_of_drone(drone, diagnostics, declared, delta_m) for drone, diagnostics in drones.items()),
        distances=UNSET if logs.true else estimated,
        wide_rotations=wide_rotations(logs.decisions, cap_s) or UNSET,
        commanding=commanding(logs, cap_s) or UNSET,
        host_stalls=host_stalls(logs.decisions) or UNSET,
        cap_s=UNSET if cap_s == CAP_S else cap_s,
        contacts=contacts(logs, cap_s) or UNSET,
        estimator_resets=UNSET if resets is None else resets,
    )


def succeeded(logs: Logs) -> bool | None:
    """Return whether a declaration already qualifies; None while a declaration is not measured yet."""
    return judge(declarations(logs), None).success if logs.true else False


def _outcome_name(logs: Logs, verdict: Judgement, seen: bool, estimated: bool) -> Outcome:
    if not logs.true:
        return "distance only" if estimated else "unknown"
    if verdict.success:
        return "success"
    return "failure" if seen else "censored"


def _note(verdict: Judgement, last: Measured | None) -> str | None:
    """Return a sentence about a part of the verdict that is not known; None: all is known."""
    if verdict.success and verdict.unknown:
        return (
            f"deciding and ne_m are those of the first declaration that is known to qualify: {reasons(verdict.unknown)}"
        )
    if not verdict.success and last is not None and last.unknown and verdict.ne_m is None:
        return f"no declaration qualifies, and ne_m is not known: {last.unknown}"
    return None


def _deciding(made: Measured | None) -> Deciding | None:
    if made is None:
        return None
    return Deciding(step=made.step, drone=made.drone, t=made.t, distance_m=made.distance_m)


def _of_drone(drone: int, diagnostics: Diagnostics, declared: list[Measured], delta_m: float) -> DroneDiagnostics:
    own = [d for d in declared if d.drone == drone]
    qualifying = sum(d.qualifies(delta_m) is True for d in own)
    return DroneDiagnostics(drone=drone, declarations=len(own), qualifying=qualifying, **as_json(diagnostics))


# s by which the logged end may precede the cap. The logged end is the time of the newest truth that the logger has
# received, and on a busy machine a process may stall for this long.
LATE_S = 5.0


def ending(logs: Logs, cap_s: float = CAP_S) -> str | None:
    """Return the reason why the log does not show a complete episode up to `cap_s`; None if it does.

    The episode must have begun, something must be measured, and the logger must have seen the end. A flight that ended
    at its cap must have decisions, or a commander that was asked and was too slow. A flight that ended as decided must
    have a declaration that qualifies at RADIUS_M, the radius used during the flight. A flight that ended for any other
    reason must be judged at a cap below its own, and must have a decision after that cap.
    """
    if logs.begin is None:
        return "the episode never began"
    if logs.end is None:
        return "the log breaks off before the end of the episode"
    rows: list[Pose | FrameTruth] = [*logs.poses, *logs.frames.values()]
    if logs.true and not any(row.distance_m is not None for row in rows):
        return "the logger measured nothing"
    reason, ended_s = logs.end.reason, logs.end.t
    if reason == "decided":
        good = any(d.qualifies(RADIUS_M) for d in declarations(logs))
        return None if good else f"the flight ended early as decided, but no declaration in {DECISIONS} qualifies"
    own_cap_s = logs.begin.cap_s or (CAP_S if logs.true else 0.0)  # an older log: an episode lasts CAP_S
    if reason != "cap":
        # a later decision shows that the reply under way at `cap_s` came; without it, the endpoint may have been dead
        is_complete = cap_s < own_cap_s and any(d.t_decided > cap_s for d in logs.decisions)
        return None if is_complete and ended_s >= cap_s else logs.end.error or reason
    if ended_s < own_cap_s - LATE_S:
        return f"the log says that the flight ended at its cap of {own_cap_s:g} s, but it ends at {ended_s:g} s"
    if not logs.decisions and not logs.only_commander_asked:
        return f"the flight lasted to its cap, but {DECISIONS} is empty"
    return None


def gaps(logs: Logs) -> str | None:
    """Return the fault in the step numbers: a step is missing, or a drone has a step twice; None: no fault."""
    taken = Counter((d.step, d.drone) for d in logs.decisions)
    twice = next((key for key, count in sorted(taken.items()) if count > 1), None)
    if twice:
        return f"{DECISIONS} holds step {twice[0]} of {drone_label(twice[1])} more than once"
    steps = sorted({-1} | {step for step, _ in taken})
    missing = next((a + 1 for a, b in pairwise(steps) if b > a + 1), None)
    return None if missing is None else f"{DECISIONS} lacks step {missing}"


def question_flags(decisions: Iterable[Decision]) -> list[bool]:
    """Return for each decision whether it is the first one from a pilot's reply, as `FlightStep.is_question`."""
    flags, answered_steps = [], set[int]()
    for decision in decisions:
        # a confirmation has no reply of the pilot; the reply of the commander is in commander.jsonl
        flags.append(decision.step not in answered_steps and decision.confirmed_by is UNSET)
        answered_steps.add(decision.step)
    return flags


@dataclass(frozen=True, slots=True)
class FlightStep:
    """One decision of one drone, with the truth at the time of its picture."""

    decision: Decision
    truth: FrameTruth | None  # truth at the time of the decision's picture; None: the logger has no such row
    is_question: bool  # whether this is the first decision from a pilot's reply; metrics count the reply's cost here
    counts: bool  # whether the decision was made within the cap
    go: PointedGo | None  # the commanded point; None: another action, or none

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
        """The kind of episode: approaching, searching, tracking, search-and-track or commanding; empty: unknown."""
        return str(self.record.get("cell", ""))

    @property
    def map(self) -> str:
        return str(self.record.get("map", ""))

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict, derived anew from the logs."""
        return outcome(self.logs, self.delta_m, self.cap_s)

    @property
    def scored(self) -> bool:
        return self.verdict.outcome in SCORED

    @property
    def success(self) -> bool | None:
        """Whether the flight is a success; None: it is not scored."""
        return self.verdict.success if self.scored else None

    @cached_property
    def steps(self) -> tuple[FlightStep, ...]:
        """The decisions in the order of the log, each with the truth at the time of its picture."""
        steps = []
        for decision, is_question in zip(self.logs.decisions, question_flags(self.logs.decisions), strict=True):
            frame = self.logs.frames.get((decision.drone, decision.frame_id))
            is_same = frame is not None and abs(frame.t - decision.t_frame) <= SAME_S
            counts = decision.t_decided <= self.cap_s
            steps.append(FlightStep(decision, frame if is_same else None, is_question, counts, decision.go))
        return tuple(steps)

    @cached_property
    def declarations(self) -> tuple[Measured, ...]:
        """The declarations of all drones within the cap, in the order of the verdict; empty without truth."""
        return tuple(in_order(declarations(self.logs, self.cap_s), self.cap_s)) if self.logs.true else ()

    @cached_property
    def all_declarations(self) -> tuple[Measured, ...]:
        """All declarations, including those after the cap, in the order of the log."""
        return tuple(measured(decision, self.logs) for decision in declaring_decisions(self.logs))

    def picture_path(self, decision: Decision) -> Path | None:
        """Return the file of a decision's picture; None if the folder has none."""
        path = self.folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
        return path if path.is_file() else None
