"""Applies the success criterion: measures each declaration at its own frame and gives the verdict (pure functions).

The same rule (the paper's Algorithm 1) applies to all kinds of episodes. The truth at a frame is known if the logger
measured it, and the logged times, positions and distances agree. `measures` adds counts of declarations, which are not
part of the paper's criterion.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.reading import Logs
from foundation.run_folder.rows import Decision, FrameTruth, Pose, drone_label

SAME_S = 1e-3  # s, tolerance of frame times, which are whole milliseconds
SAME_M = 1e-3  # m, tolerance of distances; the log has positions and distances to 0.1 mm


@dataclass(frozen=True, slots=True)
class Measured:
    """The truth at the frame of a declaration, or of the last action."""

    step: int
    drone: int
    t: float  # s, time of the decision
    distance_m: float | None  # m, body to target centre in three dimensions; None: not measured
    visible: bool | None  # whether the target was in view; None: not measured
    unknown: str | None = None  # sentence: why distance or visibility was not measured

    def qualifies(self, delta_m: float = RADIUS_M) -> bool | None:
        """Return whether a declaration at this frame is a success; None if missing measurements leave it open."""
        within = None if self.distance_m is None else self.distance_m <= delta_m
        if within is False or self.visible is False:
            return False
        return None if within is None or self.visible is None else True


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict of an episode: its success, and its navigation error (the distance at the decisive measurement)."""

    success: bool | None  # None: open, because no declaration is known to qualify, but an unmeasured one may
    ne_m: float | None  # None: no action, the last action was not measured, or success is None
    deciding: Measured | None  # the first declaration known to qualify
    unknown: tuple[Measured, ...] = ()  # unmeasured declarations before `deciding`, or all if `deciding` is None


def in_order(declarations: Iterable[Measured], cap_s: float = CAP_S) -> list[Measured]:
    """Return the declarations within the cap, in the order of time, then step, then drone."""
    return sorted((d for d in declarations if d.t <= cap_s), key=lambda d: (d.t, d.step, d.drone))


def judge(
    declarations: Iterable[Measured], last_action: Measured | None, delta_m: float = RADIUS_M, cap_s: float = CAP_S
) -> Judgement:
    """Return the verdict over the pooled declarations of all drones.

    A declaration logged after the cap does not count. The episode succeeds with the first declaration within `delta_m`
    of a visible target. An unmeasured declaration cannot undo a success. Without a success it leaves the verdict open.
    """
    unknown: list[Measured] = []
    for declaration in in_order(declarations, cap_s):
        qualifies = declaration.qualifies(delta_m)
        if qualifies:
            return Judgement(True, declaration.distance_m, declaration, tuple(unknown))
        if qualifies is None:
            unknown.append(declaration)
    if unknown:
        return Judgement(None, None, None, tuple(unknown))
    return Judgement(False, last_action.distance_m if last_action else None, None)


def declaring_decisions(logs: Logs) -> list[Decision]:
    return [d for d in logs.decisions if d.declares]


def declarations(logs: Logs, cap_s: float = CAP_S) -> list[Measured]:
    """Return the declarations within the cap, with the truth at their frames."""
    return [measured(d, logs) for d in declaring_decisions(logs) if d.t_decided <= cap_s]


def last_action(logs: Logs, cap_s: float = CAP_S) -> Measured | None:
    """Return the truth at the frame of the last decision within the cap; None without decisions.

    The decision counts even if its reply has no action. For a fleet, the drone with the smallest distance at its last
    decision counts. If one of these decisions was not measured, the distance of the result is None (unknown).
    """
    newest = {d.drone: d for d in sorted(logs.decisions, key=lambda d: d.step) if d.t_decided <= cap_s}
    last = [measured(newest[drone], logs) for drone in sorted(newest)]
    return min(last, key=lambda m: -1.0 if m.distance_m is None else m.distance_m, default=None)


def measured(decision: Decision, logs: Logs) -> Measured:
    """Return the truth at the frame of a decision, or the reason why it is unknown."""
    step, drone, t = decision.step, decision.drone, decision.t_decided
    frame = logs.frames.get((drone, decision.frame_id))
    subject = f"step {step} of {drone_label(drone)} was decided on frame {decision.frame_id}"
    if frame is None or (frame.distance_m is None and frame.visible is None):
        return Measured(step, drone, t, None, None, f"{subject}, for which the logger has no truth")
    if abs(frame.t - decision.t_frame) > SAME_S:
        difference = f"taken at {decision.t_frame:g} s, but at {frame.t:g} s by the logger"
        return Measured(step, drone, t, None, None, f"{subject}, {difference}")
    if not consistent(frame):
        return Measured(step, drone, t, None, None, f"{subject}, whose distance does not fit its positions")
    is_complete = frame.distance_m is not None and frame.visible is not None
    reason = None if is_complete else f"{subject}, which was only partly measured"
    return Measured(step, drone, t, frame.distance_m, frame.visible, reason)


def qualifies(decision: Decision, logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> bool | None:
    """Return whether a declaration is a success.

    None for decisions that are not declarations, for logs without truth, and if missing measurements leave it open.
    """
    if not decision.declares or not logs.true:
        return None
    return decision.t_decided <= cap_s and measured(decision, logs).qualifies(delta_m)


def consistent(row: Pose | FrameTruth) -> bool:
    """Return whether the distance of a pose or frame matches its positions; True if a value is missing."""
    here, target, distance_m = row.position_ned, row.target_ned, row.distance_m
    if here is None or target is None or distance_m is None:
        return True
    return abs(math.dist(here, target) - distance_m) <= SAME_M


def reasons(unknown: Iterable[Measured]) -> str:
    """Return the reason of the first unknown measurement and the number of further ones, as text."""
    all_unknown = list(unknown)
    more = f", and {len(all_unknown) - 1} more" if len(all_unknown) > 1 else ""
    return f"{all_unknown[0].unknown}{more}" if all_unknown else ""


FEW = 3  # number of first declarations that count for SR₃; more would reward declaring everywhere


@dataclass(frozen=True, slots=True)
class Measures:
    """Measures of an episode's declarations within the cap, pooled over the fleet in the order (t, step, drone)."""

    success_at_first: bool | None  # SR₁: the first declaration qualifies; None: unknown
    success_within_three: bool | None  # SR₃: one of the first three declarations qualifies; None: unknown
    declaration_precision: float | None  # share that qualifies, 0 … 1; None: no declaration, or an unmeasured one
    false_declarations: int | None  # number that does not qualify; None: a declaration is unmeasured


NOTHING_KNOWN = Measures(**dict.fromkeys(field.name for field in fields(Measures)))  # for a flight without truth


def measures(
    declarations: Iterable[Measured], delta_m: float = RADIUS_M, cap_s: float = CAP_S, *, is_whole: bool = True
) -> Measures:
    """Return the measures. `is_whole`: the log reaches the cap, so no further declaration is possible."""
    counted = [d.qualifies(delta_m) for d in in_order(declarations, cap_s)]
    is_known = None not in counted
    return Measures(
        success_at_first=_within(counted, 1, is_whole),
        success_within_three=_within(counted, FEW, is_whole),
        declaration_precision=round(counted.count(True) / len(counted), 4) if counted and is_known else None,
        false_declarations=counted.count(False) if is_known else None,
    )


def _within(qualify: list[bool | None], count: int, is_whole: bool) -> bool | None:
    first = qualify[:count]
    if True in first:
        return True
    return None if None in first or (len(first) < count and not is_whole) else False
