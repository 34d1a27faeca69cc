"""The oracle: a pilot that knows the truth.

Its results are the upper bound of the benchmark and prove that an episode can be flown. The oracle has the same four
actions as a model, so a model can fly the same way. The oracle is a pure function of the truth. The agent's code does
not import the oracle; `dronecats/flight/run/truth.py` passes the oracle to the agent as a model.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from dronecats.pilots import actions
from foundation.camera import CameraModel, camera_pose
from foundation.frames import Quat, Vec3, course, rotate_inverse, wrap_pi
from foundation.protocol import NEAR_M, NEAR_SCALE, POINT_SPAN, STEP_S, STRIDE_MAX_M, STRIDE_MIN_M

ARRIVED_M = 4.0  # 3-D distance at which the oracle declares; the radius of success is 5 m
_CLOSE_ENOUGH_M = 4.5  # 3-D distance at which the oracle declares if even the shortest stride is too long
_LEVEL = 0.14  # largest slope of a level `go`: the controller ignores slopes under 0.15
# Within this horizontal distance the drone keeps its height, if the height difference to the target is less than
# _KEEPS_HEIGHT_BAND_M. With a larger difference, a level flight might move the target out of the picture.
_KEEPS_HEIGHT_M = 7.0
_KEEPS_HEIGHT_BAND_M = 1.2
_TURN_MAX_DEG = 90.0
_TOO_NEAR_M = 0.3  # a point with a smaller depth has no useful pixel


@dataclass(frozen=True, slots=True)
class TrueState:
    position_ned: Vec3  # m, body origin
    yaw_rad: float  # from north, + east
    attitude: Quat  # of the body
    target_ned: Vec3  # m, centre of the target
    target_velocity_ned: Vec3  # m/s
    camera: CameraModel
    drone: int = 0  # index of the drone
    step: int = 0  # step of the drone, from 0
    visible: bool = True  # whether the picture shows the target; True if not measured

    @property
    def distance_m(self) -> float:
        """The 3-D distance (m) from the body's origin to the target's centre, as in the verdict."""
        return math.dist(self.position_ned, self.target_ned)

    @property
    def bearing_deg(self) -> float:
        """The direction of the target, degrees from the nose, + right."""
        return math.degrees(wrap_pi(course(self.position_ned, self.target_ned) - self.yaw_rad))


TruthPilot = Callable[[Sequence[TrueState]], str]  # (true state of each drone of the request) → reply


def reply_nearest(states: Sequence[TrueState]) -> str:
    """Return the oracle's reply. Only the nearest drone flies, because one arrival is enough; the others hover."""
    nearest = min(states, key=lambda state: state.distance_m)
    return actions.join([next_action(state) if state is nearest else actions.think() for state in states])


def next_action(state: TrueState) -> str:
    """Return the next action of one drone as reply text.

    The drone rotates until the target is in the picture. Then it flies to the target: the point is the target's true
    projection, and the depth its true depth along the optical axis, both predicted for the end of the step. Smaller
    depths make the last strides shorter, so that the drone stops before the target. Far away, the controller climbs or
    descends along the ray; near the target, the drone keeps its height. For a target above or below the picture, the
    point is on the picture's edge.
    """
    camera, distance = state.camera, state.distance_m
    x, y = pixel(in_camera(state, state.target_ned), camera)
    if not 0.0 <= x <= camera.width:
        return actions.rotate(_turn_deg(state))
    in_picture = 0.0 <= y <= camera.height
    if in_picture and distance <= ARRIVED_M:
        return actions.finished()

    n, e, d = (p + v * STEP_S for p, v in zip(state.target_ned, state.target_velocity_ned, strict=True))
    aim = (n, e, d)  # the target's place at the end of the next step
    ahead = in_camera(state, aim)
    x, y = pixel(ahead, camera)
    if not 0.0 <= x <= camera.width:
        return actions.rotate(_turn_deg(replace(state, target_ned=aim)))
    north, east, vertical = (a - p for a, p in zip(aim, state.position_ned, strict=True))
    horizontal = math.hypot(north, east)
    if not in_picture and horizontal < STRIDE_MAX_M:  # the target is above or below the drone: fly on, then turn round
        return actions.go(500.0, 500.0, NEAR_M)
    # reach: a horizontal distance that is safely within ARRIVED_M at the present height
    reach = math.sqrt((ARRIVED_M - 0.3) ** 2 - min(abs(vertical), ARRIVED_M - 1.0) ** 2)
    travel = horizontal - reach
    if in_picture and distance <= _CLOSE_ENOUGH_M and travel < STRIDE_MIN_M:
        return actions.finished()
    depth = depth_for(travel, ahead[0])
    if horizontal < _KEEPS_HEIGHT_M and abs(vertical) < _KEEPS_HEIGHT_BAND_M:
        f, middle = camera.focal_px, camera.height / 2.0
        span = _LEVEL * math.hypot(f, x - camera.width / 2.0)
        y = min(max(y, middle - span), middle + span)
    return actions.go(POINT_SPAN * x / camera.width, POINT_SPAN * y / camera.height, depth)


def depth_for(travel_m: float, depth_m: float) -> float:
    """Return the depth (m) of the next stride, with `travel_m` left to fly. `depth_m`: true depth of the target.

    The result is the true depth for a full stride, and a smaller depth for a shorter stride.
    """
    if travel_m >= STRIDE_MAX_M + STRIDE_MIN_M:
        return max(depth_m, NEAR_M)
    return actions.short_stride_m(travel_m) / NEAR_SCALE


def in_camera(state: TrueState, point_ned: Vec3) -> Vec3:
    """Return a point in the axes of the drone's camera (forward, right, down), m from the optical centre."""
    pose = camera_pose(state.position_ned, state.attitude, state.camera)
    (north, east, down), (n, e, d) = point_ned, pose.position_ned
    return rotate_inverse(pose.attitude, (north - n, east - e, down - d))


def pixel(point: Vec3, camera: CameraModel) -> tuple[float, float]:
    """Return the pixel of a point in camera axes. Behind the camera: x is ±∞, with the sign of its side, and y is ∞."""
    if point[0] < _TOO_NEAR_M:
        return (math.copysign(math.inf, point[1]), math.inf)
    return (
        camera.width / 2.0 + camera.focal_px * point[1] / point[0],
        camera.height / 2.0 + camera.focal_px * point[2] / point[0],
    )


def _turn_deg(state: TrueState) -> float:
    """Return the turn (deg, + right, at most 90 to either side) that brings the target ahead."""
    return min(max(state.bearing_deg, -_TURN_MAX_DEG), _TURN_MAX_DEG)
