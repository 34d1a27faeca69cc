"""What an episode was asked and answered in tokens, and what that costs by the prices that its run declares."""

from dataclasses import dataclass

from dronecats.metrics.flown_episode import FlownEpisode
from dronecats.rundir.reading import exchanges
from foundation.errors import UsageError


@dataclass(frozen=True, slots=True)
class Usage:
    """Questions that were answered, with their tokens. A fleet's joint question is one."""

    questions: int = 0
    tokens_in: int | None = None  # None: not told of any
    tokens_out: int | None = None
    commander_questions: int = 0
    commander_in: int | None = None
    commander_out: int | None = None


NONE_TOLD = Usage()


def usage(flown: FlownEpisode) -> Usage:
    """Return what an episode took. A joint reply stands in the log of each of its drones, and is counted once."""
    asked = {decision.step: decision for decision in flown.logs.decisions}.values()
    try:
        commanded = [each for each in exchanges(flown.folder) if each.reply is not None]
    except UsageError:  # no score goes by commander.jsonl
        commanded = []
    return Usage(
        questions=len(asked),
        tokens_in=_sum([each.tokens_in for each in asked]),
        tokens_out=_sum([each.tokens_out for each in asked]),
        commander_questions=len(commanded),
        commander_in=_sum([each.tokens_in for each in commanded]),
        commander_out=_sum([each.tokens_out for each in commanded]),
    )


def _sum(counts: list[int | None]) -> int | None:
    told = [count for count in counts if count is not None]
    return sum(told) if told else None
