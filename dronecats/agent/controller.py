"""The fixed geometric controller: one action in, at most a turn and a move out. Paper, appendix "Execution".

Geometry solved once per step, without feedback; what tracks the result is the autopilot's business. Its angles are
counted from the heading that the vehicle had when the picture was taken, so a go flies to its pixel whatever the
vehicle has done meanwhile.
"""

import math
from dataclasses import dataclass

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from foundation.camera import CameraModel
from foundation.setpoints import Hold, Setpoint, Turn, Velocity

STEP_S = 2.5  # s, a move is held this long
STRIDE_MAX_M = 3.0  # m, so never faster than 1.2 m/s
BEARING_DEADBAND_DEG = 8.0
CLIMB_DEADBAND = 0.15  # vertical displacement below this share of the horizontal distance is dropped
NEAR_M, NEAR_SCALE = 5.0, 0.6
BRAKE_M = 2.0
YAW_RATE = math.radians(60.0)  # rad/s
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
    move = _move(math.hypot(right, forward), up, go.depth_m, bearing)
    if abs(bearing) <= math.radians(BEARING_DEADBAND_DEG):
        return (move,)  # the nose comes round on the way
    return (_turn(bearing, onto_line=isinstance(move.setpoint, Velocity)), move)


def _turn(angle: float, *, onto_line: bool = False) -> Segment:
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
