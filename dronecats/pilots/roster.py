"""The built-in pilots by name."""

import difflib
from collections.abc import Callable

from dronecats.border.errors import UsageError

SERVED = {"vision": "dronecats (classical vision, not a model)", "blind": "dronecats (sees nothing, not a model)"}
NAMES = (*SERVED, "oracle")


def check(name: str) -> str:
    """Return `name` if there is such a pilot. Raises UsageError with the nearest names."""
    if name in NAMES:
        return name
    near = difflib.get_close_matches(name, NAMES, n=2, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(NAMES)}"
    raise UsageError(f"there is no pilot '{name}'; {hint}")


def answer(name: str) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply of a served pilot."""
    if name == "vision":
        from dronecats.pilots.vision import answer as vision

        return vision
    from dronecats.pilots.blind import answer as blind

    return blind
