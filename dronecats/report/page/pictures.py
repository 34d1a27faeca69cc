"""Provides the pictures of a page: the pilots' frames, as files or embedded, and maps from above."""

import base64
import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.report.recorded.run import RecordedRun
from foundation.errors import DronecatsError
from foundation.protocol import FINISHED
from foundation.run_folder import layout
from foundation.run_folder.rows import Decision

FOLDER = "pictures"
# limits of embedded pictures: a browser can open this many at once (50 MB), and the pictures are still clear
EMBEDDED_MAX = 5000
EMBEDDED_WIDTH_PX = 480
EMBEDDED_QUALITY = 60  # of WebP: about 9 kB per picture

PictureAddress = Callable[[Decision], str | None]  # returns the address of a decision's frame; None: no frame


def embedding_stride(runs: Sequence[RecordedRun]) -> int:
    """Return n such that the pictures of every n-th step can be embedded; 1: all pictures."""
    folders = [folder / layout.FRAMES for run in runs if run.is_rendered for folder in run.episodes]
    total = sum(len(os.listdir(folder)) for folder in folders if folder.is_dir())
    return max(1, math.ceil(total / EMBEDDED_MAX))


def selected_frames(decisions: Sequence[Decision], every: int) -> set[tuple[int, int]]:
    """Return the (drone, frame id) of the pictures to keep: every n-th step, the last step, and declarations."""
    steps = sorted({decision.step for decision in decisions})
    chosen = {*steps[::every], *steps[-1:]}
    return {(d.drone, d.frame_id) for d in decisions if d.step in chosen or d.kind == FINISHED}


def linked_pictures(flight: JudgedFlight, out: Path, place: Path) -> PictureAddress:
    """Return a function that puts a decision's picture into `out`/`place`, and returns its address relative to `out`.

    The pictures are hard links, or copies if the file system does not allow hard links. The function raises OSError.
    """

    def address(decision: Decision) -> str | None:
        source = flight.picture_path(decision)
        if source is None:
            return None
        target = out / place / source.name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not (target.exists() and target.samefile(source)):
            with suppress(FileNotFoundError):
                target.unlink()
            try:
                os.link(source, target)
            except OSError:
                shutil.copyfile(source, target)
        return (place / source.name).as_posix()

    return address


def embedded_pictures(flight: JudgedFlight, every: int) -> PictureAddress:
    """Return a function that returns a decision's picture in reduced size, as a data: URL; None if it is not kept."""
    wanted = selected_frames(flight.logs.decisions, every)

    def address(decision: Decision) -> str | None:
        source = flight.picture_path(decision) if (decision.drone, decision.frame_id) in wanted else None
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


def no_pictures(decision: Decision) -> None:
    """Return None: the `PictureAddress` of runs without pictures."""


GROUND_PX = 1500
GROUND_QUALITY = 62
MARGIN_M = 12.0  # m, margin around the map's objects
MAPS = 12  # largest number of maps, to limit the size of a page


def ground_key(folder: Path) -> str:
    """Return the map of an episode folder as map/seed; empty: unknown."""
    try:
        record = json.loads((folder / layout.EPISODE).read_text(encoding="utf-8"))
        return f"{record['map']}/{int(record.get('map_seed', 1))}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def grounds(wanted: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the pictures of maps by `ground_key`: at most MAPS, and only maps that this machine can draw."""
    pictures = {}
    for key in sorted({*wanted} - {""})[:MAPS]:
        name, _, seed = key.rpartition("/")
        try:
            pictures[key] = ground(name, int(seed))
        except (DronecatsError, ImportError, ValueError):
            continue
    return pictures


def ground(name: str, seed: int) -> dict[str, Any]:
    """Return the square picture of a map, north up: its centre (m NED), half of its side (m), and its data: URL.

    Raises UsageError for an unknown map, ImportError without a renderer.
    """
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
    return {"north": north, "east": east, "half": half, "picture": address}
