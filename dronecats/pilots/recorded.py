"""A pilot that says again what was said on another flight, reply by reply: a script, and never a model.

With it the same decisions fly on two autopilots, and `dronecats compare` tells how far their paths part.
"""

from collections.abc import Callable
from pathlib import Path

from dronecats.judge.files import lines
from dronecats.pilots import reply
from foundation.errors import UsageError


def replies(path: Path) -> list[str]:
    """Return the replies of a decisions.jsonl, one per step, a fleet's whole. Raises UsageError."""
    by_step: dict[int, str] = {}
    for row in lines(path, _fault):
        by_step.setdefault(row["step"], row["reply"])
    if not by_step:
        raise UsageError(f"{path} holds no decision; give the decisions.jsonl of a flight that took steps")
    return [by_step[step] for step in sorted(by_step)]


def player(path: Path) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply that gives a file's replies in order, and then thinks."""
    coming = iter(replies(path))

    def answer(prompt: str, images: list[bytes]) -> str:
        return next(coming, reply.fleet([reply.think()] * max(1, len(images))))

    return answer


def _fault(row: dict[str, object]) -> str | None:
    step = row.get("step")
    if not isinstance(step, int) or isinstance(step, bool):
        return "its step is not a whole number"
    return None if isinstance(row.get("reply"), str) else "its reply is not text"
