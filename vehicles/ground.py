"""The ground: its height at a point, and its contact forces on a vehicle.

Each contact point of the airframe is a spring and damper along the surface normal. A second spring along the surface
ties the point to an anchor. The anchor slips if the spring force exceeds the limit of Coulomb friction. So a vehicle at
rest stays at rest, in wind and on a slope. With friction that depends on velocity it would creep.
"""

import math

import cv2
import numpy as np

from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Quat, Vec3
from foundation.terrain import HeightField
from vehicles.records import STEP_S, Load, rotate, rotate_inverse

# rad/s, vertical resonance of a vehicle on its four feet, which sink in by 0.7 mm at rest. On one foot, which moves a
# tenth of the mass, it is 190 rad/s: 0.19 rad per step of 1 ms. RK4 is stable up to 2.8 rad per step.
RESONANCE = 120.0
DAMPING_RATIO = 0.6
FRICTION = 0.7  # rubber or plastic on dry hard ground
TANGENTIAL = 0.7  # stiffness along the surface, relative to the stiffness along the normal
# m, depth beyond which the spring force stays constant, so that a step in the terrain does not throw a vehicle up
DEEPEST = 0.2
MARGIN = 0.005  # m, added to the travel of a step because the vehicle may accelerate
STILL = 1e-5  # m/s, rad/s and m/s²; a vehicle below these limits stands still
# a vehicle at rest stays at rest if the rotors' vertical force changes by less than STEADY · weight, and each component
# of their moment by less than STEADY · weight · `reach`
STEADY = 1e-4
CRASH_FOOT = 5.0  # m/s, normal speed that breaks a landing gear: a fall of 1.3 m
CRASH_BODY = 1.0  # m/s, normal speed that breaks a propeller or the hull


def peaks(terrain: HeightField, reach: float) -> Grid:
    """Return the highest ground (NED z, m, same shape as the grid) within `reach` (m) of each cell.

    All heights must be finite.
    """
    cells = 2 * (math.ceil(reach / terrain.cell_m) + 1) + 1
    return np.asarray(cv2.erode(terrain.down, np.ones((cells, cells), np.uint8)))


@njit(cache=True)
def surface(params: Record, down: Grid, north: float, east: float) -> Vec3:
    """Return (NED z of the ground in m, its slope to the north, its slope to the east), as in `HeightField.at`."""
    rows, columns = down.shape
    if rows * columns == 1:
        return down[0, 0], 0.0, 0.0
    i = min(max((north - params.ground_north) / params.ground_cell, 0.0), rows - 1.0)
    j = min(max((east - params.ground_east) / params.ground_cell, 0.0), columns - 1.0)
    i0, j0 = min(int(i), max(rows - 2, 0)), min(int(j), max(columns - 2, 0))
    i1, j1 = min(i0 + 1, rows - 1), min(j0 + 1, columns - 1)
    u, v = i - i0, j - j0
    a, b, c, d = down[i0, j0], down[i0, j1], down[i1, j0], down[i1, j1]
    low, high = a * (1.0 - v) + b * v, c * (1.0 - v) + d * v
    slope_east = ((b - a) * (1.0 - u) + (d - c) * u) / params.ground_cell
    return low * (1.0 - u) + high * u, (high - low) / params.ground_cell, slope_east


@njit(cache=True)
def in_reach(params: Record, peak: Grid, position: Vec3) -> bool:
    """Return whether any contact point could touch the ground at this position (m, NED)."""
    rows, columns = peak.shape
    i = min(max((position[0] - params.ground_north) / params.ground_cell, 0.0), rows - 1.0)
    j = min(max((position[1] - params.ground_east) / params.ground_cell, 0.0), columns - 1.0)
    near: bool = position[2] + params.reach + MARGIN > peak[int(i), int(j)]
    return near


