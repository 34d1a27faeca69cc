"""Policies for model latency in vehicle time: real, measured, fixed, random, recorded, or by tokens.

While the model decodes, the world keeps moving. In real time, vehicle time passes during the call. In lockstep, the
vehicle's clock advances by the charge (the latency that the policy gives): after the call or, only if the charge is
known beforehand, during the call. See docs/latency.md.

A policy is a value (`LatencyPolicy`). run.json and spec files hold its text; run.json names a trace by its digest.
"""

import hashlib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dronecats.agent.models.model import Reply, tokens_of_text
from foundation.declaration import ABOVE_0, DeclaredNumber
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.wording import did_you_mean, nearest

LONGEST_S = CAP_S  # s, upper limit of each latency: the length of an episode
FASTEST_HZ = 20.0  # upper limit of rates: the agent checks for a reply at ticks of 20 Hz
SLOWEST_HZ = 1.0 / LONGEST_S
TRACE_MAX = 10_000  # a trace has at most this many latencies; run.json holds all of them
COMMANDER = 255  # drone number of a commander's questions; no vehicle has it
STEADY_CV = 1e-3  # below this coefficient of variation, a gamma draw is the mean
NOTHING_ADDED = "--latency real is the measured time of a reply and cannot be combined with another policy"
REAL, TRACE, FIXED, RATE, JITTER, STALL, CAP = "real", "trace", "fixed", "rate", "jitter", "stall", "cap"
MEASURED = "measured"

Seed = tuple[int, ...]  # seeds of the episode and of this flight


@dataclass(frozen=True, slots=True)
class Question:
    """The identity of a question. Random draws depend on it alone."""

    seed: Seed
    step: int  # number of the question, from 0, for these drones
    drone: int  # first drone of the question, or COMMANDER


@dataclass(frozen=True, slots=True)
class Circumstance:
    """Other values on which a charge (the latency that is counted for a reply) may depend."""

    reply: Reply | None = None  # None if the charge is known before the reply
    since_s: float | None = None  # vehicle s between the last reply for these drones and this question; None: no reply


@dataclass(frozen=True, slots=True)
class LatencyPart:
    """One term of a policy. The text of a policy joins its terms with +."""

    text: str  # "jitter:2,0.5"; for a trace "trace:DIGEST"
    kind: str  # a key of KINDS
    numbers: tuple[float, ...]  # for the kind `trace`: the recorded latencies, s

    def charge_s(self, question: Question, of: Circumstance) -> float:
        """Return this part's share of a reply's latency, vehicle seconds."""
        return KINDS[self.kind].charge(question, of, *self.numbers)


