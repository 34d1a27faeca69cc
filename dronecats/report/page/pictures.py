"""Provides the pictures of the page: the frames of the models, beside or within the page, and maps from above."""

import base64
import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dronecats.report.recorded.run import RecordedRun
from foundation.errors import DronecatsError
from foundation.protocol import FINISHED
from foundation.run_folder import layout
from foundation.run_folder.rows import Decision

FOLDER = "pictures"
# within a page: as many as a browser opens at once (50 MB), in a size that is still clear
EMBEDDED_MAX = 5000
EMBEDDED_WIDTH_PX = 480
EMBEDDED_QUALITY = 60  # WebP: some 9 kB a picture

PictureAddress = Callable[[Decision], str | None]  # returns the address of a decision's frame; None: there is none


def every_for(runs: Sequence[RecordedRun]) -> int:
    """Return the stride of the steps whose pictures can be embedded; 1: all of them."""
    folders = [folder / layout.FRAMES for run in runs if run.is_rendered for folder in run.episodes]
    total = sum(len(os.listdir(folder)) for folder in folders if folder.is_dir())
    return max(1, math.ceil(total / EMBEDDED_MAX))


def kept(decisions: Sequence[Decision], every: int) -> set[tuple[int, int]]:
    """Return the (drone, frame id) of the pictures to keep: of each n-th step, the first, the last and declarations."""
    steps = sorted({decision.step for decision in decisions})
    chosen = {*steps[::every], *steps[-1:]}
    return {(d.drone, d.frame_id) for d in decisions if d.step in chosen or d.kind == FINISHED}


def beside(out: Path, place: Path, folder: Path, wanted: set[tuple[int, int]]) -> PictureAddress:
    """Put an episode's pictures at `out`/`place`; the addresses are relative to `out`. The answer raises OSError.

    They are hard links where the file system has them, which cost no space, and copies where it has not.
    """
    there = out / place
    there.mkdir(parents=True, exist_ok=True)

    def address(decision: Decision) -> str | None:
        source = _frame(folder, decision, wanted)
        if source is None:
            return None
        target = there / source.name
        if not (target.exists() and target.samefile(source)):
            with suppress(FileNotFoundError):
                target.unlink()
            try:
                os.link(source, target)
            except OSError:
                shutil.copyfile(source, target)
        return (place / source.name).as_posix()

    return address


def within(folder: Path, wanted: set[tuple[int, int]]) -> PictureAddress:
    """Return the addresses of an episode's pictures as data: URLs, of reduced size."""

    def address(decision: Decision) -> str | None:
        source = _frame(folder, decision, wanted)
        picture = None if source is None else cv2.imread(str(source))
        if picture is None:
            return None
        height, width = picture.shape[:2]
        if width > EMBEDDED_WIDTH_PX:
            size = (EMBEDDED_WIDTH_PX, round(height * EMBEDDED_WIDTH_PX / width))
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, EMBEDDED_QUALITY])[1].tobytes()
        return f"data:image/webp;base64,{base64.b64encode(data).decode()}"

    return address


def nowhere(decision: Decision) -> None:
    """Return no address, for runs without pictures."""


def _frame(folder: Path, decision: Decision, wanted: set[tuple[int, int]]) -> Path | None:
    if (decision.drone, decision.frame_id) not in wanted:
        return None
    path = folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
    return path if path.is_file() else None


GROUND_PX = 1500
GROUND_QUALITY = 62
MARGIN_M = 12.0  # around the places of the map's objects
MAPS = 12  # at most, to bound the size of a page


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPicture:
    """A square picture of a map, north up."""

    north: float  # m NED, of its middle
    east: float  # m NED, likewise
    half: float  # m, from the middle to a side
    picture: str  # a data: address


def ground_key(folder: Path) -> str:
    """Return the map of an episode's folder as map/seed; empty: not known."""
    try:
        record = json.loads((folder / layout.EPISODE).read_text(encoding="utf-8"))
        return f"{record['map']}/{int(record.get('map_seed', 1))}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def grounds(wanted: Iterable[str]) -> dict[str, GroundPicture]:
    """Return the pictures by `ground_key`, without the maps that cannot be drawn here."""
    pictures = {}
    for key in sorted({*wanted} - {""})[:MAPS]:
        name, _, seed = key.rpartition("/")
        try:
            pictures[key] = ground(name, int(seed))
        except (DronecatsError, ImportError, ValueError):
            continue
    return pictures


def ground(name: str, seed: int) -> GroundPicture:
    """Return the picture of a map. Raises UsageError for a name that is no map, ImportError without a renderer."""
    from episodes import maps
    from episodes.authoring.scene_pictures import from_above

    scene = maps.build(name, seed)
    places = np.array([instance.position_ned[:2] for instance in scene.instances] or [scene.spawn_ned[:2]])
    low, high = places.min(axis=0), places.max(axis=0)
    north, east = (float(x) for x in (low + high) / 2)
    half = max(float((high - low).max()) / 2 + MARGIN_M, 20.0)
    view = from_above(scene, north, east, half, GROUND_PX)
    data = cv2.imencode(".jpg", view[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, GROUND_QUALITY])[1].tobytes()
    address = f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
    return GroundPicture(north=north, east=east, half=half, picture=address)
