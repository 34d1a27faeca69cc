"""The success criterion: declarations with what was true at their own frames, and the verdict over them, pure.

Paper, Algorithm 1: one rule for every cell of the grid. What was true is known as far as the logger measured it and its
records hold together. `measures` counts the declarations, which the paper's criterion does not.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.reading import Logs
from foundation.run_folder.rows import Decision, FrameTruth, Pose, drone_label

SAME_S = 1e-3  # s: pictures are announced in whole milliseconds
SAME_M = 1e-3  # m: places and distances are logged to a tenth of a millimetre each


@dataclass(frozen=True, slots=True)
class Measured:
    """An action with what was true at its frame: of a declaration, or of the last action of all."""

    step: int
    drone: int
    t: float  # s, when the decision was made
    distance_m: float | None  # m, body to target centre in three dimensions; None: not measured
    visible: bool | None  # None: not measured
    unknown: str | None = None  # why it was not measured, a sentence

    def qualifies(self, delta_m: float = RADIUS_M) -> bool | None:
        """Return whether a declaration here is a success; None when what was not measured could make it either."""
        within = None if self.distance_m is None else self.distance_m <= delta_m
        if within is False or self.visible is False:
            return False
        return None if within is None or self.visible is None else True


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether the episode succeeded, and the navigation error: the distance at the decisive measurement."""

    success: bool | None  # None: no declaration is known to qualify, and one that was not measured may have
    ne_m: float | None  # None: no action was taken, the last one was not measured, or success is None
    deciding: Measured | None  # the first declaration that is known to qualify
    unknown: tuple[Measured, ...] = ()  # unmeasured declarations before that, or of all


def in_order(declarations: Iterable[Measured], cap_s: float = CAP_S) -> list[Measured]:
    """Return the declarations that count, as they were made: by time, then step, then drone."""
    return sorted((d for d in declarations if d.t <= cap_s), key=lambda d: (d.t, d.step, d.drone))


def judge(
    declarations: Iterable[Measured],
    last_action: Measured | None,
    delta_m: float = RADIUS_M,
    cap_s: float = CAP_S,
) -> Judgement:
    """Return the verdict over the pooled declarations of all drones.

    A declaration logged after the cap does not count; the first one within `delta_m` whose target is visible decides.
    One that was not measured cannot undo a success. Only without one does it leave the verdict open.
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


def finished(logs: Logs) -> list[Decision]:
    """Return the decisions that declare arrival."""
    return [d for d in logs.decisions if d.declares]


def declarations(logs: Logs, cap_s: float = CAP_S) -> list[Measured]:
    """Return the declarations that could count, with the truth at their frames."""
    return [measured(d, logs) for d in finished(logs) if d.t_decided <= cap_s]


def last_action(logs: Logs, cap_s: float = CAP_S) -> Measured | None:
    """Return the last action within the cap, None without any; of a fleet, the closest of each drone's last one.

    Where one of them was not measured nobody knows which was the closest: its distance is None.
    """
    newest = {d.drone: d for d in sorted(logs.decisions, key=lambda d: d.step) if d.t_decided <= cap_s}
    last = [measured(newest[drone], logs) for drone in sorted(newest)]
    return min(last, key=lambda m: -1.0 if m.distance_m is None else m.distance_m, default=None)


def measured(decision: Decision, logs: Logs) -> Measured:
    """Return a decision with the truth at its own frame, or with the reason why that is not known."""
    step, drone, t = decision.step, decision.drone, decision.t_decided
    frame = logs.frames.get((drone, decision.frame_id))
    what = f"step {step} of {drone_label(drone)} was decided on frame {decision.frame_id}"
    if frame is None or (frame.distance_m is None and frame.visible is None):
        return Measured(step, drone, t, None, None, f"{what}, of which the logger has no truth")
    if abs(frame.t - decision.t_frame) > SAME_S:
        told = f"taken at {decision.t_frame:g} s, or by the logger at {frame.t:g} s"
        return Measured(step, drone, t, None, None, f"{what}, {told}")
    if not consistent(frame):
        return Measured(step, drone, t, None, None, f"{what}, whose distance is not that of its positions")
    whole = frame.distance_m is not None and frame.visible is not None
    part = None if whole else f"{what}, which was measured in part"
    return Measured(step, drone, t, frame.distance_m, frame.visible, part)


def qualifies(decision: Decision, logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> bool | None:
    """Return whether a declaration is a success: what the verdict, pictures, pages and films say of it.

    None for what is no declaration, and where what was not measured could make it a success or none.
    """
    if not decision.declares or not logs.true:
        return None
    return decision.t_decided <= cap_s and measured(decision, logs).qualifies(delta_m)


def consistent(row: Pose | FrameTruth) -> bool:
    """Return whether the distance of a pose or a frame is that between its positions, where it tells all three."""
    here, target, distance_m = row.position_ned, row.target_ned, row.distance_m
    if here is None or target is None or distance_m is None:
        return True
    return abs(math.dist(here, target) - distance_m) <= SAME_M


def reasons(unknown: Iterable[Measured]) -> str:
    """Return in one sentence why these are not known."""
    each = list(unknown)
    more = f", and {len(each) - 1} more" if len(each) > 1 else ""
    return f"{each[0].unknown}{more}" if each else ""


FEW = 3  # declarations within which a success is no longer a matter of declaring everywhere


@dataclass(frozen=True, slots=True)
class Measures:
    """Of one episode, its declarations within the cap pooled over the fleet in the order (t, step, drone)."""

    success_at_first: bool | None  # SR₁: the first one qualifies; None: not known
    success_within_three: bool | None  # SR₃: one of the first three does; None: not known
    declaration_precision: float | None  # share that qualifies, 0 … 1; None: none was made, or one was not measured
    false_declarations: int | None  # how many do not qualify; None: one was not measured


NOTHING_KNOWN = Measures(None, None, None, None)  # of a flight whose truth nobody measured


def measures(
    declarations: Iterable[Measured], delta_m: float = RADIUS_M, cap_s: float = CAP_S, *, whole: bool = True
) -> Measures:
    """Return the measures. `whole`: the flight was seen to its cap, so that what was not declared never was."""
    counted = [d.qualifies(delta_m) for d in in_order(declarations, cap_s)]
    known = None not in counted
    return Measures(
        success_at_first=_within(counted, 1, whole),
        success_within_three=_within(counted, FEW, whole),
        declaration_precision=round(counted.count(True) / len(counted), 4) if counted and known else None,
        false_declarations=counted.count(False) if known else None,
    )


def _within(qualify: list[bool | None], count: int, whole: bool) -> bool | None:
    first = qualify[:count]
    if True in first:
        return True
    return None if None in first or (len(first) < count and not whole) else False
