"""The fixed geometric controller: one action in, at most a turn and a move out. Paper, appendix "Execution".

Geometry solved once per step, without feedback; what tracks the result is the autopilot's business. Its angles are
counted from the heading that the vehicle had when the picture was taken, so a go flies to its pixel whatever the
vehicle has done meanwhile.
"""

import math
from dataclasses import dataclass

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from foundation.camera import CameraModel
from foundation.protocol import (
    BEARING_DEADBAND_DEG,
    BRAKE_M,
    CLIMB_DEADBAND,
    NEAR_M,
    NEAR_SCALE,
    POINT_SPAN,
    STEP_S,
    STRIDE_MAX_M,
    YAW_RATE_DEG,
)
from foundation.setpoints import Hold, Setpoint, Turn, Velocity

YAW_RATE = math.radians(YAW_RATE_DEG)  # rad/s
SETTLE_S = 3.0  # s that a turn may take beyond its angle at that rate: a vehicle lags, and a gust may shake it


@dataclass(frozen=True, slots=True)
class Segment:
    """One setpoint and how long it is flown."""

    setpoint: Setpoint
    duration_s: float
    settle_s: float = 0.0  # s at most for which it goes on after that, until the heading is there


def displacement(go: Go, camera: CameraModel) -> tuple[float, float, float]:
    """Return (right, forward, up) in metres of the point, back-projected with the pilot's depth."""
    f = camera.focal_px
    px, py = go.x * camera.width / POINT_SPAN, go.y * camera.height / POINT_SPAN
    return (px - camera.width / 2.0) / f * go.depth_m, go.depth_m, (camera.height / 2.0 - py) / f * go.depth_m


def plan(action: Action | None, camera: CameraModel) -> tuple[Segment, ...]:
    """Return the segments that fly `action`, in order; None (an unreadable reply) holds for one step."""
    match action:
        case Go():
            return _go(action, camera)
        case Rotate(angle_deg):
            return (turn(math.radians(angle_deg)),) if angle_deg else (Segment(Hold(), STEP_S),)
        case Think() | Finished() | None:
            return (Segment(Hold(), STEP_S),)


def _go(go: Go, camera: CameraModel) -> tuple[Segment, ...]:
    right, forward, up = displacement(go, camera)
    bearing = math.atan2(right, forward)
    move = _move(math.hypot(right, forward), up, go.depth_m, bearing)
    if abs(bearing) <= math.radians(BEARING_DEADBAND_DEG):
        return (move,)  # the nose comes round on the way
    return (turn(bearing, onto_line=isinstance(move.setpoint, Velocity)), move)


def turn(angle: float, *, onto_line: bool = False) -> Segment:
    """Return the turn by an angle (rad, + right) from the heading of the sight."""
    return Segment(Turn(math.copysign(YAW_RATE, angle), angle, onto_line), abs(angle) / YAW_RATE, SETTLE_S)


def _move(ahead: float, up: float, depth_m: float, bearing: float) -> Segment:
    if depth_m < BRAKE_M or ahead <= 0.0:
        return Segment(Hold(), STEP_S)
    if abs(up) < CLIMB_DEADBAND * ahead:
        up = 0.0
    scale = min(1.0, STRIDE_MAX_M / math.hypot(ahead, up))
    if depth_m < NEAR_M:
        scale *= NEAR_SCALE
    climb = up * scale / STEP_S if up else None
    return Segment(Velocity(ahead * scale / STEP_S, climb, bearing), STEP_S)
