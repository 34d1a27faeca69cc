"""Plans and steers legs. A leg is the flight to a goal that may move. All functions are pure.

The drone does not stop to wait for the next decision. Without a new decision, the leg ends after a limited time.
"""

import math
from dataclasses import dataclass

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement
from foundation.camera import CameraModel, camera_pose
from foundation.frames import Vec3, quat_from_euler, rotate
from foundation.protocol import BRAKE_M, CLIMB_DEADBAND, NEAR_M, NEAR_SCALE, SPEED_MAX, STEP_S, STRIDE_MAX_M
from foundation.setpoints import PicturePose, Velocity


@dataclass(frozen=True, slots=True)
class SeenPlace:
    """The place that a go points at, and how much of the way to it the drone may fly before the next picture."""

    from_ned: Vec3  # m, local frame, position of the vehicle at capture
    lens_ned: Vec3  # m, local frame, position of the optical centre at capture
    place_ned: Vec3  # m, local frame, the place itself
    reach: float  # share of the way from the lens to the place; 0: hold
    level: bool  # the climb is below the paper's deadband, so the height is held
    depth_m: float  # m along the optical axis, the pilot's estimate


def seen_place(go: Go, sight: PicturePose, camera: CameraModel) -> SeenPlace:
    """Return the place that a go points at in a picture taken from the pose `sight`."""
    right, forward, up = displacement(go, camera.at_pitch(sight.gimbal_pitch))
    body = quat_from_euler(sight.roll, sight.pitch, sight.heading)
    # `displacement` is in the axes of the vehicle, or in level axes if the camera has a gimbal
    axes = quat_from_euler(0.0, 0.0, sight.heading) if camera.gimballed else body
    north, east, down = rotate(axes, (forward, right, -up))
    lens = camera_pose(sight.position_ned, body, camera).position_ned
    ahead = math.hypot(north, east)
    # The drone keeps its height if the climb is small in the axes of `displacement`, or in NED. The first test serves a
    # pilot that wants no climb and points at the middle row. Without camera pitch, the climb is 0 in these axes even if
    # the vehicle is tilted.
    level = abs(up) < CLIMB_DEADBAND * math.hypot(right, forward) or abs(down) < CLIMB_DEADBAND * ahead
    place = (lens[0] + north, lens[1] + east, lens[2] + down)
    return SeenPlace(
        sight.position_ned, lens, place, _reach(math.hypot(right, forward, up), go.depth_m), level, go.depth_m
    )


def _reach(distance_m: float, depth_m: float) -> float:
    """Return the share of the way that a go may be flown before the next picture.

    It is 0 below a depth of 2 m. From 2 to 5 m it gives the move of the paper's controller. From 5 m on it is 0.6. For
    a place straight ahead at 5 m, this gives 3 m, as in the paper; at 10 m it gives 6 m. The next reply may end the
    move earlier.
    """
    if depth_m < BRAKE_M:
        return 0.0
    if depth_m < NEAR_M:
        return NEAR_SCALE * min(1.0, STRIDE_MAX_M / distance_m)
    return NEAR_SCALE


REACHED_M = 0.3  # m, horizontal distance at which the goal is reached
FOLLOW_AGAIN_M = 1.0  # m, horizontal distance beyond which the drone leaves its hold and follows the goal again
SLOW_DOWN_S = 0.8  # s; the speed is at most the distance to the goal divided by this
KEEP_COURSE_M = 1.5  # m; nearer to the goal, the drone keeps its course and does not turn
CAREFUL_S = 1.5  # s, shortest duration of a short stride (a go with a depth below NEAR_M)


@dataclass(frozen=True, slots=True)
class Leg:
    """The flight of one go to a goal that may move. The pace is full until `due_s` and falls to zero at `ends_s`."""

    goal_ned: Vec3  # m, local frame, at `begins_s`
    velocity_ned: Vec3  # m/s of the goal
    level: bool  # the height is held
    begins_s: float  # s of the episode
    due_s: float  # s, when the next decision is expected
    ends_s: float  # s, when the leg ends without a new decision
    pace: float  # m/s, full speed

    def goal(self, now_s: float) -> Vec3:
        """Return the goal's position at a time (m, local frame)."""
        north, east, down = self.goal_ned
        seconds = now_s - self.begins_s
        return (north + self.velocity_ned[0] * seconds, east + self.velocity_ned[1] * seconds, down)

    def fade(self, now_s: float) -> float:
        """Return the factor on the full pace at a time, from 1 down to 0."""
        if now_s <= self.due_s:
            return 1.0
        return max(0.0, (self.ends_s - now_s) / (self.ends_s - self.due_s))


@dataclass(frozen=True, slots=True)
class Steered:
    """The setpoint of a leg at one tick."""

    setpoint: Velocity
    seen: PicturePose  # the setpoint's line: it starts at this position and has the direction `heading`
    valid_s: float  # s for which the setpoint is valid


def leg_to(
    goal_ned: Vec3,
    velocity_ned: Vec3,
    position_ned: Vec3,
    now_s: float,
    period_s: float,
    *,
    level: bool,
    careful: bool = False,
) -> Leg:
    """Return the leg to a goal from a position, if a decision comes about every `period_s`.

    The pace is at most the paper's 1.2 m/s, and so slow that the way takes at least one step (2.5 s), in a short stride
    (`careful`) at least CAREFUL_S. Without a next decision the leg continues for one more period.
    """
    lasts_s = STEP_S if careful else max(STEP_S, period_s)
    pace = min(SPEED_MAX, math.dist(goal_ned, position_ned) / (CAREFUL_S if careful else STEP_S))
    return Leg(goal_ned, velocity_ned, level, now_s, now_s + lasts_s, now_s + 2.0 * lasts_s, pace)


def steer(
    leg_to: Leg, position_ned: Vec3, now_s: float, course: float | None = None, *, resting: bool = False
) -> Steered | None:
    """Return the setpoint of a leg at a position; None for a hold: the goal is reached or passed, or the leg has ended.

    course: last course (rad), kept when close to the goal; None: no course yet. resting: the drone has reached the
    goal, and follows the goal again only beyond FOLLOW_AGAIN_M.
    """
    goal = leg_to.goal(now_s)
    north, east, down = (g - p for g, p in zip(goal, position_ned, strict=True))
    ahead = math.hypot(north, east)
    if now_s >= leg_to.ends_s or ahead <= (FOLLOW_AGAIN_M if resting else REACHED_M):
        return None
    bearing = math.atan2(east, north)
    if course is not None and not resting and ahead < KEEP_COURSE_M:
        if math.cos(bearing - course) <= 0.0:  # the goal has been passed
            return None
        bearing = course
    speed = min(leg_to.pace, ahead / SLOW_DOWN_S) * leg_to.fade(now_s)
    up = 0.0 if leg_to.level else -down
    length_m = math.hypot(ahead, up)
    climb = speed * up / length_m if up else None
    return Steered(
        Velocity(speed * ahead / length_m, climb, 0.0), PicturePose(position_ned, bearing), leg_to.ends_s - now_s
    )
