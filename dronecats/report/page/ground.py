"""A picture of a map from above, on which the page draws flights: once a map, small enough to stand in the page."""

import base64
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from foundation.errors import DronecatsError
from foundation.run_folder import layout

SIDE_PX = 1500
QUALITY = 62
MARGIN_M = 12.0  # around the places of what stands there
MAPS = 12  # at most: a collection of many worlds of one's own would make the page large


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPicture:
    """A square picture of a map, north up."""

    north: float  # m NED, of its middle
    east: float  # m NED, likewise
    half: float  # m, from the middle to a side
    picture: str  # a data: address


def ground_key(folder: Path) -> str:
    """Return what tells the map of an episode's folder: map/seed; empty: not known."""
    try:
        record = json.loads((folder / layout.EPISODE).read_text(encoding="utf-8"))
        return f"{record['map']}/{int(record.get('map_seed', 1))}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def grounds(wanted: Iterable[str]) -> dict[str, GroundPicture]:
    """Return the pictures by `ground_key`; a map that cannot be drawn here is left out, and flights are on a grid."""
    found = {}
    for key in sorted({*wanted} - {""})[:MAPS]:
        name, _, seed = key.rpartition("/")
        try:
            found[key] = ground(name, int(seed))
        except (DronecatsError, ImportError, ValueError):
            continue
    return found


def ground(name: str, seed: int) -> GroundPicture:
    """Return the picture of a map. Raises UsageError for a name that is no map, ImportError without a renderer."""
    from episodes import maps
    from episodes.authoring.pictures.map_plan import from_above

    scene = maps.build(name, seed)
    places = np.array([one.position_ned[:2] for one in scene.instances] or [scene.spawn_ned[:2]])
    low, high = places.min(axis=0), places.max(axis=0)
    north, east = (float(x) for x in (low + high) / 2)
    half = max(float((high - low).max()) / 2 + MARGIN_M, 20.0)
    view = from_above(scene, north, east, half, SIDE_PX)
    data = cv2.imencode(".jpg", view[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    address = f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
    return GroundPicture(north=north, east=east, half=half, picture=address)
