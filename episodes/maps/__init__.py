"""Maps by name: the shipped maps, built from a seed, and the user's own maps, read from glTF files."""

import hashlib
from collections.abc import Callable

from episodes.maps import blocks, campus, residential, residential_places, user
from episodes.maps.scene import Places, Scene
from foundation.errors import UsageError
from foundation.kept_values import kept
from foundation.threads import once
from foundation.wording import suggestion

# map → (function that makes the scene of a seed, function that makes the places of a seed)
_MAPS: dict[str, tuple[Callable[[int], Scene], Callable[[int], Places]]] = {
    "blocks": (blocks.build, blocks.places),
    "campus": (campus.build, campus.places),
    "residential": (residential.build, residential_places.places),
}
_SOURCES = ("episodes/maps/**/*.py", "foundation/*.py", "vehicles/*.py")  # everything that a shipped map depends on
# map → camera pose of its overview picture: north, east, height above the ground in m, heading and pitch in degrees
VANTAGE: dict[str, tuple[float, float, float, float, float]] = {
    "blocks": (-46.0, -30.0, 9.0, 32.0, -9.0),
    "campus": (-17.0, -25.0, 6.5, 34.0, -6.0),
    "residential": (-40.0, 3.0, 11.0, 356.0, -12.0),
}


def shipped() -> list[str]:
    """Return the names of the shipped maps, sorted."""
    return sorted(_MAPS)


def names() -> list[str]:
    """Return the names of all maps: the shipped maps, then the user's own, each group sorted."""
    return shipped() + [name for name in user.names() if name not in _MAPS]


def build(name: str, seed: int = 1) -> Scene:
    """Return the map `name`. Raises UsageError for an unknown name or a negative seed.

    The same seed gives the same scene. The seed has no effect on a user's map.
    """
    if name not in _MAPS and name in user.names():
        return user.build(name)
    if name not in _MAPS:
        raise UsageError(f"map '{name}' does not exist: {suggestion(name, names())}")
    if seed < 0:
        raise UsageError(f"the seed of a map must be a whole number from 0, got {seed}")
    return _shipped(name, seed)


@once(3)  # a run flies many episodes on one map; scenes are immutable
def _shipped(name: str, seed: int) -> Scene:
    return kept(f"map-{name}-{seed}", _SOURCES, lambda: _MAPS[name][0](seed))


def digest(name: str) -> str | None:
    """Return the SHA-256 of a user's map file, which identifies the map in results; None for a shipped map."""
    if name in _MAPS:
        return None
    return hashlib.sha256(user.path_of(name).read_bytes()).hexdigest()


def places(name: str, seed: int = 1) -> Places:
    """Return the free ground, lanes and landmarks of a shipped map. Raises UsageError for any other map."""
    if name not in _MAPS:
        raise UsageError(f"map '{name}' lists no free places: only {', '.join(shipped())} do.")
    return _places(name, seed)


@once(3)  # the editor calls this at each change of the cell; places are immutable
def _places(name: str, seed: int) -> Places:
    return _MAPS[name][1](seed)
