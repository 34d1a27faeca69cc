"""The maps by name."""

import difflib
from collections.abc import Callable

from dronecats.border.errors import UsageError
from episodes.maps import blocks, campus, residential
from episodes.scene import Scene

_MAPS: dict[str, Callable[[int], Scene]] = {
    "blocks": blocks.build,
    "campus": campus.build,
    "residential": residential.build,
}


def names() -> list[str]:
    """Return the names of all maps, sorted."""
    return sorted(_MAPS)


def build(name: str, seed: int = 1) -> Scene:
    """Return the map `name`; the same seed gives the same scene. Raises UsageError for a name that is no map."""
    if name not in _MAPS:
        near = ", ".join(difflib.get_close_matches(name, names(), 3, 0.3) or names())
        raise UsageError(f"map '{name}' does not exist: did you mean {near}?")
    return _MAPS[name](seed)
