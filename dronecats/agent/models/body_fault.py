"""What went wrong by an answer's own words, whatever its status: gateways say 200 first and think about it later."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

BUSY, DOWN, REFUSED = 429, 503, 400  # what a word for an error comes to
_WORDS = (
    (BUSY, re.compile(r"rate.?limit|too.?many|resource.?exhausted", re.IGNORECASE)),
    (
        DOWN,
        re.compile(r"overloaded|unavailable|time.?d?.?out|server.?error|internal|api.?error|gateway", re.IGNORECASE),
    ),
)
_EXHAUSTED = re.compile(
    rb"insufficient.{0,3}(quota|balance|credits?|funds)|credit balance is too low|billing_(hard_limit|not_active)"
    rb"|per.?day",
    re.IGNORECASE,
)
_DELAY = re.compile(r"(\d{1,6}(?:\.\d{1,9})?)s")  # google.rpc.RetryInfo


@dataclass(frozen=True, slots=True)
class BodyFault:
    """Why a body is no answer."""

    status: int  # of HTTP: the vendor's own, or what its word comes to
    cut: bool = False  # it ends in the middle of its JSON


def fault_in(body: bytes) -> BodyFault | None:
    """Return what the body of a 200 says went wrong; None for one that says nothing of the kind.

    An error may stand at the top, as Gemini, Anthropic and OpenRouter have it, or in the first choice, where OpenRouter
    puts what befell a model in the middle of its reply.
    """
    try:
        data = json.loads(body)
    except ValueError:
        return BodyFault(DOWN, cut=True) if body.lstrip()[:1] == b"{" else None
    except RecursionError:
        return None
    for error in _errors(data):
        return BodyFault(_status(error))
    return None


def delay_in(body: bytes) -> float | None:
    """Return the seconds that Gemini asks for in the details of a refusal; None where it asks for none."""
    try:
        details = json.loads(body)["error"]["details"]
        delays = [_DELAY.fullmatch(each["retryDelay"]) for each in details if "retryDelay" in each]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return max((float(delay[1]) for delay in delays if delay), default=None)


def is_exhausted(body: bytes) -> bool:
    """Return whether a refusal says that there is no credit left, or that a day's allowance is used up."""
    return _EXHAUSTED.search(body) is not None


def _errors(data: Any) -> Iterator[Any]:
    """Yield the errors that stand in an answer."""
    if not isinstance(data, dict):
        return
    choices = data.get("choices")
    first = choices[0] if isinstance(choices, list) and choices else None
    for place in (data, first):
        if isinstance(place, dict) and place.get("error"):
            yield place["error"]


def _status(error: Any) -> int:
    told = [error.get(name) for name in ("code", "status", "type")] if isinstance(error, dict) else [error]
    for each in told:
        digits = str(each) if isinstance(each, int | str) and not isinstance(each, bool) else ""
        if re.fullmatch(r"[45]\d\d", digits):
            return int(digits)
    said = " ".join(each for each in told if isinstance(each, str))
    return next((status for status, word in _WORDS if word.search(said)), REFUSED)