@dataclass(frozen=True, slots=True)
class LatencyPolicy:
    """A reply's latency in vehicle time: the sum of the parts. `cap` (a maximum rate) is not added; it is a minimum."""

    parts: tuple[LatencyPart, ...]  # empty: real time

    @classmethod
    def parse(cls, text: str, trace: Sequence[float] | None = None) -> "LatencyPolicy":
        """Return the policy of a text: `real`, or one or more of KINDS joined by +.

        `trace`: the recorded latencies (s) of a part `trace:DIGEST`; DIGEST is `trace_name(trace)`. Raises UsageError.
        """
        words = split_policy(text)
        if words == [REAL]:
            return cls(())
        if REAL in words:
            raise UsageError(f"{NOTHING_ADDED}, got '{text}'")
        parts = tuple(_part(word, trace) for word in words)
        kinds = [part.kind for part in parts]
        if twice := next((kind for kind in kinds if kinds.count(kind) > 1), None):
            raise UsageError(f"--latency names {twice} twice: '{text}'. Leave one of them out")
        if trace is not None and TRACE not in kinds:
            raise UsageError(
                f"--latency {text} uses no recorded latencies, but the flight has a latency_trace. Leave"
                " one of them out"
            )
        return cls(parts)

    def __str__(self) -> str:
        """The text of the policy, as on the command line, in run.json and in spec files."""
        return "+".join(part.text for part in self.parts) or REAL

    @property
    def real(self) -> bool:
        """True when a call takes its real time and nothing is charged."""
        return not self.parts

    @property
    def foreseen(self) -> bool:
        """True when the charge is known before the reply."""
        return not self.real and all(KINDS[part.kind].foreseen for part in self.parts)

    @property
    def trace(self) -> tuple[float, ...] | None:
        """The recorded latencies, s."""
        return self.numbers(TRACE) or None

    def part(self, kind: str) -> LatencyPart | None:
        """Return the part of a kind; None if there is none."""
        return next((part for part in self.parts if part.kind == kind), None)

    def numbers(self, kind: str) -> tuple[float, ...]:
        """Return the numbers of the part of a kind; empty if there is none."""
        part = self.part(kind)
        return part.numbers if part else ()

    def with_part(self, text: str, instead_of: Sequence[str] = ()) -> "LatencyPolicy":
        """Return the policy with a new part.

        The new part replaces the first part whose kind is in `instead_of`. If there is none, the new part is added at
        the end and replaces a part of its own kind. Raises UsageError.
        """
        if self.real:
            raise UsageError(f"{NOTHING_ADDED}, got '{text}'")
        new = _part(text, None)
        place = next((n for n, part in enumerate(self.parts) if part.kind in instead_of), None)
        if place is not None:
            return LatencyPolicy((*self.parts[:place], new, *self.parts[place + 1 :]))
        return LatencyPolicy((*(part for part in self.parts if part.kind != new.kind), new))

    def charge_s(self, question: Question, of: Circumstance) -> float:
        """Return the latency of a reply, vehicle seconds. Not for a `real` policy."""
        taken_s = sum(part.charge_s(question, of) for part in self.parts if part.kind != CAP)
        cap = self.part(CAP)
        return taken_s if cap is None else max(taken_s, cap.charge_s(question, of))


def split_policy(text: str) -> list[str]:
    """Return the texts of the parts. A plus within a number or a file name does not separate parts."""
    return _JOINT.split(text)


def trace_name(trace: Sequence[float]) -> str:
    """Return the name of recorded latencies in a policy: the beginning of their SHA-256."""
    return hashlib.sha256(",".join(f"{seconds:.6f}" for seconds in trace).encode()).hexdigest()[:8]


def _part(text: str, trace: Sequence[float] | None) -> LatencyPart:
    name, colon, value = text.partition(":")
    if name not in KINDS:
        policies = ", ".join(kind.form(name) for name, kind in KINDS.items())
        if near := nearest(name, KINDS, count=1):
            raise UsageError(f"--latency {text} is not known: {did_you_mean([KINDS[near[0]].form(near[0])])}")
        raise UsageError(f"--latency must be real, {policies}, or several of them joined by +, got '{text}'")
    if name == TRACE:
        return LatencyPart(text, name, _recorded(text, value, trace))
    return LatencyPart(text, name, KINDS[name].read(text, value.split(",") if colon else []))


def _recorded(text: str, name: str, trace: Sequence[float] | None) -> tuple[float, ...]:
    if trace is None:
        raise UsageError(f"--latency {text} needs the recorded latencies. Name their file: --latency trace:FILE")
    if not 0 < len(trace) <= TRACE_MAX or not all(0.0 <= seconds <= LONGEST_S for seconds in trace):
        raise UsageError(f"--latency {text} must have 1 to {TRACE_MAX:,} latencies of 0 to {LONGEST_S:g} s each")
    if name != trace_name(trace):
        raise UsageError(f"--latency {text} names other latencies than the flight, which has {trace_name(trace)}")
    return tuple(trace)


