"""Taking turns at an address, as a value: what it allows, and until when it lets nobody ask. Pure: the clock comes in.

All moments are s of a clock that everybody who asks there shares.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from dronecats.agent.models.rate_headers import Allowance

LONGEST_S = 60.0  # that nobody asks; a moment further ahead is of a clock that was set back
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
        if now >= self.whole_at or now < self.at - LONGEST_S:
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
            held_s if held_s <= LONGEST_S else 0.0,
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
        until = now + min(seconds, LONGEST_S)
        kept = self.held_until if self.held_until - now <= LONGEST_S else 0.0
        return replace(self, held_until=max(kept, until), slow_until=until + SLOW_S)
