"""What of a map can be seen from a start, so that an instruction may refer to it."""

import math
from collections import Counter, defaultdict
from functools import lru_cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from episodes import maps
from episodes.authoring.check.nouns import nouns
from episodes.authoring.check.referring import Footprint
from episodes.maps.places import Places
from episodes.maps.scene import Instance
from episodes.world.visibility import turn
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_from_euler, rotate

CAMERA = CameraModel(320, 180)
SEEN_SHARE = 0.0015  # of the picture: a landmark that is spoken of must be as large as that
# kinds that no instruction refers to: too large, too many of one look, or too slight
UNNAMED = ("ground", "hall", "house", "wood", "tree", "conifer", "shrub", "bush", "hedge", "fence", "lamp", "bollard")
SLIGHT = ("bench", "bin", "person")  # kinds that may be looked for, but by which nothing else is told


def footprint(one: Instance) -> Footprint:
    """Return where an instance stands."""
    low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
    north, east, _ = np.array(one.position_ned) + turn(one.turned) @ ((low + high) / 2)
    half = (high - low) / 2
    return Footprint(float(north), float(east), (float(half[0]), float(half[1])), one.yaw)


def landmarks(map_name: str, map_seed: int, kind: str, viewer: Vec3, yaw_deg: float | None) -> dict[str, Footprint]:
    """Return phrase → place of everything that an instruction may use to tell one thing of a kind from the others.

    Always the map's own landmarks; for a drone that sees its target at the start (`yaw_deg` given), also what the first
    picture shows one of, as 'the kiosk'. Empty for a map that has no landmarks of its own.
    """
    named = {mark.phrase: mark.name for mark in places(map_name, map_seed).landmarks}
    if not named:
        return {}
    by_name = {i.name: i for i in maps.build(map_name, map_seed).instances}
    found = {phrase: footprint(by_name[name]) for phrase, name in named.items() if by_name[name].kind != kind}
    if yaw_deg is None:
        return found
    shown = _scenery(map_name, map_seed).seen(viewer, yaw_deg)
    of_kind: dict[str, list[str]] = defaultdict(list)
    for name in shown:
        of_kind[by_name[name].kind].append(name)
    for other, names in sorted(of_kind.items()):
        one = by_name[names[0]]
        spoken_of = other not in (kind, *UNNAMED, *SLIGHT) and one.name not in named.values()
        if spoken_of and len(names) == 1 and shown[names[0]] >= SEEN_SHARE:
            found[f"the {nouns(other)[0]}"] = footprint(one)
    return found


@lru_cache(maxsize=8)
def places(map_name: str, map_seed: int) -> Places:
    """Return what a map offers; nothing where it is a user's own."""
    return maps.places(map_name, map_seed) if map_name in maps.shipped() else Places((), ())


@lru_cache(maxsize=4)
def _scenery(map_name: str, map_seed: int) -> "Scenery":
    return Scenery(maps.build(map_name, map_seed).instances)


class Scenery:
    """A map's solid things, for counting the pixels that show each."""

    def __init__(self, instances: tuple[Instance, ...]) -> None:
        things = [i for i in instances if i.solid]
        placed = [(i.mesh.vertices @ turn(i.turned).T + np.array(i.position_ned))[i.mesh.triangles] for i in things]
        self._names = [i.name for i in things]
        self._owner = np.repeat(np.arange(len(things)), [len(t) for t in placed])
        corners = np.ascontiguousarray(np.concatenate(placed).reshape(-1, 3), dtype=np.float32)
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))

    def seen(self, origin: Vec3, yaw_deg: float) -> dict[str, float]:
        """Return name → share of the picture (0 … 1) of everything that a level drone's camera sees."""
        attitude = quat_from_euler(0.0, 0.0, math.radians(yaw_deg))
        axes = np.array([rotate(attitude, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])
        eye = np.array(origin) + np.array(rotate(attitude, CAMERA.offset_frd))
        x = (np.arange(CAMERA.width) + 0.5 - CAMERA.width / 2) / CAMERA.focal_px
        y = (np.arange(CAMERA.height) + 0.5 - CAMERA.height / 2) / CAMERA.focal_px
        way = (axes[0] + x[None, :, None] * axes[1] + y[:, None, None] * axes[2]).reshape(-1, 3).astype(np.float32)
        start = np.ascontiguousarray(np.broadcast_to(eye.astype(np.float32), way.shape))
        hit = self._scene.run(start, np.ascontiguousarray(way), output=1)["primID"]
        count = Counter(self._owner[hit[hit >= 0]].tolist())
        return {self._names[k]: n / len(way) for k, n in sorted(count.items())}
