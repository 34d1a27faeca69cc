"""Model latency in vehicle time: as it really passes, as measured, fixed, drawn, recorded, or by the token.

The drone holds while the model decodes, and the world keeps moving. In real time latency passes by itself; in lockstep
it is charged: after the call, for which the vehicle's clock stands still, or beside it where it is foreseen. What each
policy promises: docs/latency.md.
"""

import hashlib
import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dronecats.agent.latency_draws import LONGEST_S, bimodal_s, gamma_s, jitter_s, lognormal_s, stall_s, traced_s
from dronecats.agent.models.model import Reply
from foundation.errors import UsageError

FASTEST_HZ = 20.0  # of the ticks on which a reply is noticed
SLOWEST_HZ = 1.0 / LONGEST_S
TRACE_MAX = 10_000  # latencies of a trace: they stand in every run.json
CHARACTERS_A_TOKEN = 4  # of a reply whose tokens nobody has counted, as a built-in pilot's
COMMANDER = 255  # the drone of a commander's questions: no vehicle has that number
TRACE = "trace"


@dataclass(frozen=True, slots=True)
class Question:
    """What tells one question from every other: nothing of a random latency depends on anything else."""

    seed: tuple[int, ...]  # of the episode, and of this flight of it
    step: int  # how many were asked for these drones before it
    drone: int  # the first of those that are asked together, or COMMANDER


@dataclass(frozen=True, slots=True)
class Circumstance:
    """What a charge may go by beside the question."""

    reply: Reply | None = None  # None where the charge is foreseen
    since_s: float | None = None  # vehicle s from the last reply for these drones to this question; None: there is none


Charge = Callable[[Question, Circumstance], float]  # → vehicle seconds


@dataclass(frozen=True, slots=True)
class Latency:
    """How long a reply takes in vehicle time."""

    name: str  # as the command line has it; kept in run.json
    charge: Charge | None  # None: the call lasts as long as it lasts
    foreseen: bool = False  # what a reply costs does not depend on how long it takes, and is known before it is there


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of policy: its words, and what they come to."""

    words: str  # "gamma:MEAN,CV"
    told: str  # within which bounds, for people
    bounds: tuple[tuple[float, float], ...]  # of each number
    charge: Callable[..., float]  # (question, circumstance, *numbers)
    optional: int = 0  # how many of the last numbers may be left out
    foreseen: bool = True

    def holds(self, numbers: Sequence[float]) -> bool:
        """Return whether so many numbers are wanted, each within its bounds."""
        enough = len(self.bounds) - self.optional <= len(numbers) <= len(self.bounds)
        return enough and all(low <= x <= high for x, (low, high) in zip(numbers, self.bounds, strict=False))


def _drawn(draw: Callable[..., float]) -> Callable[..., float]:
    return lambda question, _, *numbers: draw(question.seed, question.step, question.drone, *numbers)


def _by_token(_question: Question, of: Circumstance, first_s: float, rate_hz: float) -> float:
    """Return the time to the first token and that of all others; a `think` costs what it is long."""
    assert of.reply is not None  # it is not foreseen
    counted = of.reply.tokens_out
    tokens = math.ceil(len(of.reply.text) / CHARACTERS_A_TOKEN) if counted is None else counted
    return min(first_s + tokens / rate_hz, LONGEST_S)


def _measured(_question: Question, of: Circumstance) -> float:
    assert of.reply is not None  # it is not foreseen
    return of.reply.latency_s


def _held(_question: Question, of: Circumstance, rate_hz: float) -> float:
    """Return how long a reply is held back, that none comes sooner after the last one than a rate allows."""
    return 0.0 if of.since_s is None else max(0.0, 1.0 / rate_hz - of.since_s)


SOME, ANY, SHARE = (sys.float_info.min, LONGEST_S), (0.0, LONGEST_S), (0.0, 1.0)  # s, s, 1
PACE, SPREAD = (SLOWEST_HZ, FASTEST_HZ), (0.0, 3.0)  # Hz, 1
CAP = "cap"
KINDS = {
    "measured": _Kind("measured", "no number", (), _measured, foreseen=False),
    "fixed": _Kind("fixed:SECONDS", "0 … 300", (ANY,), lambda _question, _of, seconds: seconds),
    "rate": _Kind("rate:HZ", "0.0034 … 20", (PACE,), lambda _question, _of, hz: 1.0 / hz),
    "lognormal": _Kind(
        "lognormal:MEDIAN,SIGMA", "MEDIAN over 0 … 300 s, SIGMA 0 … 3", (SOME, SPREAD), _drawn(lognormal_s)
    ),
    "gamma": _Kind("gamma:MEAN,CV", "MEAN over 0 … 300 s, CV 0 … 3", (SOME, SPREAD), _drawn(gamma_s)),
    "bimodal": _Kind(
        "bimodal:FAST,SLOW,SHARE", "FAST and SLOW 0 … 300 s, SHARE of the fast ones 0 … 1", (ANY, ANY, SHARE),
        _drawn(bimodal_s),
    ),
    TRACE: _Kind(
        "trace:FILE", "a run folder or a CSV file", (),
        lambda question, _of, *trace: traced_s(question.seed, question.step, question.drone, trace),
    ),
    "tokens": _Kind(
        "tokens:TTFT,PER_S", "TTFT 0 … 300 s, PER_S 0.1 … 100000 tokens a second", (ANY, (0.1, 1e5)),
        _by_token, foreseen=False,
    ),
    "jitter": _Kind(
        "jitter:RATE,CV[,RHO]", "RATE 0.0034 … 20 Hz, CV 0 … 3, RHO -0.99 … 0.99", (PACE, SPREAD, (-0.99, 0.99)),
        lambda question, _of, hz, cv, rho=0.0: jitter_s(question.seed, question.step, question.drone, hz, cv, rho),
        optional=1,
    ),
    "stall": _Kind("stall:P,D", "P 0 … 1, D 0 … 300 s", (SHARE, ANY), _drawn(stall_s)),
    CAP: _Kind("cap:R", "0.0034 … 20 Hz", (PACE,), _held),
}  # fmt: skip
_JOINT = re.compile(rf"\+(?=(?:real|{'|'.join(KINDS)})(?::|\+|$))")


def parts_of(text: str) -> list[str]:
    """Return the policies that a name joins by +; a plus within a number or a file's name joins nothing."""
    return _JOINT.split(text)