# Random streams. Each kind has its own stream, so that joined kinds are independent. The quantile that a question draws
# does not depend on the parameters (except RHO), so changed parameters leave the same questions slow. NumPy's seed
# sequences ignore a 0 at the end, so stream 0 is not used. `pictures.py` uses stream 6. The noisy pilot
# (`pilots/oracle/noisy.py`) draws without a stream.
GAMMA_STREAM, BIMODAL_STREAM, STALL_STREAM, JITTER_STREAM, TRACE_STREAM = range(1, 6)
LOGNORMAL_STREAM = 7


def _lognormal_s(question: Question, _of: Circumstance, median_s: float, sigma: float) -> float:
    """Return a lognormal draw with this median; `sigma` is the standard deviation of the logarithm."""
    draw = np.random.default_rng((*question.seed, question.step, question.drone, LOGNORMAL_STREAM)).normal(0.0, sigma)
    return min(median_s * math.exp(draw), LONGEST_S)


def _gamma_s(question: Question, _of: Circumstance, mean_s: float, cv: float) -> float:
    """Return a gamma draw with this mean and coefficient of variation (standard deviation / mean)."""
    if cv < STEADY_CV:
        return mean_s
    from scipy.special import gammaincinv  # a base dependency, but slow to import, and most flights draw no gamma

    shape = 1.0 / (cv * cv)
    return min(mean_s / shape * float(gammaincinv(shape, _share(question, GAMMA_STREAM))), LONGEST_S)


def _bimodal_s(question: Question, _of: Circumstance, fast_s: float, slow_s: float, share: float) -> float:
    """Return `fast_s` for this share of all questions, else `slow_s`, as with cache hits and misses."""
    return fast_s if _share(question, BIMODAL_STREAM) < share else slow_s


def _stall_s(question: Question, _of: Circumstance, probability: float, seconds: float) -> float:
    """Return `seconds` with this probability, else 0."""
    return seconds if _share(question, STALL_STREAM) < probability else 0.0


def _jitter_s(question: Question, _of: Circumstance, rate_hz: float, cv: float, rho: float = 0.0) -> float:
    """Return a draw with the mean 1 / `rate_hz` and this coefficient of variation.

    The draw's logarithm is normal, and follows a first-order autoregression over the questions. `rho` is the
    correlation of two successive logarithms. No state is kept: each call draws the sequence up to this question again.
    """
    variance = math.log1p(cv * cv)
    shocks = np.random.default_rng((*question.seed, 0, question.drone, JITTER_STREAM)).standard_normal(
        question.step + 1
    )
    level, kept = float(shocks[0]), math.sqrt(1.0 - rho * rho)
    for shock in shocks[1:]:
        level = rho * level + kept * float(shock)
    return min(math.exp(math.sqrt(variance) * level - variance / 2.0) / rate_hz, LONGEST_S)


def _traced_s(question: Question, _of: Circumstance, *trace: float) -> float:
    """Return the next recorded latency; after the last, the first follows. The start is random per drone and flight.

    The order keeps the correlation of successive replies.
    """
    begin = int(np.random.default_rng((*question.seed, 0, question.drone, TRACE_STREAM)).integers(len(trace)))
    return trace[(begin + question.step) % len(trace)]


def _share(question: Question, stream: int) -> float:
    return float(np.random.default_rng((*question.seed, question.step, question.drone, stream)).random())


def _by_token_s(_question: Question, of: Circumstance, first_s: float, rate_hz: float) -> float:
    """Return `first_s` (until the first token) plus the time of all tokens of the reply at `rate_hz` tokens per s."""
    assert of.reply is not None  # the charge is computed after the reply
    counted = of.reply.tokens_out
    tokens = tokens_of_text(of.reply.text) if counted is None else counted
    return min(first_s + tokens / rate_hz, LONGEST_S)


def _measured_s(_question: Question, of: Circumstance) -> float:
    assert of.reply is not None  # the charge is computed after the reply
    return of.reply.latency_s


