"""Model latency in vehicle time: as it really passes, as measured, fixed, or drawn.

The drone holds while the model decodes, and the world keeps moving. In real time latency passes by itself; in lockstep
the vehicle's clock stands still during the call, so the latency is charged afterwards. What each policy promises:
docs/latency.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from foundation.errors import UsageError

LONGEST_S = 300.0  # an episode
COMMANDER = 255  # the drone of a commander's questions: no vehicle has that number


@dataclass(frozen=True, slots=True)
class Question:
    """What tells one question from every other: nothing of a random latency depends on anything else."""

    seed: tuple[int, ...]  # of the episode, and of this flight of it
    step: int  # how many were asked for these drones before it
    drone: int  # the first of those that are asked together, or COMMANDER


Charge = Callable[[Question, float], float]  # question, measured wall seconds → vehicle seconds


@dataclass(frozen=True, slots=True)
class Latency:
    """How long a reply takes in vehicle time."""

    name: str  # as the command line has it; kept in run.json
    charge: Charge | None  # None: the call lasts as long as it lasts


def latency(text: str) -> Latency:
    """Return the policy named `real`, `measured`, `fixed:SECONDS` or `lognormal:MEDIAN,SIGMA`. Raises UsageError."""
    kind, _, value = text.partition(":")
    if text == "real":
        return Latency(text, None)
    if text == "measured":
        return Latency(text, lambda _question, measured_s: measured_s)
    numbers = _numbers(value)
    if kind == "fixed" and len(numbers) == 1 and 0.0 <= numbers[0] <= LONGEST_S:
        return Latency(text, lambda _question, _measured_s: numbers[0])
    if kind == "lognormal" and len(numbers) == 2 and 0.0 < numbers[0] <= LONGEST_S and 0.0 <= numbers[1] <= 3.0:
        median_s, sigma = numbers
        return Latency(text, lambda question, _measured_s: _lognormal(question, median_s, sigma))
    raise UsageError(
        f"--latency wants real, measured, fixed:SECONDS (0 … 300) or lognormal:MEDIAN,SIGMA (SIGMA 0 … 3), got '{text}'"
    )


def _lognormal(question: Question, median_s: float, sigma: float) -> float:
    """Return the draw of a question: its logarithm is normal, so half of all replies come within the median."""
    draw = np.random.default_rng((*question.seed, question.step, question.drone)).normal(0.0, sigma)
    return min(median_s * math.exp(draw), LONGEST_S)


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