@njit(cache=True)
def candidates(params: Record, state: Record, down: Grid, attitude: Quat) -> int:
    """Return a bit mask of the contact points close enough to touch the ground within the coming step."""
    velocity, rates = state.velocity, state.rates
    spin = abs(rates[0]) + abs(rates[1]) + abs(rates[2])
    speed = abs(velocity[0]) + abs(velocity[1]) + abs(velocity[2]) + spin * params.reach
    margin = MARGIN + STEP_S * speed
    mask = 0
    for k in range(params.contacts):
        arm = rotate(
            attitude, (params.contact_position[k, 0], params.contact_position[k, 1], params.contact_position[k, 2])
        )
        z, slope_north, slope_east = surface(params, down, state.position[0] + arm[0], state.position[1] + arm[1])
        if state.position[2] + arm[2] + margin * (1.0 + abs(slope_north) + abs(slope_east)) > z:
            mask |= 1 << k
    return mask


@njit(cache=True)
def _touch(
    params: Record, down: Grid, k: int, position: Vec3, attitude: Quat, velocity: Vec3, rates: Vec3
) -> tuple[float, float, Vec3, Vec3, Vec3, Vec3]:
    """Return the state of contact point k: (depth, closing speed, arm NED, normal NED, velocity NED, point NED)."""
    px, py, pz = params.contact_position[k, 0], params.contact_position[k, 1], params.contact_position[k, 2]
    arm = rotate(attitude, (px, py, pz))
    point = (position[0] + arm[0], position[1] + arm[1], position[2] + arm[2])
    z, slope_north, slope_east = surface(params, down, point[0], point[1])
    steep = slope_north * slope_north + slope_east * slope_east
    scale = 1.0 / math.sqrt(1.0 + steep) if steep > 0.0 else 1.0
    normal = (slope_north * scale, slope_east * scale, -scale)
    spin = rotate(
        attitude, (rates[1] * pz - rates[2] * py, rates[2] * px - rates[0] * pz, rates[0] * py - rates[1] * px)
    )
    moving = (velocity[0] + spin[0], velocity[1] + spin[1], velocity[2] + spin[2])
    closing = -(moving[0] * normal[0] + moving[1] * normal[1] + moving[2] * normal[2])
    return (point[2] - z) * scale, closing, arm, normal, moving, point


@njit(cache=True)
def support(
    params: Record, state: Record, down: Grid, mask: int, position: Vec3, attitude: Quat, velocity: Vec3, rates: Vec3
) -> tuple[Vec3, Vec3]:
    """Return (force N NED, moment N·m NED about the body origin) of the ground on the contact points in `mask`."""
    fx = fy = fz = mx = my = mz = 0.0
    stiffness, damping = params.contact_stiffness, params.contact_damping
    fading = stiffness / (0.1 * params.mass)  # full damping once the spring carries about 1 % of the weight
    for k in range(params.contacts):
        if mask >> k & 1 == 0:
            continue
        depth, closing, arm, normal, moving, point = _touch(params, down, k, position, attitude, velocity, rates)
        if depth <= 0.0:
            continue
        # the damper fades in with depth, so that a touch begins without a jump of force
        fade = min(depth * fading, 1.0)
        load = max(stiffness * min(depth, DEEPEST) + damping * fade * closing, 0.0)
        tx = ty = tz = 0.0
        if state.contact[k] != 0:
            ox, oy, oz = state.anchor[k, 0] - point[0], state.anchor[k, 1] - point[1], state.anchor[k, 2] - point[2]
            tx, ty, tz = TANGENTIAL * stiffness * ox, TANGENTIAL * stiffness * oy, TANGENTIAL * stiffness * oz
        tx -= damping * fade * moving[0]
        ty -= damping * fade * moving[1]
        tz -= damping * fade * moving[2]
        along = tx * normal[0] + ty * normal[1] + tz * normal[2]
        tx, ty, tz = tx - along * normal[0], ty - along * normal[1], tz - along * normal[2]
        square = tx * tx + ty * ty + tz * tz
        if square > (FRICTION * load) ** 2:
            shrink = FRICTION * load / math.sqrt(square)
            tx, ty, tz = tx * shrink, ty * shrink, tz * shrink
        px, py, pz = load * normal[0] + tx, load * normal[1] + ty, load * normal[2] + tz
        fx += px
        fy += py
        fz += pz
        mx += arm[1] * pz - arm[2] * py
        my += arm[2] * px - arm[0] * pz
        mz += arm[0] * py - arm[1] * px
    return (fx, fy, fz), (mx, my, mz)


