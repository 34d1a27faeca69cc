"""The maps by name: those that ship, built from a seed, and those of the user, read from glTF files."""

import difflib
from collections.abc import Callable

from dronecats.border.errors import UsageError
from episodes.maps import blocks, campus, residential, user
from episodes.scene import Scene

_MAPS: dict[str, Callable[[int], Scene]] = {
    "blocks": blocks.build,
    "campus": campus.build,
    "residential": residential.build,
}


def shipped() -> list[str]:
    """Return the names of the maps that ship, sorted."""
    return sorted(_MAPS)


def names() -> list[str]:
    """Return the names of all maps: those that ship, then the user's own, each sorted."""
    return shipped() + [name for name in user.names() if name not in _MAPS]


def build(name: str, seed: int = 1) -> Scene:
    """Return the map `name`; the same seed gives the same scene. Raises UsageError for a name that is no map.

    A user's map has no seed: it is what its file says.
    """
    if name not in _MAPS and name in user.names():
        return user.build(name)
    if name not in _MAPS:
        near = ", ".join(difflib.get_close_matches(name, names(), 3, 0.3) or names())
        raise UsageError(f"map '{name}' does not exist: did you mean {near}?")
    return _MAPS[name](seed)
