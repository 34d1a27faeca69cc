"""The built-in pilots by name."""

from collections.abc import Callable, Iterable
from pathlib import Path

from dronecats.pilots.oracle.failing import FAILURES
from dronecats.pilots.scripted.patterns import PATTERNS
from dronecats.pilots.vision import inscription
from foundation.errors import UsageError
from foundation.wording import did_you_mean, nearest

SERVED = {"vision": "dronecats (classical vision, not a model)", "blind": "dronecats (sees nothing, not a model)"}
RECORDED, BLIND, FAILING = "recorded:", "blind:", "failing:"
ORACLE, NOISY = "oracle", "noisy"
NAMES = (*SERVED, ORACLE, NOISY)
COMMANDERS = {"scripted:divide": "dronecats (a script that divides, not a model)"}


def check(name: str) -> str:
    """Return `name` if there is such a pilot. Raises UsageError with the nearest names, or for a file it cannot say."""
    if name in NAMES or (name.removeprefix(BLIND) in PATTERNS and name.startswith(BLIND)):
        return name
    if name.startswith(FAILING):
        if name.removeprefix(FAILING) in FAILURES:
            return name
        known = "; ".join(f"{one} {failing.says}" for one, failing in FAILURES.items())
        raise UsageError(f"there is no failing pilot '{name.removeprefix(FAILING)}'; there are: {known}")
    if name.startswith(RECORDED):
        answer(name)
        return name
    if name.startswith(BLIND):
        known = "; ".join(f"{one} {pattern.says}" for one, pattern in PATTERNS.items())
        raise UsageError(f"there is no blind pilot '{name.removeprefix(BLIND)}'; there are: {known}")
    near = nearest(name, NAMES, count=2, cutoff=0.4)
    every = ", ".join((*NAMES, f"{BLIND}NAME", f"{FAILING}NAME", f"{RECORDED}FILE"))
    hint = did_you_mean(near) if near else f"there are {every}"
    raise UsageError(f"there is no pilot '{name}'; {hint}")


def check_installed(name: str, instructions: Iterable[str]) -> None:
    """Raise UsageError when a pilot needs a package for one of these instructions that is not installed."""
    if name == "vision" and any(map(inscription.named, instructions)):
        from dronecats.pilots.vision import reading

        reading.check_installed()


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
    return not knows(name) and name != "blind" and not name.startswith(BLIND)


def knows(name: str | None) -> bool:
    """Return whether a pilot is told the truth, and flies only where that is known."""
    return name is not None and (name in (ORACLE, NOISY) or name.startswith(FAILING))


def answer(name: str) -> Callable[[str, list[bytes]], str]:
    """Return the function (prompt, JPEGs) -> reply of a served pilot, for one flight.

    Raises UsageError for a file that holds no flight.
    """
    if name.startswith(RECORDED):
        from dronecats.pilots.scripted.recorded import player

        return player(Path(name.removeprefix(RECORDED)))
    if name in COMMANDERS:
        from dronecats.pilots.scripted.commander import divide

        return divide
    if name == "vision":
        from dronecats.pilots.vision.pilot import answer as vision

        return vision
    from dronecats.pilots.scripted import blind

    return blind.pilot(name.removeprefix(BLIND)) if name.startswith(BLIND) else blind.answer


def owner(name: str) -> str:
    """Return what a served pilot's endpoint says of itself to whoever lists its models."""
    if name.startswith(BLIND):
        return f"{SERVED['blind'][:-1]}: {PATTERNS[name.removeprefix(BLIND)].says})"
    return (SERVED | COMMANDERS).get(name, "dronecats (replies of another flight said again, not a model)")
