"""What vendors say of their rate limits in the headers of every answer. Gemini and servers of one's own say nothing."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Literal

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
