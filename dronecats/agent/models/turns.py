"""Rate limits of an address: what vendors say of them in headers, and who may ask now. Pure: the clock comes in."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Literal, Protocol

Kind = Literal["requests", "tokens"]
LONGEST_S = 86_400.0  # until a day's limit is whole again
_UNIT_S = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86_400.0}
_DURATION = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)(ms|s|m|h|d)")
_EPOCH_MS = re.compile(r"\d{13}")
_ANTHROPIC: tuple[tuple[Kind, str], ...] = (  # kind, as it is called
    ("requests", "requests"),
    ("tokens", "tokens"),
    ("tokens", "input-tokens"),
)


@dataclass(frozen=True, slots=True)
class Allowance:
    """How much of one kind may still be asked for at an address."""

    kind: Kind
    limit: float  # when nothing has been used
    left: float  # now
    reset_s: float  # from now until it is whole again
    steady: bool  # it refills all the while; else at once, when that time is over


def allowances(headers: Mapping[str, str], now: datetime | None = None) -> tuple[Allowance, ...]:
    """Return what the headers of an answer allow, at most one of a kind; none where they say nothing that makes sense.

    `headers` by names in lower case; moments are held against the answer's own Date, else against `now` (UTC).
    """
    told = _date(headers.get("date")) or now or datetime.now(UTC)
    found: dict[Kind, Allowance] = {}
    kinds: tuple[Kind, ...] = ("requests", "tokens")
    for kind in kinds:
        stem = "x-ratelimit-{}-" + kind
        _put(found, kind, [headers.get(stem.format(word)) for word in ("limit", "remaining", "reset")], told, True)
    for kind, name in _ANTHROPIC:
        stem = f"anthropic-ratelimit-{name}-"
        _put(found, kind, [headers.get(stem + word) for word in ("limit", "remaining", "reset")], told, True)
    words = [headers.get(f"x-ratelimit-{word}") for word in ("limit", "remaining", "reset")]
    _put(found, "requests", words, told, False)  # OpenRouter's, a window
    return tuple(found.values())


def _put(found: dict[Kind, Allowance], kind: Kind, words: list[str | None], now: datetime, steady: bool) -> None:
    """Keep an allowance unless one of its kind stands there, or its words are none."""
    limit, left, reset_s = _number(words[0]), _number(words[1]), until(words[2], now)
    if kind not in found and limit and left is not None and reset_s is not None:
        found[kind] = Allowance(kind, limit, min(left, limit), reset_s, steady)


def until(text: str | None, now: datetime) -> float | None:
    """Return the seconds from `now` that '6m0s', '20ms', '1.5', a moment of RFC 3339 or ms of the epoch come to.

    At least 0 and at most a day; None for anything else.
    """
    if not text:
        return None
    text = text.strip()
    if _EPOCH_MS.fullmatch(text):
        seconds = int(text) / 1000.0 - now.timestamp()
    elif re.fullmatch(rf"(?:{_DURATION.pattern})+", text):
        seconds = sum(float(number) * _UNIT_S[unit] for number, unit in _DURATION.findall(text))
    elif (number := _number(text)) is not None:
        seconds = number
    else:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return None
        seconds = ((moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - now).total_seconds()
    return min(max(seconds, 0.0), LONGEST_S)


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0.0 else None


def _date(text: str | None) -> datetime | None:
    try:
        moment = parsedate_to_datetime(text or "")
    except (ValueError, OverflowError):
        return None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


LONGEST_WAIT_S = 60.0  # that nobody asks; a moment further ahead is of a clock that was set back
SLOW_S = 60.0  # after a refusal for being too many, in which requests go one by one …
APART_S = 0.5  # … so far apart: vendors without headers tell nothing else
MINUTE_S = 60.0  # that limits are of
LATE_S = 0.001  # more than what refills in theory has refilled


@dataclass(frozen=True, slots=True)
class Bucket:
    """What is left of an allowance."""

    at: float  # when
    level: float  # so much was left
    full: float
    rate: float  # per s, at which it refills; 0: not before it is whole
    whole_at: float

    def left(self, now: float) -> float:
        """Return how much may be asked for now."""
        if now >= self.whole_at or now < self.at - LONGEST_WAIT_S:
            return self.full
        return min(self.full, self.level + self.rate * max(now - self.at, 0.0))

    def wait_s(self, want: float, now: float) -> float:
        """Return the s until so much is left, or all that ever is."""
        lacking = min(want, self.full) - self.left(now)
        if lacking <= 0.0:
            return 0.0
        whole_s = self.whole_at - now
        return (min(lacking / self.rate, whole_s) if self.rate > 0.0 else whole_s) + LATE_S

    def without(self, used: float, now: float) -> "Bucket":
        """Return what is left when so much has been asked for."""
        level = max(self.left(now) - used, 0.0)
        whole_at = now + (self.full - level) / self.rate if self.rate > 0.0 else self.whole_at
        return replace(self, at=now, level=level, whole_at=whole_at)


@dataclass(frozen=True, slots=True)
class Turns:
    """An address. Its vendor counts by model, and sends away whoever comes."""

    held_until: float = 0.0  # nobody asks before
    slow_until: float = 0.0  # one by one until then
    next_at: float = 0.0  # the next of these
    buckets: Mapping[str, Bucket] = field(default_factory=dict)  # by 'KIND MODEL'

    def claim(self, model: str, tokens: int, now: float) -> "tuple[float, Turns]":
        """Return (0, the turns with this one taken), or (s to wait, the turns as they are)."""
        wants = {f"requests {model}": 1.0, f"tokens {model}": float(tokens)}
        asked = {name: (self.buckets[name], want) for name, want in wants.items() if name in self.buckets}
        held_s = self.held_until - now
        slow_s = self.next_at - now if now < self.slow_until else 0.0
        wait_s = max(
            held_s if held_s <= LONGEST_WAIT_S else 0.0,
            slow_s if slow_s <= APART_S else 0.0,
            *(bucket.wait_s(want, now) for bucket, want in asked.values()),
            0.0,
        )
        if wait_s > 0.0:
            return wait_s, self
        taken = {name: bucket.without(want, now) for name, (bucket, want) in asked.items()}
        return 0.0, replace(self, next_at=now + APART_S, buckets={**self.buckets, **taken})

    def heard(self, model: str, told: Allowance, now: float) -> "Turns":
        """Return the turns with what an answer allows. What others have just asked for it may not know of yet."""
        name = f"{told.kind} {model}"
        before = self.buckets.get(name)
        level = told.left if before is None or before.full != told.limit else min(told.left, before.left(now))
        used = told.limit - told.left
        rate = (used / told.reset_s if used > 0.0 and told.reset_s > 0.0 else told.limit / MINUTE_S) * told.steady
        whole_s = (told.limit - level) / rate if rate > 0.0 else told.reset_s
        bucket = Bucket(now, level, told.limit, rate, now + whole_s)
        return replace(self, buckets={**self.buckets, name: bucket})

    def held(self, seconds: float, now: float) -> "Turns":
        """Return the turns when nobody may ask for so long, and one by one for a while after it."""
        until = now + min(seconds, LONGEST_WAIT_S)
        kept = self.held_until if self.held_until - now <= LONGEST_WAIT_S else 0.0
        return replace(self, held_until=max(kept, until), slow_until=until + SLOW_S)


class Limiter(Protocol):
    """One address's turns. Whatever keeps them (a file, a service, a cluster's actor) is this interface."""

    def claim(self, tokens: int) -> float:
        """Count a request of about so many tokens as sent and return 0, or return the s to wait and ask again."""
        ...

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        """Take in what the headers of an answer allow."""
        ...

    def hold(self, seconds: float) -> None:
        """Let nobody ask there for so long: it has said that it is too much."""
        ...


Limiters = Callable[[str, str], Limiter]  # (address as it may be shown, model) → its limiter


class Unlimited:
    """The limiter of one who asks alone."""

    def claim(self, tokens: int) -> float:
        return 0.0

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        pass

    def hold(self, seconds: float) -> None:
        pass
