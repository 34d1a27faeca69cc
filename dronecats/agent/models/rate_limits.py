"""Rate limits of an address: parses vendors' headers and schedules requests. Callers pass the present time."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Literal, Protocol

Kind = Literal["requests", "tokens"]
LONGEST_S = 86_400.0  # s; a reset after a longer time counts as one day
SHORTEST_S = 0.001  # s; a reset after a shorter time counts as at once
LIMIT_MIN, LIMIT_MAX = 1.0, 1e12  # requests or tokens; a limit in a header counts as at least and at most this
_UNIT_S = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86_400.0}
_DURATION = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)(ms|s|m|h|d)")
_EPOCH_MS = re.compile(r"\d{13}")
_HEADERS: tuple[tuple[Kind, str, bool], ...] = (  # kind; its header, {} for a word such as "limit"; `Allowance.steady`
    ("requests", "x-ratelimit-{}-requests", True),
    ("tokens", "x-ratelimit-{}-tokens", True),
    ("requests", "anthropic-ratelimit-requests-{}", True),
    ("tokens", "anthropic-ratelimit-tokens-{}", True),
    ("tokens", "anthropic-ratelimit-input-tokens-{}", True),
    ("requests", "x-ratelimit-{}", False),  # OpenRouter's fixed window
)


@dataclass(frozen=True, slots=True)
class Allowance:
    """The state of one rate limit."""

    kind: Kind
    limit: float  # the full amount
    left: float  # the amount that is left now
    reset_s: float  # s from now until the limit is full again
    steady: bool  # True: the limit refills continuously; False: only at the reset


def allowances(headers: Mapping[str, str], now: datetime | None = None) -> tuple[Allowance, ...]:
    """Return the allowances in the headers of an answer, at most one of each kind; none for unknown headers.

    `headers` has names in lower case. Times are relative to the answer's own Date, else to `now` (UTC).
    """
    date = http_date(headers.get("date")) or now or datetime.now(UTC)
    by_kind: dict[Kind, Allowance] = {}
    for kind, header, steady in _HEADERS:
        limit, left = (_number(headers.get(header.format(word))) for word in ("limit", "remaining"))
        reset_s = until(headers.get(header.format("reset")), date)
        if kind not in by_kind and limit and left is not None and reset_s is not None:
            limit = min(max(limit, LIMIT_MIN), LIMIT_MAX)  # so that no level or time of a bucket becomes infinite
            by_kind[kind] = Allowance(kind, limit, min(left, limit), reset_s, steady)
    return tuple(by_kind.values())


def until(text: str | None, now: datetime) -> float | None:
    """Return the seconds from `now` until a reset, 0 … LONGEST_S; None for an invalid text.

    `text` is a duration ('6m0s', '20ms', or '1.5' in seconds), an RFC 3339 time, or milliseconds since the epoch.
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


def http_date(text: str | None) -> datetime | None:
    """Return the time in an HTTP header; None for an invalid text. Without a zone it is UTC."""
    try:
        moment = parsedate_to_datetime(text or "")
    except (ValueError, OverflowError):
        return None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


LONGEST_WAIT_S = 60.0  # s, longest block of requests; a stored time farther ahead is ignored: the clock was set back
SLOW_S = 60.0  # s; after a block, requests are sent one by one for this time
SLOW_INTERVAL_S = 0.5  # s between requests during SLOW_S; needed for vendors without rate-limit headers
MINUTE_S = 60.0  # s, assumed time of a refill if the headers do not give it
LATE_S = 0.001  # s, margin on the computed time of a refill


