"""From an acceleration and a yaw to an attitude and a collective thrust, and what hovering takes."""

import math

from autopilot.compiled_frames import quat_from_euler
from foundation.compiled import Record, njit
from foundation.frames import GRAVITY, Quat, Vec3

HOVER_TIME_S = 3.0  # time constant of the hover thrust estimate: batteries sag slowly
LEAST_LIFT = 0.2 * GRAVITY  # m/s²: the thrust vector never points down, however fast the descent


@njit(cache=True)
def limit_force(params: Record, hover_thrust: float, ceiling: float, acceleration: Vec3) -> Vec3:
    """Return the specific force (NED, m/s²) to ask of the rotors: tilt limited, the vertical before the horizontal."""
    per_thrust = GRAVITY / hover_thrust  # m/s² at full collective
    top = min(params.thrust_max, ceiling) * per_thrust
    bottom = max(params.thrust_min * per_thrust, LEAST_LIFT)
    x, y = acceleration[0], acceleration[1]
    lift = min(max(GRAVITY - acceleration[2], bottom), max(top, 1e-3))
    side = math.sqrt(x * x + y * y)
    margin = params.thrust_horizontal_margin * top
    if side * side + lift * lift > top * top:
        allowed = math.sqrt(max(top * top - min(side, margin) ** 2, 0.0))
        lift = min(lift, max(allowed, 1e-3))
        reach = math.sqrt(max(top * top - lift * lift, 0.0))
    else:
        reach = side
    reach = min(reach, lift * math.tan(params.tilt_max))
    if side > reach:
        scale = reach / side if side > 1e-9 else 0.0
        x *= scale
        y *= scale
    return x, y, -lift


@njit(cache=True)
def attitude_of(force: Vec3, yaw: float) -> Quat:
    """Return the attitude whose rotors push along `force` (NED, not zero) and whose Euler yaw is `yaw` (rad).

    With b the down axis turned back by the yaw, b = (sin p cos r, -sin r, cos p cos r).
    """
    n = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    bx, by, bz = -force[0] / n, -force[1] / n, -force[2] / n
    c, s = math.cos(yaw), math.sin(yaw)
    forward, right = c * bx + s * by, -s * bx + c * by
    roll = math.asin(min(max(-right, -1.0), 1.0))
    pitch = math.atan2(forward, bz)
    return quat_from_euler(roll, pitch, yaw)


@njit(cache=True)
def track_hover(params: Record, state: Record, estimate: Record, dt: float) -> None:
    """Follow the collective thrust that carries the weight: thrust over measured lift, where both are well known."""
    if state.landed != 0 or state.thrust_filtered < 0.05 or state.blocked_s > 0.0:
        return
    lift = -estimate.accel_frd[2]
    if lift < 0.4 * GRAVITY:
        return
    sample = state.thrust_filtered * GRAVITY / lift
    if not 0.6 * state.hover_thrust < sample < 1.6 * state.hover_thrust:
        return  # the ground carries a part of the weight, or something hit
    low, high = 0.5 * params.hover_thrust, min(2.0 * params.hover_thrust, 0.95)
    step = dt / HOVER_TIME_S * (sample - state.hover_thrust)
    state.hover_thrust = min(max(state.hover_thrust + step, low), high)
