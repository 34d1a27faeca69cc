"""Manages the maps of users: `.glb` files in a folder. Episode records name them like shipped maps."""

import os
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from episodes.maps.scene import Scene
from foundation.errors import UsageError
from foundation.files import file_errors_as, whole_file
from foundation.wording import did_you_mean, nearest

FOLDER = "DRONECATS_MAPS"  # environment variable: where the maps are
_NAME = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,38}[a-z0-9])?")


def folder() -> Path:
    """Return the folder of the user's maps: $DRONECATS_MAPS, else `dronecats/maps` under the user's data folder.

    Raises UsageError if the user has no home folder and the variable is not set.
    """
    try:
        if path := os.environ.get(FOLDER):
            return Path(path).expanduser()
        data = os.environ.get("XDG_DATA_HOME")
        return (Path(data) if data else Path.home() / ".local" / "share") / "dronecats" / "maps"
    except RuntimeError:  # a user id that has no home
        raise UsageError(f"this user has no home folder for maps. Set {FOLDER} to the path of a folder") from None


def names() -> list[str]:
    """Return the names of the user's maps, sorted; [] if the folder cannot be read."""
    try:
        return sorted(path.stem for path in folder().glob("*.glb") if _NAME.fullmatch(path.stem))
    except (OSError, UsageError):
        return []


def build(name: str) -> Scene:
    """Return a user's map. Raises UsageError if the user has no map of that name, or its file is wrong."""
    from episodes.maps import gltf  # imports the libraries for rays and pictures, which a list of names does not need

    return gltf.load(path_of(name))


def path_of(name: str) -> Path:
    """Return the file of a user's map. Raises UsageError if the name is not in `names()`."""
    if name not in names():
        near = nearest(name, names(), cutoff=0.4)
        hint = did_you_mean(near) if near else "import one with `dronecats maps import`."
        raise UsageError(f"you have no map {name[:80]!r}: {hint}")
    return folder() / f"{name}.glb"


def add(
    path: Path, name: str, spawn: Sequence[float] | None, taken: Collection[str] = (), replace: bool = False
) -> Scene:
    """Check the glTF file of a map and store it under a name; return the map as flights will use it.

    In the stored file, the ground is separate from the other objects, all transforms are applied, and large textures
    are scaled down.

    Raises UsageError if the name is invalid or in `taken`, if the user already has a map of this name and `replace` is
    false, or if the file cannot be a map.
    """
    from episodes.maps import gltf

    if not _NAME.fullmatch(name):
        raise UsageError(f"{name[:80]!r} cannot name a map. Use up to 40 small letters, digits and hyphens.")
    if name in taken:
        raise UsageError(f"'{name}' is the name of a shipped map. Choose another name.")
    kept = folder() / f"{name}.glb"
    if kept.exists() and not replace:
        raise UsageError(f"you already have a map '{name}'. Choose another name, or add --replace.")
    scene = gltf.load(path, spawn, name)
    with file_errors_as(UsageError, f"the map cannot be written to '{kept.parent}'", "."):
        kept.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(kept) as draft:
            gltf.save(scene, draft)
    return scene
