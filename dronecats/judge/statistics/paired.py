"""Two pilots on the same episodes: is one better, and how much better would it have had to be to show?"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass


def holm(ps: Sequence[float]) -> list[float]:
    """Return the adjusted p of each test, in their order, by which the chance of any false finding is held.

    Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6 (1979).
    """
    adjusted, least = [0.0] * len(ps), 0.0
    for rank, k in enumerate(sorted(range(len(ps)), key=ps.__getitem__)):
        least = max(least, min(1.0, (len(ps) - rank) * ps[k]))
        adjusted[k] = least
    return adjusted


ALPHA = 0.05  # two-sided
POWER = 0.8


@dataclass(frozen=True, slots=True)
class Paired:
    """Two pilots over the episodes that both have flown."""

    episodes: int
    only_first: int  # episodes that the first solved more often than the second: McNemar's b
    only_second: int  # the other way round: c
    difference: float  # share of successes of the first less that of the second, -1 … 1
    p: float  # two-sided, exact
    smallest: float | None  # `smallest_difference` for this discordance; None: no difference would have shown


def paired(first: Sequence[Sequence[bool]], second: Sequence[Sequence[bool]]) -> Paired:
    """Return the comparison; each holds, of the same episodes in the same order, the successes of its flights.

    Episodes are the unit: each goes to whoever solved it in the larger share of flights, and an even one to nobody,
    so that several flights of one episode are no more evidence than one. Of one flight each this is McNemar's exact
    test. Raises ValueError when the episodes are not as many or one was not flown.
    """
    if len(first) != len(second) or not all(map(len, (*first, *second))):
        raise ValueError("a paired comparison wants the same episodes of both, each flown")
    shares = [(sum(a) / len(a), sum(b) / len(b)) for a, b in zip(first, second, strict=True)]
    b, c = sum(x > y for x, y in shares), sum(x < y for x, y in shares)
    count = len(shares)
    return Paired(
        episodes=count,
        only_first=b,
        only_second=c,
        difference=math.fsum(x - y for x, y in shares) / count if count else 0.0,
        p=mcnemar(b, c),
        smallest=smallest_difference(count, (b + c) / count) if count else None,
    )


def mcnemar(b: int, c: int) -> float:
    """Return the exact two-sided p of McNemar's test: b and c discordant pairs under even odds. 1 of no such pair."""
    tail = sum(math.comb(b + c, k) for k in range(min(b, c) + 1))
    return min(1.0, 2 * tail / (1 << (b + c)))  # whole numbers until here, so nothing is rounded


def smallest_difference(
    episodes: int, discordant: float = 0.0, alpha: float = ALPHA, power: float = POWER
) -> float | None:
    """Return the least true difference in success rate that McNemar's exact test finds with this power.

    The share of episodes with different outcomes is `discordant`, or the difference itself where that is larger: then
    all of them go one way, the most favourable case. To 0.0001. None: these are too few for any difference to show.
    """
    if detected(episodes, 1.0, 1.0, alpha) < power:
        return None
    low, high = 0.0, 1.0
    while high - low > 1e-4:
        middle = (low + high) / 2
        enough = detected(episodes, middle, max(discordant, middle), alpha) >= power
        low, high = (low, middle) if enough else (middle, high)
    return high


def detected(episodes: int, difference: float, discordant: float, alpha: float = ALPHA) -> float:
    """Return the power of McNemar's exact test, exactly: the chance of p ≤ alpha.

    `discordant` is the true share of episodes with different outcomes, at least `difference`.
    """
    first = (discordant + difference) / (2 * discordant) if discordant else 0.5
    chance = 0.0
    for pairs in range(1, episodes + 1):
        most = _most_of_the_lesser(pairs, alpha)
        if most < 0:
            continue
        rejected = math.fsum(_binomial(k, pairs, first) + _binomial(pairs - k, pairs, first) for k in range(most + 1))
        chance += _binomial(pairs, episodes, discordant) * rejected
    return chance


@functools.cache
def _most_of_the_lesser(pairs: int, alpha: float) -> int:
    """Return how many of the discordant pairs may go the lesser way for p ≤ alpha; -1: not even none of them."""
    most = -1
    while 2 * (most + 1) < pairs and mcnemar(most + 1, pairs - most - 1) <= alpha:
        most += 1
    return most


def _binomial(k: int, n: int, share: float) -> float:
    """Return the chance of k successes in n trials."""
    if share in (0.0, 1.0):
        return float(k == n * share)
    logs = math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
    return math.exp(logs + k * math.log(share) + (n - k) * math.log1p(-share))
