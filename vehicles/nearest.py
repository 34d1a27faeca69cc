"""The nearest points of triangles and boxes."""

import math

from foundation.compiled import njit
from foundation.frames import Vec3
from vehicles.collision_records import Grid32


@njit(cache=True)
def in_triangle(corners: Grid32, t: int, x: float, y: float, z: float) -> tuple[float, float, float, bool]:
    """Return (x, y, z of the point of triangle t nearest to a point, whether it lies inside and not on an edge).

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
    """Return (distance, nearest point of the surface, unit vector out of it) for a point in the box's own axes.

    Inside, the distance is negative and the way out is the shortest.
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
