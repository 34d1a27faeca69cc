"""An exact randomisation test of a mean, with fractions: the reference for the statistics under test."""

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction


def randomised(differences: Sequence[Fraction | float]) -> float:
    """Return the two-sided p value: twice the share of sign choices whose sum is at least the absolute actual sum."""
    sizes = [Fraction(each).limit_denominator(10_000) for each in differences]
    ways: dict[Fraction, int] = {Fraction(0): 1}
    for size in sizes:
        more: Counter[Fraction] = Counter()
        for total, count in ways.items():
            more[total + size] += count
            more[total - size] += count
        ways = more
    reached = abs(sum(sizes, Fraction(0)))
    beyond = sum(count for total, count in ways.items() if total >= reached)
    return min(1.0, float(Fraction(2 * beyond, 1 << len(sizes))))
