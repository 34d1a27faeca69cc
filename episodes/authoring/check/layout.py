"""What of a record the rules about a suite go by: where the target stands to the nose, and what chance would find."""

import math
from dataclasses import dataclass

import numpy as np

from episodes.authoring.check.pixels import patch
from episodes.authoring.check.sight import CAMERA, bearing_deg, level
from episodes.maps.geometry import assemble, box
from episodes.maps.scene import Instance, Material
from episodes.records.record import StartPose
from episodes.world.visibility import Solids, Together
from episodes.world.world import World, solids
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M, SPEED_MAX

HEADING_STEP_DEG = 2
ALONG_STEP_M = 0.5
CLEAR_M = 0.3  # to both sides of a straight flight
NUMBERED = 1_000_000  # ids of drones, beyond those of any scene
DRONE_M = (0.35, 0.35, 0.13)  # half of a drone, rotors included: length, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """One record among others."""

    id: str
    map: str
    cell: str
    seed: int
    off_deg: float  # bearing of the target's middle off the first drone's nose, -180 … 180, + to the right
    column: float | None  # 0 … 1, left to right, of that middle in the first picture; None where it is not in it
    row: float | None  # 0 … 1, top to bottom
    distance_m: float
    height_m: float  # of the first start above the ground under it
    straight_deg: frozenset[int]  # headings from the nose on which a level straight flight comes to a true declaration
    fewest_px: int | None  # of a fleet: the least that a drone sees of a candidate past the other drones


def layout(world: World) -> Layout:
    """Return the layout of a world's record."""
    record, first = world.record, world.record.starts[0]
    goal = world.target_centre(0.0)
    off = math.remainder(bearing_deg(first.position_ned, goal) - first.yaw_deg, 360.0)
    column, row = _in_picture(first, goal) if record.visible_at_start else (None, None)
    fleet = record.cell == "commanding"
    return Layout(
        id=record.id,
        map=record.map,
        cell=record.cell,
        seed=record.seed,
        off_deg=off,
        column=column,
        row=row,
        distance_m=math.dist(first.position_ned, goal),
        height_m=world.ground_down(*first.position_ned[:2]) - first.position_ned[2],
        straight_deg=frozenset() if fleet else straight(world, off),
        fewest_px=past_each_other(world) if fleet else None,
    )


def _in_picture(start: StartPose, goal: Vec3) -> tuple[float, float]:
    """Return the column and the row (0 … 1) of a point before a level drone."""
    yaw = math.radians(start.yaw_deg)
    north, east = goal[0] - start.position_ned[0], goal[1] - start.position_ned[1]
    lever = CAMERA.offset_frd
    ahead = north * math.cos(yaw) + east * math.sin(yaw) - lever[0]
    right = east * math.cos(yaw) - north * math.sin(yaw) - lever[1]
    below = goal[2] - start.position_ned[2] - lever[2]
    focal = CAMERA.focal_px / max(ahead, 1e-3)
    return 0.5 + focal * right / CAMERA.width, 0.5 + focal * below / CAMERA.height


def straight(world: World, off_deg: float) -> frozenset[int]:
    """Return the headings from the nose (whole degrees, -180 … 179) that pass a target within the radius, in view.

    The flight is level, goes straight from the start until something stands in its way, and looks where it goes.
    """
    here = world.record.starts[0].position_ned
    span = max(math.dist(here, world.target_centre(0.0)), 1e-3)
    path = world.record.target.path
    drift = 0.0 if path is None else path.speed_mps * (span + RADIUS_M) / SPEED_MAX
    wide = math.degrees(math.asin(min(1.0, (RADIUS_M + drift) / span)))
    first = round(world.record.starts[0].yaw_deg)
    low, high = math.floor(off_deg - wide), math.ceil(off_deg + wide)
    found = (h for h in range(low, high + 1) if h % HEADING_STEP_DEG == 0 and _passes(world, first + h, span, drift))
    return frozenset((h + 180) % 360 - 180 for h in found)


def _passes(world: World, heading_deg: float, span_m: float, drift_m: float) -> bool:
    here, yaw, attitude = world.record.starts[0].position_ned, math.radians(heading_deg), level(heading_deg)
    north, east = math.cos(yaw), math.sin(yaw)
    sides = [(here[0] - side * east, here[1] + side * north, here[2]) for side in (-CLEAR_M, 0.0, CLEAR_M)]
    free = min(world.solids.range_m(one, (north, east, 0.0)) for one in sides) - CLEAR_M
    near = max(span_m - RADIUS_M - drift_m, 0.0)
    for along in np.arange(near, min(free, span_m + RADIUS_M + drift_m), ALONG_STEP_M):
        t, place = float(along) / SPEED_MAX, (here[0] + along * north, here[1] + along * east, here[2])
        if math.dist(place, world.target_centre(t)) <= RADIUS_M and world.measure(t, place, attitude, CAMERA).visible:
            return True
    return False


def past_each_other(world: World) -> int:
    """Return the fewest pixels that a drone of a fleet has of a candidate, the other drones standing in the way."""
    record, standing = world.record, solids(world.record.map, world.record.map_seed)
    things = world.target_and_lookalikes
    drones = [_drone(k, start) for k, start in enumerate(record.starts)]
    fewest = math.inf
    for one in things:
        for drone, start in zip(drones, record.starts, strict=True):
            others = [i for i in things if i is not one] + [i for i in drones if i is not drone]
            past = Together(standing, Solids(others))
            spot = patch(one, one.position_ned, one.turned, past, start.position_ned, level(start.yaw_deg), CAMERA)
            fewest = min(fewest, spot.pixels)
    return int(fewest)


def _drone(number: int, start: StartPose) -> Instance:
    """Return a drone that hovers at a start, as the box around it."""
    reach = np.array(DRONE_M)
    mesh = assemble([box(-reach, reach, Material("drone", (0.2, 0.2, 0.2)))])
    return Instance(
        NUMBERED + number, f"drone-{number + 1}", "drone", mesh, start.position_ned, math.radians(start.yaw_deg)
    )
