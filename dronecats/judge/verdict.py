"""The success criterion, pure. Paper, Algorithm 1: one rule for every cell of the grid."""

from collections.abc import Iterable
from dataclasses import dataclass

from foundation.protocol import CAP_S, RADIUS_M


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
