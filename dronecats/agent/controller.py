"""The fixed geometric controller: one action in, at most a turn and a move out. Paper, appendix "Execution".

Geometry solved once per step, without feedback; what tracks the result is the autopilot's business.
"""

import math
from dataclasses import dataclass

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from dronecats.border.camera import CameraModel
from dronecats.border.setpoints import Hold, Setpoint, Turn, Velocity

STEP_S = 2.5  # s, a move is held this long
STRIDE_MAX_M = 3.0  # m, so never faster than 1.2 m/s
BEARING_DEADBAND_DEG = 8.0
CLIMB_DEADBAND = 0.15  # vertical displacement below this share of the horizontal distance is dropped
NEAR_M, NEAR_SCALE = 5.0, 0.6
BRAKE_M = 2.0
YAW_RATE = math.radians(60.0)  # rad/s


@dataclass(frozen=True, slots=True)
class Segment:
    """One setpoint and how long it is flown."""

    setpoint: Setpoint
    duration_s: float


def displacement(go: Go, camera: CameraModel) -> tuple[float, float, float]:
    """Return (right, forward, up) in metres of the point, back-projected with the pilot's depth."""
    f = camera.focal_px
    px, py = go.x * camera.width / 1000.0, go.y * camera.height / 1000.0
    return (px - camera.width / 2.0) / f * go.depth_m, go.depth_m, (camera.height / 2.0 - py) / f * go.depth_m


def plan(action: Action | None, camera: CameraModel) -> tuple[Segment, ...]:
    """Return the segments that fly `action`, in order; None (an unreadable reply) holds for one step."""
    match action:
        case Go():
            return _go(action, camera)
        case Rotate(angle_deg):
            return (_turn(math.radians(angle_deg)),) if angle_deg else (Segment(Hold(), STEP_S),)
        case Think() | Finished() | None:
            return (Segment(Hold(), STEP_S),)


def _go(go: Go, camera: CameraModel) -> tuple[Segment, ...]:
    right, forward, up = displacement(go, camera)
    bearing = math.atan2(right, forward)
    turn = (_turn(bearing),) if abs(bearing) > math.radians(BEARING_DEADBAND_DEG) else ()
    return (*turn, _move(math.hypot(right, forward), up, go.depth_m))


def _turn(angle: float) -> Segment:
    return Segment(Turn(math.copysign(YAW_RATE, angle)), abs(angle) / YAW_RATE)


def _move(ahead: float, up: float, depth_m: float) -> Segment:
    """The lateral part is gone: the turn has put the point ahead, or it lies within the deadband."""
    if depth_m < BRAKE_M or ahead <= 0.0:
        return Segment(Hold(), STEP_S)
    if abs(up) < CLIMB_DEADBAND * ahead:
        up = 0.0
    scale = min(1.0, STRIDE_MAX_M / math.hypot(ahead, up))
    if depth_m < NEAR_M:
        scale *= NEAR_SCALE
    climb = up * scale / STEP_S if up else None
    return Segment(Velocity(forward=ahead * scale / STEP_S, up=climb), STEP_S)
