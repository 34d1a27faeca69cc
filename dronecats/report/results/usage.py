"""What an episode was asked and answered in tokens, and what that costs by the prices that its run declares."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from msgspec import UNSET

from dronecats.report.recorded.flight import RecordedFlight
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import exchanges, rows
from foundation.run_folder.rows import Decision


@dataclass(frozen=True, slots=True)
class Usage:
    """Questions that were answered, with their tokens. A fleet's joint question is one."""

    questions: int = 0
    tokens_in: int | None = None  # None: not told of any
    tokens_out: int | None = None
    commander_questions: int = 0
    commander_in: int | None = None
    commander_out: int | None = None
    cached: int | None = None  # of tokens_in, had from before
    reasoning: int | None = None  # of tokens_out
    endpoints: tuple[str, ...] = ()  # whom a router had answer, in the order in which they did


NONE_TOLD = Usage()


def usage(flown: RecordedFlight) -> Usage:
    """Return what an episode took. A joint reply stands in the log of each of its drones, and is counted once."""
    return _usage(flown.logs.decisions, flown.folder)


def usage_of(folder: Path) -> Usage:
    """Return the same of an episode's folder alone. Raises UsageError for a log that is damaged."""
    return _usage(rows(folder / layout.DECISIONS, Decision), folder)


def _usage(decisions: Iterable[Decision], folder: Path) -> Usage:
    asked = {decision.step: decision for decision in decisions}.values()
    try:
        commanded = [each for each in exchanges(folder) if each.reply is not None]
    except UsageError:  # no score goes by commander.jsonl
        commanded = []
    return Usage(
        questions=len(asked),
        tokens_in=_sum([each.tokens_in for each in asked]),
        tokens_out=_sum([each.tokens_out for each in asked]),
        commander_questions=len(commanded),
        commander_in=_sum([each.tokens_in for each in commanded]),
        commander_out=_sum([each.tokens_out for each in commanded]),
        cached=_sum([None if each.tokens_cached is UNSET else each.tokens_cached for each in asked]),
        reasoning=_sum([None if each.tokens_reasoning is UNSET else each.tokens_reasoning for each in asked]),
        endpoints=tuple(dict.fromkeys(str(each.endpoint) for each in asked if each.endpoint is not UNSET)),
    )


def _sum(counts: list[int | None]) -> int | None:
    told = [count for count in counts if count is not None]
    return sum(told) if told else None
