"""Neighbourhoods that no record has, and pictures of targets in them with the truth.

Houses, plants and most parked cars come from seeds that no record uses; streets and plots are the map's. In every
picture the target has another place, another paint and another direction of view.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.training import CAMERA
from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets, residential
from episodes.maps.scene import Instance, Moved, Scene
from foundation.camera import CameraPose
from foundation.frames import Vec3, quat_from_euler, rotate

NOUNS = {
    "suv": "SUV", "sedan": "sedan", "hatchback": "hatchback", "pickup": "pickup truck", "van": "van", "bus": "bus",
    "motorcycle": "motorcycle", "cyclist": "cyclist", "quadrotor": "quadrotor",
}  # fmt: skip
"""Target of a residential record → noun of its instruction."""
PAINTS = ("cyan", "red", "yellow", "orange", "blue", "green", "purple", "pink", "brown")
PLACES = {
    "bus": ("bus stop",),
    "cyclist": ("pavement", "lawn"),
    "quadrotor": ("lawn",),
    "motorcycle": ("kerb", "drive"),
}
USUAL_PLACES = ("kerb", "drive")
HEIGHTS_M = (1.1, 2.9)  # of the drone over the ground
DISTANCES_M = (3.0, 32.0)  # from the body to the target's centre
ASIDE_RAD = math.radians(40.0)  # of the target, off the nose
ABSENT = 0.25  # share of the pictures that do not show the target
TILT_RAD = 0.02  # standard deviation of pitch and roll: a drone that has just braked
ROOM_M = 0.9  # least distance of anything before the camera
LEAST_PX = 40  # least pixels of a visible target


@dataclass(frozen=True, slots=True)
class Target:
    """The target of one picture's instruction."""

    asset: str
    paint: str
    distance_m: float  # body origin to the middle of its box
    box: tuple[int, int, int, int] | None  # px, left, top, right, bottom of its pixels; None if it is not visible

    @property
    def instruction(self) -> str:
        """The instruction of a record with this target."""
        return f"go to the {self.paint} {NOUNS[self.asset]}"


def build(seed: int) -> Scene:
    """Return a neighbourhood with three movable vehicles of each kind, in different paints."""
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


def photograph(scene: Scene, renderer: Renderer, seed: int, count: int) -> Iterator[tuple[NDArray[np.uint8], Target]]:
    """Yield pictures (360, 640, 3) RGB of targets from random places; some do not show the target."""
    rng = np.random.default_rng((seed, 12))
    spots = residential.places(seed).spots
    targets = [i for i in scene.instances if i.kind == "target"]
    nowhere: Moved = {i.id: None for i in targets}
    done = 0
    while done < count:
        vehicle = targets[int(rng.integers(len(targets)))]
        asset, paint = vehicle.name.split(" ")
        fitting = [s for s in spots if s.place in PLACES.get(asset, USUAL_PLACES)]
        spot = fitting[int(rng.integers(len(fitting)))]
        yaw = spot.yaw + float(rng.choice((0.0, math.pi))) + float(rng.normal(0.0, 0.4))
        low, high = vehicle.mesh.vertices.min(axis=0), vehicle.mesh.vertices.max(axis=0)
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
        view = renderer.render(CameraPose(eye, attitude), {**nowhere, vehicle.id: (spot.position_ned, yaw)})
        if float(view.depth.min()) < ROOM_M or float(np.median(view.depth)) < 2.5:
            continue
        done += 1
        rows, columns = np.nonzero(view.ids == vehicle.id)
        box = None
        if len(rows) >= LEAST_PX:
            box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        yield view.rgb, Target(asset, paint, math.dist(body, middle), box)


def _middle(place: Vec3, yaw: float, local: NDArray[np.floating]) -> Vec3:
    x, y, z = (float(v) for v in local)
    c, s = math.cos(yaw), math.sin(yaw)
    return (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] + z)
