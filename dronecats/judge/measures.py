"""What a verdict does not ask: how many declarations it took. Beside the paper's criterion, which forgives them all."""

from collections.abc import Iterable
from dataclasses import dataclass

from dronecats.judge.verdict import Measured, in_order
from foundation.protocol import CAP_S, RADIUS_M

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
