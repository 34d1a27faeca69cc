"""From a point of a picture and a depth to a place in the local frame, by the vehicle's pose at capture; and back."""

import math
from dataclasses import dataclass

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_from_euler, rotate, rotate_inverse
from foundation.protocol import BRAKE_M, CLIMB_DEADBAND, NEAR_M, NEAR_SCALE, POINT_SPAN, STRIDE_MAX_M
from foundation.setpoints import Sight


@dataclass(frozen=True, slots=True)
class SeenPlace:
    """What a go points at, and how far towards it it may be flown before it is looked at again."""

    from_ned: Vec3  # m, local frame, where the body was at capture
    lens_ned: Vec3  # m, local frame, where the optical centre was
    place_ned: Vec3  # m, local frame, of what is pointed at
    reach: float  # share of the way from the lens to the place; 0: not at all
    level: bool  # the climb is too small to be flown, as the paper has it
    depth_m: float  # m along the optical axis, as the pilot judges it


def seen_place(go: Go, sight: Sight, camera: CameraModel) -> SeenPlace:
    """Return the place that a go names in a picture taken at a sight, by the attitude of then."""
    right, forward, up = displacement(go, camera)
    attitude = quat_from_euler(sight.roll, sight.pitch, sight.heading)
    north, east, down = rotate(attitude, (forward, right, -up))
    lens = _lens(sight, camera)
    ahead = math.hypot(north, east)
    # level where it looks level, or is: a pilot that wants no climb keeps its point at the middle of the picture
    level = abs(up) < CLIMB_DEADBAND * math.hypot(right, forward) or abs(down) < CLIMB_DEADBAND * ahead
    place = (lens[0] + north, lens[1] + east, lens[2] + down)
    return SeenPlace(
        sight.position_ned, lens, place, _reach(math.hypot(right, forward, up), go.depth_m), level, go.depth_m
    )


def point_of(place_ned: Vec3, sight: Sight, camera: CameraModel) -> Go:
    """Return the go that names a place (m, local frame) in a picture taken at a sight: `seen_place` the other way.

    Raises ValueError for a place that is not before the lens.
    """
    lens = _lens(sight, camera)
    attitude = quat_from_euler(sight.roll, sight.pitch, sight.heading)
    offset = (place_ned[0] - lens[0], place_ned[1] - lens[1], place_ned[2] - lens[2])
    forward, right, down = rotate_inverse(attitude, offset)
    if forward <= 0.0:
        raise ValueError("the place is behind the camera")
    x = camera.width / 2.0 + camera.focal_px * right / forward
    y = camera.height / 2.0 + camera.focal_px * down / forward
    return Go(x * POINT_SPAN / camera.width, y * POINT_SPAN / camera.height, forward)


def _lens(sight: Sight, camera: CameraModel) -> Vec3:
    north, east, down = rotate(quat_from_euler(sight.roll, sight.pitch, sight.heading), camera.offset_frd)
    place = sight.position_ned
    return (place[0] + north, place[1] + east, place[2] + down)


def _reach(distance_m: float, depth_m: float) -> float:
    """Return the share of its way that a go may be flown before the next look.

    Near, it is the paper's stride. From 5 m on it is the same share of the whole way, which at 5 m is the paper's 3 m,
    and farther off more: how much of it is flown is the next reply's matter.
    """
    if depth_m < BRAKE_M:
        return 0.0
    if depth_m < NEAR_M:
        return NEAR_SCALE * min(1.0, STRIDE_MAX_M / distance_m)
    return NEAR_SCALE
