"""Campuses that do not exist: halls and the catalogue's things at random places, and pictures of them with the truth.

Nothing stands at its place on the shipped campus: halls, trees and fixtures have other places, plants have another seed
than any record, and the sun is elsewhere.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.training import CAMERA
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets, campus, campus_ground, campus_plan
from episodes.maps.assets import buildings, campus_monuments, fixtures, people, street
from episodes.maps.scene import Instance, Mesh, Scene, sun_at
from foundation.camera import CameraPose
from foundation.frames import Vec3, quat_from_euler

EXTENT = ((-80.0, 46.0), (-50.0, 52.0))  # m, north and east: the area of the things
COPIES = {"bench": 12, "bin": 8, "lamp": 12, "person": 26, "tree": 18, "bollard": 8, "conifer": 8, "shrub": 20}
OTHERS = 11  # copies of every other kind
APART_M = 2.6  # between the middles of two things
HEIGHTS_M = (1.0, 2.4)  # of the camera over the ground
FARTHEST_M = 50.0
TILT_RAD = 0.025  # standard deviation of pitch and roll: a drone that has just braked


@dataclass(frozen=True, slots=True)
class VisibleThing:
    """A thing in a picture."""

    kind: str
    depth_m: float  # along the optical axis, to the thing's middle
    right_m: float  # right of the optical axis
    below_m: float  # the thing's foot below the camera
    box: tuple[int, int, int, int]  # px, left, top, right, bottom of its pixels
    pixels: int
    box_pixels: float  # px of the box around the thing, unobstructed


def makers(rng: np.random.Generator) -> dict[str, Mesh]:
    """Return a mesh per kind, with the catalogue's looks."""
    made = {kind: maker() for kind, maker in fixtures.MAKERS.items()}
    made["tiered-fountain"] = campus_monuments.fountain(3)
    made["person"] = people.person("grey")
    made["delivery-robot"] = fixtures.delivery_robot("white")
    made["service-cart"] = fixtures.service_cart("white")
    species = str(rng.choice(("oak", "maple", "birch")))
    made["tree"] = street.tree(species, float(rng.uniform(6.0, 8.0)), int(rng.integers(3, 9)))
    made["conifer"] = street.conifer(float(rng.uniform(7.0, 11.0)), int(rng.integers(3, 9)))
    made["shrub"] = street.bush(float(rng.uniform(0.4, 0.6)), int(rng.integers(3, 9)))
    return made


def build(seed: int) -> Scene:
    """Return a campus with random places."""
    rng = np.random.default_rng((seed, 4711))
    terrain = campus_ground.terrain()
    instances: list[Instance] = []

    def add(kind: str, mesh: Mesh, north: float, east: float, yaw: float, down: float | None = None) -> None:
        place = (north, east, terrain.at(north, east) if down is None else down)
        instances.append(Instance(len(instances) + 1, f"{kind}-{len(instances)}", kind, mesh, place, yaw))

    for use, mesh in campus_ground.ground():
        instances.append(Instance(len(instances) + 1, use, "ground", mesh, (0.0, 0.0, 0.0)))
    plans = [plan for plan, *_ in campus_plan.HALLS]
    feet: list[tuple[float, float, float, float]] = []  # north, east, half depth, half width of the halls
    for k, (_, north, east, facing) in zip(rng.permutation(len(plans)), campus_plan.HALLS, strict=True):
        plan, yaw = plans[int(k)], math.radians(facing)
        out = plan.depth / 2 + 2.0
        add(
            "hall",
            buildings.hall(plan),
            north,
            east,
            yaw,
            terrain.at(north + math.cos(yaw) * out, east + math.sin(yaw) * out),
        )
        forward, back, side = buildings.reach(plan)
        deep, wide = max(forward, back) + 0.6, side + 0.6
        feet.append((north, east, *((deep, wide) if facing in (0.0, 180.0) else (wide, deep))))
    made = makers(rng)
    taken: list[tuple[float, float]] = []
    for kind in sorted(made):
        for _ in range(COPIES.get(kind, OTHERS if kind != "clock-tower" else 2)):
            for _ in range(20):
                n, e = (float(rng.uniform(*span)) for span in EXTENT)
                apart = all(math.hypot(n - a, e - b) > APART_M for a, b in taken)
                if apart and not any(abs(n - a) < h and abs(e - b) < w for a, b, h, w in feet):
                    taken.append((n, e))
                    add(kind, _dressed(kind, made[kind], rng), n, e, float(rng.uniform(-math.pi, math.pi)))
                    break
    for side in (-1, 1):
        for along in (-90.0, -30.0, 30.0, 90.0):
            add("wood", street.wood(64.0, 10.0, 3), side * 104.0, along, math.pi / 2)
            add("wood", street.wood(64.0, 10.0, 4), along, side * 104.0, 0.0)
    sun = sun_at(campus.ORIGIN[0], int(rng.integers(110, 170)), float(rng.uniform(9.4, 11.4)))
    return replace(campus.build(1), name=f"campus-of-{seed}", instances=tuple(instances), sun=sun)


