"""The world of a flight, from its folder alone."""

from pathlib import Path

from episodes.records import record as records
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object


def flown_world(folder: Path) -> World | None:
    """Return the world of an episode folder; None where none is known: a real place, or a map that is not here."""
    drawn = folder / layout.WORLD  # of a flight on a map that is not judged
    try:
        return World(records.load(drawn if drawn.is_file() else folder / layout.EPISODE))
    except UsageError:
        return None


def is_told(folder: Path) -> bool:
    """Return whether an episode folder tells what is flown there; it is told before anything flies."""
    return json_object(folder / layout.EPISODE) is not None


def instruction_in(folder: Path) -> str:
    """Return what the pilots of an episode folder are told to do."""
    return str((json_object(folder / layout.EPISODE) or {}).get("instruction") or "")


def lens_in(folder: Path) -> CameraModel:
    """Return the camera of a flight: as run.json tells it, else the benchmark's. Where it sits is not told."""
    told = (json_object(folder.parent / layout.RUN) or {}).get("camera")
    if not isinstance(told, dict):
        return CameraModel()
    try:
        return CameraModel(int(told["width"]), int(told["height"]), float(told["hfov_deg"]))
    except (KeyError, TypeError, ValueError):
        return CameraModel()
