"""How well a share is known from few trials, and from several flights of the same few episodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class KnownShare:
    """A share of successes with its interval."""

    successes: int
    trials: int
    share: float  # 0 … 1
    low: float  # of the interval, 0 … 1
    high: float
    effective: float  # independent trials that would tell as much: as many as there are, or fewer


def wilson(successes: float, trials: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Wilson's score interval (low, high) of a share; (0, 1) of no trial. Raises ValueError.

    Wilson, "Probable inference", J. Am. Stat. Assoc. 22 (1927). The counts may be fractions: effective ones.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is no share")
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share = successes / trials
    middle = share + z * z / (2 * trials)
    half = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    # at an end of the scale the interval holds that end, which rounding would miss by a hair
    low = 0.0 if successes == 0 else (middle - half) / scale
    return low, 1.0 if successes == trials else (middle + half) / scale


def known_share(flights: Sequence[Sequence[bool]], confidence: float = CONFIDENCE) -> KnownShare:
    """Return the share of successes over all flights of some episodes; `flights` holds each episode's own.

    Flights of one episode succeed and fail together, so that ten flights of one tell less than one of ten: episodes
    are the unit. The interval is Wilson's, of as many independent trials as would leave the share's variance over the
    episodes (linearised, Cochran, "Sampling Techniques", 1977, 6.4), at least the episodes and at most all flights.
    Of one flight each it is Wilson's own. Where every flight ended alike it counts each episode once.
    """
    episodes = [each for each in flights if each]
    trials, successes = sum(map(len, episodes)), sum(map(sum, episodes))
    if trials == 0:
        return KnownShare(0, 0, math.nan, 0.0, 1.0, 0.0)
    share = successes / trials
    effective = _effective(episodes, share, trials)
    low, high = wilson(share * effective, effective, confidence)
    return KnownShare(successes, trials, share, low, high, effective)


def _effective(episodes: Sequence[Sequence[bool]], share: float, trials: int) -> float:
    """Return how many independent trials tell as much of the share."""
    count = len(episodes)
    if count == trials or count == 1 or share in (0.0, 1.0):
        return float(count)
    residuals = (sum(each) - share * len(each) for each in episodes)
    variance = count / (count - 1) * sum(r * r for r in residuals) / trials**2
    return min(float(trials), max(float(count), share * (1 - share) / variance)) if variance else float(trials)