def _dressed(kind: str, mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a person with a random garment and gait; another kind unchanged."""
    if kind != "person":
        return mesh
    paint = str(rng.choice(assets.PAINTS)) if rng.random() < 0.6 else "grey"
    return people.pedestrian(paint) if rng.random() < 0.5 else people.person(paint)


def photograph(
    scene: Scene, renderer: Renderer, seed: int, count: int
) -> Iterator[tuple[NDArray[np.uint8], tuple[VisibleThing, ...]]]:
    """Yield pictures (360, 640, 3) RGB from random places of a campus, at the benchmark's heights, and their things."""
    rng = np.random.default_rng((seed, 815))
    things = [i for i in scene.instances if i.kind not in ("ground", "wood", "hall")]
    halls = [i for i in scene.instances if i.kind == "hall"]
    done = 0
    while done < count:
        n, e = (float(rng.uniform(*span)) for span in EXTENT)
        yaw = float(rng.uniform(-math.pi, math.pi))
        near = min(math.hypot(i.position_ned[0] - n, i.position_ned[1] - e) for i in things)
        if near < 2.0 or any(math.dist((n, e), h.position_ned[:2]) < 16.0 for h in halls):
            continue
        height = float(rng.uniform(*HEIGHTS_M))
        eye = (n, e, scene.terrain.at(n, e) - height)
        tilt = [float(v) for v in rng.normal(0.0, TILT_RAD, 2)] if rng.random() < 0.5 else [0.0, 0.0]
        view = renderer.render(CameraPose(eye, quat_from_euler(tilt[0], tilt[1], yaw)))
        done += 1
        yield view.rgb, tuple(_visible(view.ids, things, eye, yaw))


def _visible(ids: NDArray[np.int32], things: list[Instance], eye: Vec3, yaw: float) -> Iterator[VisibleThing]:
    counts = np.bincount(ids.ravel(), minlength=max(i.id for i in things) + 1)
    c, s = math.cos(yaw), math.sin(yaw)
    for thing in things:
        if counts[thing.id] < 12:
            continue
        north, east = thing.position_ned[0] - eye[0], thing.position_ned[1] - eye[1]
        depth, right = c * north + s * east, -s * north + c * east
        if depth > FARTHEST_M or depth < 1.0:
            continue
        rows, columns = np.nonzero(ids == thing.id)
        low, high = thing.mesh.vertices.min(axis=0), thing.mesh.vertices.max(axis=0)
        wide = 0.5 * (high[0] - low[0] + high[1] - low[1])
        box_pixels = float(wide * -low[2]) * (CAMERA.focal_px / depth) ** 2
        box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        below = thing.position_ned[2] - eye[2]
        yield VisibleThing(thing.kind, depth, right, below, box, int(counts[thing.id]), box_pixels)
