"""Data types of the compiled collision code, and distances to solids: nearest points of triangles and boxes, rays."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foundation.airframe import MAX_CONTACTS
from foundation.compiled import Record, njit
from foundation.frames import Vec3
from foundation.sensors import MAX_ROTORS

Grid32 = NDArray[np.float32]
Index = NDArray[np.int32]

BUMPERS = 2  # bars of two balls each, from a rotor to the camera
BALLS = MAX_ROTORS + MAX_CONTACTS + 2 + 2 * BUMPERS  # most balls: rotors, feet and masts, hull, camera, bumpers
CANDIDATES = 4096  # room for this many nearby triangles, four times as many as at the thickest hedge of the maps
CONTACTS = 2 * BALLS  # every ball may touch the box and one triangle

SOLIDS = np.dtype(
    [
        ("here", "i8"),  # bool: there are obstacles
        ("balls", "i8"),
        ("ball", "f8", (BALLS, 4)),  # m, FRD centre and radius
        ("ball_rotor", "i8", (BALLS,)),  # number of the rotor whose disc the ball is; -1: no rotor
        ("ball_sound", "f8", (BALLS,)),  # m/s, closing speed above which a hit of the ball is a crash
        ("reach", "f8"),  # m, from the body origin to the farthest point of any ball
        ("origin", "f8", (3,)),  # m, NED; this and the next two fields are as in `foundation.terrain.Obstacles`
        ("cell", "f8"),
        ("cells", "i8", (3,)),
        ("box", "i8"),  # bool: there is a moving box
        ("box_time_us", "i8"),  # µs, time of the pose below
        ("box_half", "f8", (3,)),  # m
        ("box_centre", "f8", (3,)),  # m, NED
        ("box_velocity", "f8", (3,)),  # m/s, NED
        ("box_yaw", "f8"),  # rad
        ("box_yaw_rate", "f8"),  # rad/s
        ("box_reach", "f8"),  # m, distance between box centre and vehicle origin beyond which they cannot touch
    ],
    align=True,
)

NEAR = np.dtype(
    [
        ("looked_at", "f8", (3,)),  # m, NED, the vehicle's position when every ball was last checked
        ("looked_from", "f8", (4,)),  # the vehicle's attitude at that check
        ("free", "f8"),  # m, distance from `looked_at` that the vehicle may move before a ball can touch anything
        ("gathered_at", "f8", (3,)),  # m, NED, position for which the candidates were gathered
        ("holds", "f8"),  # m, the candidates are complete up to this distance from `gathered_at`
        ("candidates", "i8"),
        ("candidate", "i4", (CANDIDATES,)),  # triangle numbers
        ("box_count", "i8"),  # contacts with the box; they come first in the arrays below
        ("ball", "i8", (CONTACTS,)),
        ("owner", "i8", (CONTACTS,)),
        ("depth", "f8", (CONTACTS,)),  # m, overlap
        ("normal", "f8", (CONTACTS, 3)),  # unit, NED, out of the obstacle
        ("point", "f8", (CONTACTS, 3)),  # m, NED
        ("drift", "f8", (CONTACTS, 3)),  # m/s, NED, velocity of the obstacle at `point`
        ("touched_us", "i8", (2 * BALLS,)),  # µs, last touch of ball k: [k] with triangles, [BALLS + k] with the box
        ("newest_us", "i8"),  # µs, last touch of any ball
        ("leant_us", "i8"),  # µs, last touch while off the ground; touches of feet do not count
        ("leant_on", "i8"),  # owner number of the obstacle of that touch
        ("leant_speed", "f8"),  # m/s, closing speed at the beginning of that touch
        ("stiffness", "f8", (CONTACTS,)),  # N/m
        ("pressed", "f8", (CONTACTS,)),  # N·s, normal impulse of the present step
        ("rubbed", "f8", (CONTACTS, 3)),  # N·s, NED, friction impulse of the present step
    ],
    align=True,
)


class SolidTriangles(NamedTuple):
    """The solid triangles, and the grid to find them in: the arrays of `foundation.terrain.Obstacles`."""

    corners: Grid32  # (T, 9) m, NED
    bounds: Grid32  # (T, 4) m, NED, middle and radius
    start: Index  # (cells + 1,) index in `numbers` at which each cell begins
    numbers: Index  # numbers of the triangles in each cell, cell by cell
    owner: Index  # (T,) index in `Obstacles.names` of the obstacle to which a triangle belongs


@njit(cache=True)
def in_triangle(corners: Grid32, t: int, x: float, y: float, z: float) -> tuple[float, float, float, bool]:
    """Return the point of triangle t nearest to (x, y, z), as three numbers, and whether this point is off the edges.

    By the regions of Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
    """
    ax, ay, az = float(corners[t, 0]), float(corners[t, 1]), float(corners[t, 2])
    ux, uy, uz = corners[t, 3] - ax, corners[t, 4] - ay, corners[t, 5] - az
    vx, vy, vz = corners[t, 6] - ax, corners[t, 7] - ay, corners[t, 8] - az
    px, py, pz = x - ax, y - ay, z - az
    d1, d2 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, False
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d3, d4 = d1 - uu, d2 - uv
    if d3 >= 0.0 and d4 <= d3:
        return ax + ux, ay + uy, az + uz, False
    c = d1 * d4 - d3 * d2
    if c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / uu if uu > 0.0 else 0.0
        return ax + s * ux, ay + s * uy, az + s * uz, False
    d5, d6 = d1 - uv, d2 - vv
    if d6 >= 0.0 and d5 <= d6:
        return ax + vx, ay + vy, az + vz, False
    b = d5 * d2 - d1 * d6
    if b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / vv if vv > 0.0 else 0.0
        return ax + s * vx, ay + s * vy, az + s * vz, False
    a = d3 * d6 - d5 * d4
    if a <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        span = (d4 - d3) + (d5 - d6)
        s = (d4 - d3) / span if span > 0.0 else 0.0
        return ax + ux + s * (vx - ux), ay + uy + s * (vy - uy), az + uz + s * (vz - uz), False
    whole = a + b + c
    if not whole > 0.0:
        return ax, ay, az, False
    s, r = b / whole, c / whole
    return ax + s * ux + r * vx, ay + s * uy + r * vy, az + s * uz + r * vz, True


@njit(cache=True)
def in_box(half: Vec3, point: Vec3) -> tuple[float, Vec3, Vec3]:
    """Return (distance, nearest point of the surface, outward unit vector) for a point, all in the box's own axes.

    For a point inside, the distance is negative, and the vector points out of the nearest face.
    """
    x = min(max(point[0], -half[0]), half[0])
    y = min(max(point[1], -half[1]), half[1])
    z = min(max(point[2], -half[2]), half[2])
    dx, dy, dz = point[0] - x, point[1] - y, point[2] - z
    gap = math.sqrt(dx * dx + dy * dy + dz * dz)
    if gap > 1e-9:
        return gap, (x, y, z), (dx / gap, dy / gap, dz / gap)
    ex, ey, ez = half[0] - abs(x), half[1] - abs(y), half[2] - abs(z)
    if ex <= ey and ex <= ez:
        way = math.copysign(1.0, x)
        return -ex, (way * half[0], y, z), (way, 0.0, 0.0)
    if ey <= ez:
        way = math.copysign(1.0, y)
        return -ey, (x, way * half[1], z), (0.0, way, 0.0)
    way = math.copysign(1.0, z)
    return -ez, (x, y, way * half[2]), (0.0, 0.0, way)


@njit(cache=True)
def first_solid(solids: Record, triangles: SolidTriangles, time_us: int, eye: Vec3, way: Vec3, most: float) -> float:
    """Return the distance (m) from `eye` along the unit vector `way` (NED) to the first solid; inf: none within `most`.

    Walks from cell to cell of the grid (Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", 1987).
    """
    found = _box(solids, time_us, eye, way) if solids.box != 0 else math.inf
    enters, leaves = 0.0, min(most, found)
    for axis in range(3):
        low = solids.origin[axis] - eye[axis]
        enters, leaves = _within(enters, leaves, low, low + solids.cells[axis] * solids.cell, way[axis])
    if not enters < leaves:
        return found if found <= most else math.inf
    spot = (_cell(solids, eye, way, enters, 0), _cell(solids, eye, way, enters, 1), _cell(solids, eye, way, enters, 2))
    at = enters
    while at < leaves:
        out, axis = math.inf, 0
        for i in range(3):
            if way[i] != 0.0:
                wall = solids.origin[i] + (spot[i] + (1 if way[i] > 0.0 else 0)) * solids.cell
                reached = (wall - eye[i]) / way[i]
                if reached < out:
                    out, axis = reached, i
        number = (spot[0] * solids.cells[1] + spot[1]) * solids.cells[2] + spot[2]
        for n in range(triangles.start[number], triangles.start[number + 1]):
            found = min(found, _triangle(triangles.corners, triangles.bounds, triangles.numbers[n], eye, way))
        if found <= out:
            break
        at = max(at, out)
        step = 1 if way[axis] > 0.0 else -1
        spot = (
            spot[0] + (step if axis == 0 else 0),
            spot[1] + (step if axis == 1 else 0),
            spot[2] + (step if axis == 2 else 0),
        )
        if not 0 <= spot[axis] < solids.cells[axis]:
            break
    return found if found <= most else math.inf


@njit(cache=True)
def _cell(solids: Record, eye: Vec3, way: Vec3, at: float, axis: int) -> int:
    """Return the index, along an axis, of the cell that a ray is in after `at` (m), clamped to the grid."""
    number: float = (eye[axis] + at * way[axis] - solids.origin[axis]) / solids.cell
    last: int = solids.cells[axis] - 1
    return min(max(math.floor(number), 0), last)


@njit(cache=True)
def _within(enters: float, leaves: float, low: float, high: float, way: float) -> tuple[float, float]:
    """Return the part of a ray's interval (m) between two planes, `low` and `high` m from the eye along an axis."""
    if way == 0.0:
        return (enters, leaves) if low <= 0.0 <= high else (enters, -math.inf)
    near, far = low / way, high / way
    if near > far:
        near, far = far, near
    return max(enters, near), min(leaves, far)


@njit(cache=True)
def _triangle(corners: Grid32, bounds: Grid32, t: int, eye: Vec3, way: Vec3) -> float:
    """Return the distance (m) at which a ray crosses triangle t, from either side; inf when it does not.

    Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", 1997.
    """
    sx, sy, sz = bounds[t, 0] - eye[0], bounds[t, 1] - eye[1], bounds[t, 2] - eye[2]
    ahead = sx * way[0] + sy * way[1] + sz * way[2]
    if sx * sx + sy * sy + sz * sz - ahead * ahead > bounds[t, 3] * bounds[t, 3]:
        return math.inf
    ax, ay, az = float(corners[t, 0]), float(corners[t, 1]), float(corners[t, 2])
    ux, uy, uz = corners[t, 3] - ax, corners[t, 4] - ay, corners[t, 5] - az
    vx, vy, vz = corners[t, 6] - ax, corners[t, 7] - ay, corners[t, 8] - az
    px, py, pz = way[1] * vz - way[2] * vy, way[2] * vx - way[0] * vz, way[0] * vy - way[1] * vx
    size = ux * px + uy * py + uz * pz
    if abs(size) < 1e-12:
        return math.inf
    tx, ty, tz = eye[0] - ax, eye[1] - ay, eye[2] - az
    u = (tx * px + ty * py + tz * pz) / size
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    v = (way[0] * qx + way[1] * qy + way[2] * qz) / size
    distance = (vx * qx + vy * qy + vz * qz) / size
    inside = u >= 0.0 and v >= 0.0 and u + v <= 1.0 and distance >= 0.0
    return distance if inside else math.inf


@njit(cache=True)
def _box(solids: Record, time_us: int, eye: Vec3, way: Vec3) -> float:
    """Return the distance (m) at which a ray enters the moving box; inf when it does not."""
    since = (time_us - solids.box_time_us) * 1e-6
    x = eye[0] - solids.box_centre[0] - solids.box_velocity[0] * since
    y = eye[1] - solids.box_centre[1] - solids.box_velocity[1] * since
    z = eye[2] - solids.box_centre[2] - solids.box_velocity[2] * since
    yaw = solids.box_yaw + solids.box_yaw_rate * since
    c, s = math.cos(yaw), math.sin(yaw)
    local = (c * x + s * y, -s * x + c * y, z)
    along = (c * way[0] + s * way[1], -s * way[0] + c * way[1], way[2])
    enters, leaves = 0.0, math.inf
    for axis in range(3):
        half = solids.box_half[axis]
        enters, leaves = _within(enters, leaves, -half - local[axis], half - local[axis], along[axis])
    return enters if enters < leaves else math.inf
