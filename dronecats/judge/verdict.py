"""The success criterion, pure. Paper, Algorithm 1: one rule for every cell of the grid."""

from collections.abc import Sequence
from dataclasses import dataclass

DELTA_M = 5.0  # m, success radius to the target's centre
CAP_S = 300.0  # s, episode cap


@dataclass(frozen=True, slots=True)
class Measured:
    """An action with what was true at its frame: of a declaration, or of the last action of all."""

    step: int
    drone: int
    t: float  # s, when the decision was made
    distance_m: float  # m, body to target centre in three dimensions
    visible: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether the episode succeeded, and the navigation error: the distance at the decisive measurement."""

    success: bool
    ne_m: float | None  # None only when no action was ever taken
    deciding: Measured | None  # the first qualifying declaration


def judge(
    declarations: Sequence[Measured],
    last_action: Measured | None,
    delta_m: float = DELTA_M,
    cap_s: float = CAP_S,
) -> Verdict:
    """Return the verdict over the pooled declarations of all drones.

    A declaration logged after the cap does not count; the first one within `delta_m` whose target is visible decides.
    """
    for declaration in sorted((d for d in declarations if d.t <= cap_s), key=lambda d: (d.t, d.step, d.drone)):
        if declaration.distance_m <= delta_m and declaration.visible:
            return Verdict(True, declaration.distance_m, declaration)
    return Verdict(False, last_action.distance_m if last_action else None, None)