def _held_s(_question: Question, of: Circumstance, rate_hz: float) -> float:
    """Return the latency (s) that puts a reply at least 1 / `rate_hz` s after the last one; 0 for the first reply."""
    return 0.0 if of.since_s is None else max(0.0, 1.0 / rate_hz - of.since_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class LatencyKind:
    """One kind of policy: its numbers and its charge."""

    charge: Callable[..., float]  # (question, circumstance, *numbers) → vehicle seconds
    quantities: tuple[DeclaredNumber, ...] = ()
    optional: int = 0  # how many of the last quantities may be left out
    foreseen: bool = True  # whether the charge is known before the reply
    file: str = ""  # placeholder of a file name, for a kind that has a file instead of numbers

    def form(self, name: str) -> str:
        """Return the syntax of the kind, such as "jitter:RATE,CV[,RHO]"."""
        needed = len(self.quantities) - self.optional
        numbers = ",".join(quantity.name for quantity in self.quantities[:needed])
        more = "".join(f"[,{quantity.name}]" for quantity in self.quantities[needed:])
        return f"{name}:{numbers or self.file}{more}" if numbers or self.file else name

    def read(self, text: str, values: Sequence[str]) -> tuple[float, ...]:
        """Return the numbers of a part. Raises UsageError if they are too few, too many or out of bounds."""
        try:
            if not len(self.quantities) - self.optional <= len(values) <= len(self.quantities):
                raise ValueError
            return tuple(quantity.read(float(value)) for quantity, value in zip(self.quantities, values, strict=False))
        except (ValueError, UsageError):
            wanted = ", ".join(f"{quantity.name} {quantity.wanted}" for quantity in self.quantities) or "no number"
            raise UsageError(f"--latency {self.form(text.partition(':')[0])} needs {wanted}, got '{text}'") from None


def _number(name: str, low: float, high: float, unit: str = "") -> DeclaredNumber:
    return DeclaredNumber(name=name, help="", low=low, high=high, unit=unit)


def _seconds(name: str, low: float = 0.0) -> DeclaredNumber:
    return _number(name, low, LONGEST_S, "s")


def _rate(name: str) -> DeclaredNumber:
    return _number(name, SLOWEST_HZ, FASTEST_HZ, "Hz")


KINDS = {
    MEASURED: LatencyKind(charge=_measured_s, foreseen=False),
    FIXED: LatencyKind(charge=lambda _question, _of, seconds: seconds, quantities=(_seconds("SECONDS"),)),
    RATE: LatencyKind(charge=lambda _question, _of, hz: 1.0 / hz, quantities=(_rate("HZ"),)),
    "lognormal": LatencyKind(charge=_lognormal_s, quantities=(_seconds("MEDIAN", ABOVE_0), _number("SIGMA", 0.0, 3.0))),
    "gamma": LatencyKind(charge=_gamma_s, quantities=(_seconds("MEAN", ABOVE_0), _number("CV", 0.0, 3.0))),
    "bimodal": LatencyKind(
        charge=_bimodal_s, quantities=(_seconds("FAST"), _seconds("SLOW"), _number("SHARE", 0.0, 1.0))
    ),
    TRACE: LatencyKind(charge=_traced_s, file="FILE"),
    "tokens": LatencyKind(
        charge=_by_token_s, quantities=(_seconds("TTFT"), _number("PER_S", 0.1, 1e5, "tokens a second")), foreseen=False
    ),
    JITTER: LatencyKind(
        charge=_jitter_s, quantities=(_rate("RATE"), _number("CV", 0.0, 3.0), _number("RHO", -0.99, 0.99)), optional=1
    ),
    STALL: LatencyKind(charge=_stall_s, quantities=(_number("P", 0.0, 1.0), _seconds("D"))),
    CAP: LatencyKind(charge=_held_s, quantities=(_rate("R"),)),
}
_JOINT = re.compile(rf"\+(?=(?:real|{'|'.join(KINDS)})(?::|\+|$))")
