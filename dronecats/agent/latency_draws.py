"""What random latencies are drawn from: pure functions of what tells one question from every other, in seconds.

Each kind has a stream of numbers of its own, so that kinds that are added up are independent of one another. What is
drawn is a quantile: of two levels of one policy the same questions are the slow ones.
"""

import math
from collections.abc import Sequence

import numpy as np

LONGEST_S = 300.0  # an episode
STEADY_CV = 1e-3  # below this a gamma is as good as its mean
GAMMA, BIMODAL, STALL, JITTER, TRACE = range(
    1, 6
)  # streams; none is 0, which a seed would not tell from nothing, and …
LOGNORMAL = 7  # … without one it would be the stream of a pilot who draws (`pilots/noisy.py`). 6: `agent/pictures.py`

Seed = tuple[int, ...]  # of the episode, and of this flight of it


def lognormal_s(seed: Seed, step: int, drone: int, median_s: float, sigma: float) -> float:
    """Return a draw whose logarithm is normal, so half of all replies come within the median."""
    draw = np.random.default_rng((*seed, step, drone, LOGNORMAL)).normal(0.0, sigma)
    return min(median_s * math.exp(draw), LONGEST_S)


def gamma_s(seed: Seed, step: int, drone: int, mean_s: float, cv: float) -> float:
    """Return a draw of a mean and a coefficient of variation (standard deviation / mean); 1 is the exponential."""
    if cv < STEADY_CV:
        return mean_s
    from scipy.special import gammaincinv  # a base dependency, but slow to import, and most flights draw no gamma

    shape = 1.0 / (cv * cv)
    return min(mean_s / shape * float(gammaincinv(shape, _share(seed, step, drone, GAMMA))), LONGEST_S)


def bimodal_s(seed: Seed, step: int, drone: int, fast_s: float, slow_s: float, share: float) -> float:
    """Return `fast_s` for this share of all questions, else `slow_s`: a cache that hits, or misses."""
    return fast_s if _share(seed, step, drone, BIMODAL) < share else slow_s


def stall_s(seed: Seed, step: int, drone: int, probability: float, seconds: float) -> float:
    """Return `seconds` with a probability, else nothing."""
    return seconds if _share(seed, step, drone, STALL) < probability else 0.0


def jitter_s(seed: Seed, step: int, drone: int, rate_hz: float, cv: float, rho: float) -> float:
    """Return a draw around 1 / `rate_hz`, which is the mean, with this coefficient of variation.

    The logarithm is normal and from question to question an autoregression of the first order: `rho` is what two in a
    row are correlated by. The whole sequence is drawn up to this question, so that it matters to nobody who asked.
    """
    variance = math.log1p(cv * cv)
    shocks = np.random.default_rng((*seed, 0, drone, JITTER)).standard_normal(step + 1)
    level, kept = float(shocks[0]), math.sqrt(1.0 - rho * rho)
    for shock in shocks[1:]:
        level = rho * level + kept * float(shock)
    return min(math.exp(math.sqrt(variance) * level - variance / 2.0) / rate_hz, LONGEST_S)


def traced_s(seed: Seed, step: int, drone: int, trace: Sequence[float]) -> float:
    """Return what was recorded: in its order, from a place that is drawn once for a drone's flight, and round again.

    So what one reply says of the next is kept.
    """
    begin = int(np.random.default_rng((*seed, 0, drone, TRACE)).integers(len(trace)))
    return trace[(begin + step) % len(trace)]


def _share(seed: Seed, step: int, drone: int, stream: int) -> float:
    return float(np.random.default_rng((*seed, step, drone, stream)).random())
