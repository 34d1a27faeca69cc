"""Neighbourhoods that no record has, with one target each time, and pictures of them with the truth.

Houses, planting and most parked cars are dealt out by seeds that no record uses; streets and plots are the map's. The
target stands at another place, in another paint and looked at from another side in every picture.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets, residential
from episodes.maps.scene import Instance, Moved, Scene
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3, quat_from_euler, rotate

CAMERA = CameraModel(640, 360)
NOUNS = {
    "suv": "SUV", "sedan": "sedan", "hatchback": "hatchback", "pickup": "pickup truck", "van": "van", "bus": "bus",
    "motorcycle": "motorcycle", "cyclist": "cyclist", "quadrotor": "quadrotor",
}  # fmt: skip
"""What a residential record may have for its target, and what its instruction calls it."""
PAINTS = ("cyan", "red", "yellow", "orange", "blue", "green", "purple", "pink", "brown")
PLACES = {
    "bus": ("bus stop",),
    "cyclist": ("pavement", "lawn"),
    "quadrotor": ("lawn",),
    "motorcycle": ("kerb", "drive"),
}
USUAL_PLACES = ("kerb", "drive")
HEIGHTS_M = (1.1, 2.9)  # of the camera over the ground under it
DISTANCES_M = (3.0, 32.0)  # body to the target's centre, where it is to be in the picture
ASIDE_RAD = math.radians(40.0)  # off the nose
ABSENT = 0.25  # share of the pictures that are taken at the target's back
TILT_RAD = 0.02  # standard deviation of pitch and roll: a body that has just braked
ROOM_M = 0.9  # nearer than this nothing may be before the camera
LEAST_PX = 40  # of the target, from which it counts as shown
SHADOW_CELLS = 2048


@dataclass(frozen=True, slots=True)
class Target:
    """What an instruction asks for in one picture."""

    asset: str
    paint: str
    distance_m: float  # body origin to the middle of its box
    box: tuple[int, int, int, int] | None  # px, left, top, right, bottom of its pixels; None where it is not shown

    @property
    def instruction(self) -> str:
        """What a record would say."""
        return f"go to the {self.paint} {NOUNS[self.asset]}"


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """One picture and the truth."""

    rgb: NDArray[np.uint8]  # (360, 640, 3)
    target: Target


def build(seed: int) -> Scene:
    """Return a neighbourhood with one vehicle of each kind in each of two paints, all movable."""
    built = maps.build("residential", seed)
    rng = np.random.default_rng((seed, 11))
    first = max(i.id for i in built.instances) + 1
    added: list[Instance] = []
    for asset in NOUNS:
        for paint in rng.permutation(PAINTS)[:3].tolist():
            mesh = assets.build(asset, paint)
            name = f"{asset} {paint}"
            added.append(Instance(first + len(added), name, "target", mesh, (0.0, 0.0, 0.0), movable=True))
    return replace(built, instances=(*built.instances, *added), base=built)


def pictures(scene: Scene, renderer: Renderer, seed: int, count: int) -> Iterator[Photograph]:
    """Yield pictures of targets from random places, some of which show none."""
    rng = np.random.default_rng((seed, 12))
    spots = residential.places(seed).spots
    targets = [i for i in scene.instances if i.kind == "target"]
    nowhere: Moved = {i.id: None for i in targets}
    done = 0
    while done < count:
        one = targets[int(rng.integers(len(targets)))]
        asset, paint = one.name.split(" ")
        fitting = [s for s in spots if s.place in PLACES.get(asset, USUAL_PLACES)]
        spot = fitting[int(rng.integers(len(fitting)))]
        yaw = spot.yaw + float(rng.choice((0.0, math.pi))) + float(rng.normal(0.0, 0.4))
        low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
        middle = _middle(spot.position_ned, yaw, 0.5 * (low + high))
        distance = math.exp(float(rng.uniform(*np.log(DISTANCES_M))))
        way = float(rng.uniform(-math.pi, math.pi))
        north, east = middle[0] - distance * math.cos(way), middle[1] - distance * math.sin(way)
        body = (north, east, scene.terrain.at(north, east) - float(rng.uniform(*HEIGHTS_M)))
        aside = float(rng.uniform(-ASIDE_RAD, ASIDE_RAD))
        if rng.random() < ABSENT:
            aside += math.pi
        tilt = rng.normal(0.0, TILT_RAD, 2)
        attitude = quat_from_euler(float(tilt[0]), float(tilt[1]), way + aside)
        lever = rotate(attitude, CAMERA.offset_frd)
        eye = (body[0] + lever[0], body[1] + lever[1], body[2] + lever[2])
        view = renderer.render(CameraPose(eye, attitude), {**nowhere, one.id: (spot.position_ned, yaw)})
        if float(view.depth.min()) < ROOM_M or float(np.median(view.depth)) < 2.5:
            continue
        done += 1
        rows, columns = np.nonzero(view.ids == one.id)
        box = None
        if len(rows) >= LEAST_PX:
            box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        yield Photograph(view.rgb, Target(asset, paint, math.dist(body, middle), box))


def _middle(place: Vec3, yaw: float, local: NDArray[np.floating]) -> Vec3:
    x, y, z = (float(v) for v in local)
    c, s = math.cos(yaw), math.sin(yaw)
    return (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] + z)