def latency(text: str, trace: Sequence[float] | None = None) -> Latency:
    """Return the policy of a name: `real`, or one or more of KINDS joined by +, which add up.

    `trace`: the latencies (s) of a `trace:`, which names them as `trace_name` does. Raises UsageError for any other.
    """
    if text == "real":
        return Latency(text, None)
    words = parts_of(text)
    if "real" in words:
        raise UsageError(f"--latency real is what really passes, to which nothing is added, got '{text}'")
    charges: dict[str, Charge] = {}
    for word in words:
        name, numbers = _read(word, trace)
        if name in charges:
            raise UsageError(f"--latency has {name} twice: '{text}'; leave one of them out")
        charges[name] = _charge(KINDS[name], numbers)
    if trace is not None and TRACE not in charges:
        raise UsageError(f"--latency {text} charges nothing recorded, and the flight has a recorded latency_trace")
    foreseen = all(KINDS[name].foreseen for name in charges)
    cap = charges.pop(CAP, None)

    def charge(question: Question, of: Circumstance) -> float:
        taken_s = sum(each(question, of) for each in charges.values())
        return taken_s if cap is None else max(taken_s, cap(question, of))

    return Latency(text, charge, foreseen)


def trace_name(trace: Sequence[float]) -> str:
    """Return how a policy names recorded latencies wherever they are flown: the beginning of their SHA-256."""
    return hashlib.sha256(",".join(f"{seconds:.6f}" for seconds in trace).encode()).hexdigest()[:8]


def _read(word: str, trace: Sequence[float] | None) -> tuple[str, Sequence[float]]:
    """Return the kind of one policy, and its numbers."""
    name, colon, value = word.partition(":")
    if name not in KINDS:
        known = ", ".join(kind.words for kind in KINDS.values())
        raise UsageError(f"--latency wants real, {known}, or several of them joined by +, got '{word}'")
    kind = KINDS[name]
    if name == TRACE:
        return name, _recorded(word, value, trace)
    numbers = _numbers(value) if colon else ()
    if numbers is None or not kind.holds(numbers):
        raise UsageError(f"--latency {kind.words} wants {kind.told}, got '{word}'")
    return name, numbers


def _charge(kind: _Kind, numbers: Sequence[float]) -> Charge:
    return lambda question, of: kind.charge(question, of, *numbers)


def _recorded(word: str, name: str, trace: Sequence[float] | None) -> Sequence[float]:
    if trace is None:
        raise UsageError(f"--latency {word} is of recorded latencies that are not in the flight; name their file")
    if not 0 < len(trace) <= TRACE_MAX or not all(0.0 <= seconds <= LONGEST_S for seconds in trace):
        raise UsageError(f"--latency {word} wants 1 to {TRACE_MAX:,} latencies of 0 to {LONGEST_S:g} s")
    if name != trace_name(trace):
        raise UsageError(f"--latency {word} is of other latencies than the flight has, which are {trace_name(trace)}")
    return trace


def _numbers(text: str) -> tuple[float, ...] | None:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return None