@njit(cache=True)
def at_rest(params: Record, state: Record, load: Load, breeze: Vec3) -> bool:
    """Return whether the vehicle stands still and no new force could move it.

    `load` is the force and moment of the rotors, `breeze` (m/s, NED) the wind. The caller then skips the integration,
    because the motion of a vehicle at rest is far below the noise of every sensor.
    """
    if state.on_ground == 0:
        return False
    force, moment, _ = load
    weight = params.mass * GRAVITY
    if (
        abs(force[2] - state.carried[0]) > STEADY * weight
        or abs(moment[0] - state.carried[1]) > STEADY * weight * params.reach
        or abs(moment[1] - state.carried[2]) > STEADY * weight * params.reach
        or abs(moment[2] - state.carried[3]) > STEADY * weight * params.reach
    ):
        return False
    restless = 0.0
    for i in range(3):
        if state.external_force[i] != 0.0 or state.external_torque[i] != 0.0 or breeze[i] != 0.0:
            return False
        restless = max(restless, abs(state.velocity[i]), abs(state.rates[i]))
    felt = state.specific_force
    return restless < STILL and abs(felt[0] ** 2 + felt[1] ** 2 + felt[2] ** 2 - GRAVITY**2) < STILL * GRAVITY


@njit(cache=True)
def freeze_at_rest(state: Record) -> None:
    """Keep a vehicle at rest exactly in place."""
    felt = rotate_inverse(
        (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3]), (0.0, 0.0, -GRAVITY)
    )
    for i in range(3):
        state.velocity[i] = 0.0
        state.rates[i] = 0.0
        state.mean_rates[i] = 0.0
        state.specific_force[i] = felt[i]


@njit(cache=True)
def update_contacts(params: Record, state: Record, down: Grid, load: Load, mask: int) -> None:
    """Update the contacts after a step: note the rotors' load and the contacts, move slipped anchors, latch a crash."""
    position = (state.position[0], state.position[1], state.position[2])
    velocity = (state.velocity[0], state.velocity[1], state.velocity[2])
    rates = (state.rates[0], state.rates[1], state.rates[2])
    attitude = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    state.on_ground = 0
    state.carried[0] = load[0][2]
    state.carried[1], state.carried[2], state.carried[3] = load[1]
    for k in range(params.contacts):
        if mask >> k & 1 == 0:
            state.contact[k] = 0
            continue
        depth, closing, _, normal, _, point = _touch(params, down, k, position, attitude, velocity, rates)
        if depth <= 0.0:
            state.contact[k] = 0
            continue
        state.on_ground = 1
        if closing > (CRASH_FOOT if params.contact_is_foot[k] != 0 else CRASH_BODY):
            state.crashed = 1
        if state.contact[k] == 0:
            state.contact[k] = 1
            state.anchor[k, 0], state.anchor[k, 1], state.anchor[k, 2] = point
            continue
        ox, oy, oz = state.anchor[k, 0] - point[0], state.anchor[k, 1] - point[1], state.anchor[k, 2] - point[2]
        along = ox * normal[0] + oy * normal[1] + oz * normal[2]
        ox, oy, oz = ox - along * normal[0], oy - along * normal[1], oz - along * normal[2]
        square = ox * ox + oy * oy + oz * oz
        limit = FRICTION * min(depth, DEEPEST) / TANGENTIAL
        if square > limit * limit:
            shrink = limit / math.sqrt(square)
            state.anchor[k, 0], state.anchor[k, 1] = point[0] + ox * shrink, point[1] + oy * shrink
            state.anchor[k, 2] = point[2] + oz * shrink
