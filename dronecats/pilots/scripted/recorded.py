"""A pilot that repeats the replies of another flight: a script, never a model.

With it the same decisions fly on two autopilots, and `dronecats compare` shows how far their paths differ.
"""

from dataclasses import dataclass
from pathlib import Path

from dronecats.pilots import actions
from dronecats.pilots.actions import Pilot
from foundation.errors import UsageError
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Whole


@dataclass(frozen=True, slots=True)
class ScriptedReply:
    """The required fields of a decision, so that a script can be written by hand."""

    step: Whole
    reply: str  # as received; of all drones of a fleet


def replies(path: Path) -> list[str]:
    """Return the replies of a decisions.jsonl, one per step. Raises UsageError."""
    by_step: dict[int, str] = {}
    for row in rows(path, ScriptedReply):
        by_step.setdefault(row.step, row.reply)
    if not by_step:
        raise UsageError(f"{path} holds no decision; give the {DECISIONS} of a flight that took steps")
    return [by_step[step] for step in sorted(by_step)]


def player(path: Path) -> Pilot:
    """Return the pilot that gives a file's replies in order, and then thinks."""
    remaining = iter(replies(path))

    def answer(prompt: str, images: list[bytes]) -> str:
        return next(remaining, actions.join([actions.think()] * max(1, len(images))))

    return answer
