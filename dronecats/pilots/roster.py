"""The built-in pilots by name."""

import difflib
from collections.abc import Callable
from pathlib import Path

from dronecats.border.errors import UsageError

SERVED = {"vision": "dronecats (classical vision, not a model)", "blind": "dronecats (sees nothing, not a model)"}
RECORDED = "recorded:"
NAMES = (*SERVED, "oracle")


def check(name: str) -> str:
    """Return `name` if there is such a pilot. Raises UsageError with the nearest names, or for a file it cannot say."""
    if name in NAMES:
        return name
    if name.startswith(RECORDED):
        answer(name)
        return name
    near = difflib.get_close_matches(name, NAMES, n=2, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(NAMES)} and {RECORDED}FILE"
    raise UsageError(f"there is no pilot '{name}'; {hint}")


def answer(name: str) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply of a served pilot. Raises UsageError for a file that is none."""
    if name.startswith(RECORDED):
        from dronecats.pilots.recorded import player

        return player(Path(name.removeprefix(RECORDED)))
    if name == "vision":
        from dronecats.pilots.vision import answer as vision

        return vision
    from dronecats.pilots.blind import answer as blind

    return blind


def owner(name: str) -> str:
    """Return what a served pilot's endpoint says of itself to whoever lists its models."""
    return SERVED.get(name, "dronecats (replies of another flight said again, not a model)")
