"""Computes attitude and collective thrust from an acceleration and a yaw, and rotor commands from torque and thrust.

The rotor geometry gives a matrix from rotor thrusts to (roll, pitch, yaw torque, collective). Its pseudo-inverse
distributes a demand. If a rotor would leave its range, roll and pitch have priority, then the collective, then yaw.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autopilot.records import quat_from_euler
from foundation.airframe import Airframe
from foundation.compiled import Grid, Record, njit
from foundation.errors import UsageError
from foundation.frames import GRAVITY, Quat, Vec3
from foundation.sensors import MAX_ROTORS

HOVER_TIME_S = 3.0  # time constant of the hover thrust estimate, which follows the slow sag of the battery
LEAST_LIFT = 0.2 * GRAVITY  # m/s², least upward force per mass: the thrust vector points up also in a fast descent


@njit(cache=True)
def limit_force(params: Record, hover_thrust: float, ceiling: float, acceleration: Vec3) -> Vec3:
    """Return the specific force (NED, m/s²) of the rotors for an acceleration (NED), within tilt and thrust limits.

    `ceiling` is the setpoint's thrust limit (0 … 1). The vertical force has priority, but leaves the fraction
    `thrust_horizontal_margin` of the thrust to the horizontal force.
    """
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
    """Return the attitude in which the rotors push along `force` (NED, not zero) and the Euler yaw is `yaw` (rad).

    With roll r and pitch p, the body's down axis, rotated back by the yaw, is b = (sin p cos r, -sin r, cos p cos r).
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
    """Update the estimate of the hover thrust from the ratio of thrust to measured lift, if both are reliable."""
    if state.landed != 0 or state.thrust_filtered < 0.05 or state.blocked_s > 0.0:
        return
    lift = -estimate.accel_frd[2]
    if lift < 0.4 * GRAVITY:
        return
    sample = state.thrust_filtered * GRAVITY / lift
    if not 0.6 * state.hover_thrust < sample < 1.6 * state.hover_thrust:
        return  # the ground carries a part of the weight, or the vehicle hit something
    low, high = 0.5 * params.hover_thrust, min(2.0 * params.hover_thrust, 0.95)
    step = dt / HOVER_TIME_S * (sample - state.hover_thrust)
    state.hover_thrust = min(max(state.hover_thrust + step, low), high)


@dataclass(frozen=True, slots=True)
class Allocation:
    """The distribution of a demand to the rotors of an airframe."""

    effectiveness: NDArray[np.float64]  # (4, n) roll, pitch, yaw torque (N·m), collective (N) per N of a rotor
    mix: NDArray[np.float64]  # (MAX_ROTORS, 4) thrust fraction per roll, pitch, yaw and collective (normalised)
    torque_max: tuple[float, float, float]  # N·m at a normalised torque of 1


def allocation(airframe: Airframe) -> Allocation:
    """Return the allocation of an airframe.

    A normalised torque of 1 changes the thrust of the most affected rotor by half its range. Raises UsageError if the
    rotors cannot control roll, pitch, yaw and lift independently.
    """
    count = len(airframe.rotors)
    if not 4 <= count <= MAX_ROTORS:
        raise UsageError(f"airframe {airframe.name!r} has {count} rotors: the mixer handles 4 to {MAX_ROTORS}")
    curve = airframe.curve
    arm = curve.torque_coefficient / curve.thrust_coefficient  # m
    effectiveness = np.array(
        [
            [-rotor.position_frd[1] for rotor in airframe.rotors],
            [rotor.position_frd[0] for rotor in airframe.rotors],
            [rotor.spin * arm for rotor in airframe.rotors],
            [1.0] * count,
        ]
    )
    if np.linalg.matrix_rank(effectiveness, tol=1e-9) < 4:
        raise UsageError(
            f"airframe {airframe.name!r} cannot be controlled: its rotors do not give independent roll, pitch, yaw"
            " and lift. Check their positions and spins"
        )
    rotor_max = airframe.thrust_max / count
    inverse = np.linalg.pinv(effectiveness) / rotor_max  # fraction per N·m (columns 0 to 2) and per N (column 3)
    torque_max = 0.5 / np.abs(inverse[:, :3]).max(axis=0)
    mix = np.zeros((MAX_ROTORS, 4))
    mix[:count, :3] = inverse[:, :3] * torque_max
    mix[:count, 3] = inverse[:, 3] * airframe.thrust_max
    if mix[:count, 3].min() <= 0.0:
        raise UsageError(f"airframe {airframe.name!r} cannot hover level. Move its centre of mass between its rotors")
    roll, pitch, yaw = (float(value) for value in torque_max)
    return Allocation(effectiveness, mix, (roll, pitch, yaw))


@njit(cache=True)
def mix(params: Record, roll: float, pitch: float, yaw: float, thrust: float, fractions: Grid) -> Vec3:
    """Write rotor thrust fractions in [floor, 1] and return (achieved roll-pitch scale, yaw scale, collective).

    The floor is `params.rotor_thrust_min`. `roll`, `pitch` and `yaw` are in [-1, 1], `thrust` in [0, 1].
    `fractions` (MAX_ROTORS,) is the output. Roll and pitch may lower or raise the collective. With
    `airmode` 0 they raise it at most to the collective that gives each rotor the floor thrust without any torque.
    """
    matrix, rotors, floor = params.mix, params.rotors, params.rotor_thrust_min
    thrust = min(max(thrust, 0.0), 1.0)
    # share: the largest fraction of roll and pitch for which a collective exists that keeps every rotor in range
    least = 0.0
    for i in range(rotors):
        fractions[i] = matrix[i, 0] * roll + matrix[i, 1] * pitch
        least = min(least, fractions[i] / matrix[i, 3])
    share = 1.0
    for i in range(rotors):
        spread = fractions[i] / matrix[i, 3] - least
        room = (1.0 - floor) / matrix[i, 3]
        if share * spread > room:
            share = room / spread
    # collective: nearest to `thrust`
    low, high, idle = 0.0, 1e9, 0.0
    for i in range(rotors):
        idle = max(idle, floor / matrix[i, 3])
        low = max(low, (floor - share * fractions[i]) / matrix[i, 3])
        high = min(high, (1.0 - share * fractions[i]) / matrix[i, 3])
    collective = min(thrust, high)
    if params.airmode != 0:
        collective = max(collective, low)
    elif collective < low:
        collective = max(collective, min(low, idle))
        for i in range(rotors):
            if collective * matrix[i, 3] + share * fractions[i] < floor and fractions[i] < 0.0:
                share = max((floor - collective * matrix[i, 3]) / fractions[i], 0.0)
    for i in range(rotors):
        fractions[i] = share * fractions[i] + collective * matrix[i, 3]
    # turn: the largest fraction of yaw with every rotor in range
    turn = 1.0
    for i in range(rotors):
        step = matrix[i, 2] * yaw
        if step > 0.0 and fractions[i] + turn * step > 1.0:
            turn = max((1.0 - fractions[i]) / step, 0.0)
        elif step < 0.0 and fractions[i] + turn * step < floor:
            turn = max((floor - fractions[i]) / step, 0.0)
    for i in range(rotors):
        fractions[i] = min(max(fractions[i] + turn * matrix[i, 2] * yaw, floor), 1.0)
    return share, turn, collective