@dataclass(frozen=True, slots=True)
class Bucket:
    """The remaining amount of a rate limit as a function of time (s)."""

    at: float  # time of `level`
    level: float
    full: float
    rate: float  # refill per s; 0: no refill before `whole_at`
    whole_at: float  # time at which the limit is full again

    def left(self, now: float) -> float:
        if now >= self.whole_at or now < self.at - LONGEST_WAIT_S:
            return self.full
        return min(self.full, self.level + self.rate * max(now - self.at, 0.0))

    def wait_s(self, want: float, now: float) -> float:
        """Return the seconds until the level is `want`, or until it is full if `want` is larger."""
        lacking = min(want, self.full) - self.left(now)
        if lacking <= 0.0:
            return 0.0
        whole_s = self.whole_at - now
        return (min(lacking / self.rate, whole_s) if self.rate > 0.0 else whole_s) + LATE_S

    def without(self, used: float, now: float) -> "Bucket":
        """Return the bucket after the use of `used`."""
        level = max(self.left(now) - used, 0.0)
        whole_at = now + (self.full - level) / self.rate if self.rate > 0.0 else self.whole_at
        return replace(self, at=now, level=level, whole_at=whole_at)


@dataclass(frozen=True, slots=True)
class RateLimitState:
    """The rate limits of an address. Each model has its own limits, but a rejection blocks all models."""

    held_until: float = 0.0  # no requests before this time
    slow_until: float = 0.0  # requests are sent one by one until this time
    next_at: float = 0.0  # earliest time of the next request, until `slow_until`
    buckets: Mapping[str, Bucket] = field(default_factory=dict)  # by 'KIND MODEL', such as 'tokens gpt-5'

    def claim(self, model: str, tokens: int, now: float) -> "tuple[float, RateLimitState]":
        """Return (0, the state after this request), or (seconds to wait, the same state)."""
        wants = {f"requests {model}": 1.0, f"tokens {model}": float(tokens)}
        limited = {name: (self.buckets[name], want) for name, want in wants.items() if name in self.buckets}
        held_s = self.held_until - now
        slow_s = self.next_at - now if now < self.slow_until else 0.0
        wait_s = max(
            held_s if held_s <= LONGEST_WAIT_S else 0.0,
            slow_s if slow_s <= SLOW_INTERVAL_S else 0.0,
            *(bucket.wait_s(want, now) for bucket, want in limited.values()),
            0.0,
        )
        if wait_s > 0.0:
            return wait_s, self
        taken = {name: bucket.without(want, now) for name, (bucket, want) in limited.items()}
        return 0.0, replace(self, next_at=now + SLOW_INTERVAL_S, buckets={**self.buckets, **taken})

    def updated(self, model: str, new: Allowance, now: float) -> "RateLimitState":
        """Return the state with a new allowance.

        The lower of the old and the new level counts, because the new level may not include the latest requests.
        """
        name = f"{new.kind} {model}"
        before = self.buckets.get(name)
        level = new.left if before is None or before.full != new.limit else min(new.left, before.left(now))
        used = new.limit - new.left
        rate = (used / new.reset_s if used > 0.0 and new.reset_s >= SHORTEST_S else new.limit / MINUTE_S) * new.steady
        whole_s = (new.limit - level) / rate if rate > 0.0 else new.reset_s
        bucket = Bucket(now, level, new.limit, rate, now + whole_s)
        return replace(self, buckets={**self.buckets, name: bucket})

    def held(self, seconds: float, now: float) -> "RateLimitState":
        """Return the state that blocks requests for `seconds`, then sends them one by one for SLOW_S."""
        until = now + min(seconds, LONGEST_WAIT_S)
        kept = self.held_until if self.held_until - now <= LONGEST_WAIT_S else 0.0
        return replace(self, held_until=max(kept, until), slow_until=until + SLOW_S)


class Limiter(Protocol):
    """The interface of a limiter of one address. Its state is in a file, a service or a cluster's actor."""

    def claim(self, tokens: int) -> float:
        """Count a request of about `tokens` tokens as sent and return 0, or return the seconds to wait first."""
        ...

    def update(self, allowances: tuple[Allowance, ...]) -> None:
        """Apply the allowances in the headers of an answer."""
        ...

    def hold(self, seconds: float) -> None:
        """Block requests for `seconds` after a rate-limit rejection."""
        ...


Limiters = Callable[[str, str], Limiter]  # (redacted address, model) → limiter
