"""A pilot that says again what was said on another flight, reply by reply: a script, and never a model.

With it the same decisions fly on two autopilots, and `dronecats compare` tells how far their paths part.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dronecats.pilots import reply
from foundation.errors import UsageError
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Whole


@dataclass(frozen=True, slots=True)
class RecordedReply:
    """All that is asked of a decision here, so that a script may be written by hand."""

    step: Whole
    reply: str  # as received; a fleet's whole


def replies(path: Path) -> list[str]:
    """Return the replies of a decisions.jsonl, one per step, a fleet's whole. Raises UsageError."""
    by_step: dict[int, str] = {}
    for said in rows(path, RecordedReply):
        by_step.setdefault(said.step, said.reply)
    if not by_step:
        raise UsageError(f"{path} holds no decision; give the {DECISIONS} of a flight that took steps")
    return [by_step[step] for step in sorted(by_step)]


def player(path: Path) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply that gives a file's replies in order, and then thinks."""
    coming = iter(replies(path))

    def answer(prompt: str, images: list[bytes]) -> str:
        return next(coming, reply.fleet([reply.think()] * max(1, len(images))))

    return answer
