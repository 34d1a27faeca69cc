"""A pilot that knows the truth: the ceiling of the benchmark, and the proof that an episode can be flown at all.

It speaks the same four actions as a model and nothing more, so what it cannot do, no model can. A pure function:
whoever has the truth calls it (the run, never the agent).
"""

import math
from collections.abc import Sequence

from dronecats.pilots import reply as text
from dronecats.pilots.oracle.sight import TrueSight
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, quat_from_euler, rotate, rotate_inverse, wrap_pi
from foundation.protocol import NEAR_M, NEAR_SCALE, POINT_SPAN, STEP_S, STRIDE_MAX_M, STRIDE_MIN_M

ARRIVED_M = 4.0  # 3-D distance, body origin to target centre, at which it declares; the verifier's radius is 5 m
_CLOSE_ENOUGH_M = 4.5  # … and at which it does so when the shortest stride would bring it too close
_LEVEL = 0.14  # |vertical| / horizontal below this is not flown: the controller drops it under 0.15
_KEEPS_HEIGHT_M = 7.0  # nearer than this the height is kept …
_KEEPS_HEIGHT_BAND_M = 1.2  # … unless the target would then leave the picture below or above before it is reached
_TURN_MAX_DEG = 90.0
_TOO_NEAR_M = 0.3  # nearer than this to the lens a point has no useful place in the picture


def nearest_flies(sights: Sequence[TrueSight]) -> str:
    """Return the oracle's reply for some drones. The nearest flies, the others hover: one arrival is enough."""
    nearest = min(sights, key=lambda sight: sight.distance_m)
    return text.fleet([of_one(sight) if sight is nearest else text.think() for sight in sights])


def of_one(sight: TrueSight) -> str:
    """Return `reply` for one drone, of what is true of it."""
    return reply(
        sight.position_ned, sight.yaw_rad, sight.attitude, sight.camera, sight.target_ned, sight.target_velocity_ned
    )


def reply(
    position_ned: Vec3,
    yaw_rad: float,
    attitude: Quat | None,
    camera: CameraModel,
    target_ned: Vec3,
    target_velocity_ned: Vec3 | None = None,
) -> str:
    """Return the next action as a model's reply text: one JSON object.

    position_ned, target_ned: m, body origin and target centre in the same NED frame; target_velocity_ned: m/s, None
    for a target at rest. attitude: of the body, None for level flight at yaw_rad.

    Rotates until the target is in the picture; then goes, the point being the target's true projection and the depth
    its true planar depth, both one step ahead of a moving target; the last strides are made shorter by smaller depths,
    so that it stops before the target. Far off it lets the controller climb or descend along the ray; near, it keeps
    its height. A target that is ahead but under or over the picture is approached along the picture's edge.
    """
    q = attitude if attitude is not None else quat_from_euler(0.0, 0.0, yaw_rad)
    aim = target_ned if target_velocity_ned is None else _after_step(target_ned, target_velocity_ned)
    x, y = pixel(in_camera(position_ned, q, camera, target_ned), camera)
    if not 0.0 <= x <= camera.width:
        return text.rotate(_bearing_deg(position_ned, yaw_rad, target_ned))
    in_picture = 0.0 <= y <= camera.height
    distance = math.dist(position_ned, target_ned)
    if in_picture and distance <= ARRIVED_M:
        return text.finished()

    ahead = in_camera(position_ned, q, camera, aim)
    x, y = pixel(ahead, camera)
    if not 0.0 <= x <= camera.width:
        return text.rotate(_bearing_deg(position_ned, yaw_rad, aim))
    horizontal = math.hypot(aim[0] - position_ned[0], aim[1] - position_ned[1])
    vertical = aim[2] - position_ned[2]
    if not in_picture and horizontal < STRIDE_MAX_M:  # over or under it: fly on, turn round there
        return text.go(500.0, 500.0, NEAR_M)
    # stop where the sphere of ARRIVED_M has safely been entered, at the height that is kept
    reach = math.sqrt((ARRIVED_M - 0.3) ** 2 - min(abs(vertical), ARRIVED_M - 1.0) ** 2)
    travel = horizontal - reach
    if in_picture and distance <= _CLOSE_ENOUGH_M and travel < STRIDE_MIN_M:
        return text.finished()
    depth = depth_for(travel, ahead[0])
    if horizontal < _KEEPS_HEIGHT_M and abs(vertical) < _KEEPS_HEIGHT_BAND_M:
        f, middle = camera.focal_px, camera.height / 2.0
        span = _LEVEL * math.hypot(f, x - camera.width / 2.0)
        y = min(max(y, middle - span), middle + span)
    return text.go(POINT_SPAN * x / camera.width, POINT_SPAN * y / camera.height, depth)


def _after_step(point_ned: Vec3, velocity_ned: Vec3) -> Vec3:
    """Return where a moving point will be when the step that is chosen now has been flown."""
    return (
        point_ned[0] + velocity_ned[0] * STEP_S,
        point_ned[1] + velocity_ned[1] * STEP_S,
        point_ned[2] + velocity_ned[2] * STEP_S,
    )


def depth_for(travel_m: float, depth_m: float) -> float:
    """Return a depth whose stride leaves a distance that further strides can cover: the true depth when it is full.

    Strides are 3 m, or between 1.2 m and 1.8 m, so what is left is halved where a full one would leave too little.
    """
    if travel_m >= STRIDE_MAX_M + STRIDE_MIN_M:
        return max(depth_m, NEAR_M)
    longest = NEAR_SCALE * STRIDE_MAX_M
    stride = travel_m if travel_m <= longest else 0.5 * travel_m
    return min(max(stride, STRIDE_MIN_M), longest) / NEAR_SCALE


def in_camera(position_ned: Vec3, q: Quat, camera: CameraModel, point_ned: Vec3) -> Vec3:
    """Return a point in camera axes (forward, right, down), m from the optical centre."""
    offset = rotate(q, camera.offset_frd)
    return rotate_inverse(
        q,
        (
            point_ned[0] - position_ned[0] - offset[0],
            point_ned[1] - position_ned[1] - offset[1],
            point_ned[2] - position_ned[2] - offset[2],
        ),
    )


def pixel(point: Vec3, camera: CameraModel) -> tuple[float, float]:
    """Return where a point in camera axes is in the picture plane (px); far to the side when it is behind."""
    if point[0] < _TOO_NEAR_M:
        return (math.copysign(math.inf, point[1]), math.inf)
    return (
        camera.width / 2.0 + camera.focal_px * point[1] / point[0],
        camera.height / 2.0 + camera.focal_px * point[2] / point[0],
    )


def _bearing_deg(position_ned: Vec3, yaw_rad: float, point_ned: Vec3) -> float:
    """Return the turn (deg, + right, at most 90 either way) that brings a point ahead."""
    bearing = wrap_pi(math.atan2(point_ned[1] - position_ned[1], point_ned[0] - position_ned[0]) - yaw_rad)
    return min(max(math.degrees(bearing), -_TURN_MAX_DEG), _TURN_MAX_DEG)
