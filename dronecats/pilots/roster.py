"""The built-in pilots by name."""

import difflib
from collections.abc import Callable
from pathlib import Path

from dronecats.pilots.patterns import PATTERNS
from foundation.errors import UsageError

SERVED = {"vision": "dronecats (classical vision, not a model)", "blind": "dronecats (sees nothing, not a model)"}
COMMANDERS = {"scripted:divide": "dronecats (a script that divides, not a model)"}
RECORDED, BLIND = "recorded:", "blind:"
NAMES = (*SERVED, "oracle")


def check(name: str) -> str:
    """Return `name` if there is such a pilot. Raises UsageError with the nearest names, or for a file it cannot say."""
    if name in NAMES or (name.removeprefix(BLIND) in PATTERNS and name.startswith(BLIND)):
        return name
    if name.startswith(RECORDED):
        answer(name)
        return name
    if name.startswith(BLIND):
        known = "; ".join(f"{one} {pattern.says}" for one, pattern in PATTERNS.items())
        raise UsageError(f"there is no blind pilot '{name.removeprefix(BLIND)}'; there are: {known}")
    near = difflib.get_close_matches(name, NAMES, n=2, cutoff=0.4)
    hint = (
        f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(NAMES)}, {BLIND}NAME, {RECORDED}FILE"
    )
    raise UsageError(f"there is no pilot '{name}'; {hint}")


def check_commander(name: str) -> str:
    """Return `name` if there is such a built-in commander. Raises UsageError."""
    if name in COMMANDERS:
        return name
    raise UsageError(f"there is no commander '{name}'; there are PROVIDER/NAME and {', '.join(COMMANDERS)}")


def forgets(name: str) -> bool:
    """Return whether a pilot answers a question by what stands in it, whoever's drone it is about."""
    return name in NAMES


def looks(name: str) -> bool:
    """Return whether a pilot looks at the frames, which must be drawn for it then."""
    return name not in ("oracle", "blind") and not name.startswith(BLIND)


def answer(name: str) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply of a served pilot, for one flight.

    Raises UsageError for a file that holds no flight.
    """
    if name.startswith(RECORDED):
        from dronecats.pilots.recorded import player

        return player(Path(name.removeprefix(RECORDED)))
    if name in COMMANDERS:
        from dronecats.pilots.commander import divide

        return divide
    if name == "vision":
        from dronecats.pilots.vision import answer as vision

        return vision
    from dronecats.pilots import blind

    return blind.pilot(name.removeprefix(BLIND)) if name.startswith(BLIND) else blind.answer


def owner(name: str) -> str:
    """Return what a served pilot's endpoint says of itself to whoever lists its models."""
    if name.startswith(BLIND):
        return f"{SERVED['blind'][:-1]}: {PATTERNS[name.removeprefix(BLIND)].says})"
    return (SERVED | COMMANDERS).get(name, "dronecats (replies of another flight said again, not a model)")
