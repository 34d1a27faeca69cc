"""All coordinate frames and their conversions.

Conventions
    NED   world frame: north, east, down, metres, origin at the map's geodetic origin.
    FRD   body frame: forward, right, down.
    q     attitude quaternion (w, x, y, z), Hamilton, unit, rotates FRD vectors into NED.
    yaw   rad, 0 = north, positive towards east (clockwise seen from above).

Most functions take and return only plain floats and tuples of floats, so that `numba.njit` can compile them into the
kernels (compiled functions) of `vehicles` and `autopilot`.
"""

import math
from collections.abc import Iterable, Sequence

EARTH_RADIUS_M = 6371000.0  # PX4's CONSTANTS_RADIUS_OF_EARTH, so that local frames agree with PX4's
GRAVITY = 9.80665  # m/s²
PX4_HOME = (47.397742, 8.545594, 488.0)  # latitude °, longitude °, altitude m: the usual home of PX4's simulations

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


def vec3(values: Iterable[float]) -> Vec3:
    """Return three numbers, for example a row of an array, as plain floats."""
    x, y, z = values
    return float(x), float(y), float(z)


def wrap_pi(angle: float) -> float:
    """Return `angle` (rad) wrapped into [-π, π)."""
    turned = angle + math.pi
    if 0.0 <= turned < 2.0 * math.pi:
        return turned - math.pi  # same result as the next line, without the slow division
    return turned % (2.0 * math.pi) - math.pi


def course(origin: Sequence[float], goal: Sequence[float]) -> float:
    """Return the horizontal direction (rad, a yaw) from `origin` to `goal`, which are (north, east, …) in m."""
    return math.atan2(goal[1] - origin[1], goal[0] - origin[0])


def bearing_deg(origin: Sequence[float], goal: Sequence[float]) -> float:
    """Return the compass bearing (°, 0 … 360) from `origin` to `goal`, which are (north, east, …) in m."""
    return math.degrees(course(origin, goal)) % 360.0


def quat_multiply(a: Quat, b: Quat) -> Quat:
    """Return the Hamilton product a ⊗ b: first b's rotation, then a's."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def quat_conjugate(q: Quat) -> Quat:
    """Return the inverse rotation of the unit quaternion q."""
    return (q[0], -q[1], -q[2], -q[3])


def quat_normalized(q: Quat) -> Quat:
    """Return q scaled to unit length; the identity if q is (nearly) zero."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    return (q[0] / n, q[1] / n, q[2] / n, q[3] / n)


def rotate(q: Quat, v: Vec3) -> Vec3:
    """Return the FRD vector v in NED."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return (
        v[0] + q[0] * tx + q[2] * tz - q[3] * ty,
        v[1] + q[0] * ty + q[3] * tx - q[1] * tz,
        v[2] + q[0] * tz + q[1] * ty - q[2] * tx,
    )


def rotate_inverse(q: Quat, v: Vec3) -> Vec3:
    """Return the NED vector v in FRD."""
    tx = 2.0 * (-q[2] * v[2] + q[3] * v[1])
    ty = 2.0 * (-q[3] * v[0] + q[1] * v[2])
    tz = 2.0 * (-q[1] * v[1] + q[2] * v[0])
    return (
        v[0] + q[0] * tx - q[2] * tz + q[3] * ty,
        v[1] + q[0] * ty - q[3] * tx + q[1] * tz,
        v[2] + q[0] * tz - q[1] * ty + q[2] * tx,
    )


def quat_from_euler(roll: float, pitch: float, yaw: float) -> Quat:
    """Return the attitude of the aerospace Euler angles (rad, yaw-pitch-roll order)."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def quat_to_euler(q: Quat) -> Vec3:
    """Return (roll, pitch, yaw) in rad, pitch in [-π/2, π/2]."""
    roll = math.atan2(2.0 * (q[0] * q[1] + q[2] * q[3]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (q[0] * q[2] - q[3] * q[1]))))
    yaw = math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
    return (roll, pitch, yaw)


def quat_yaw(q: Quat) -> float:
    """Return the yaw (rad) of the attitude q."""
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


def quat_integrate(q: Quat, rotation_vector: Vec3) -> Quat:
    """Return q rotated by a rotation vector (rad) in the body frame: q ⊗ exp(rotation_vector / 2)."""
    angle = math.sqrt(rotation_vector[0] ** 2 + rotation_vector[1] ** 2 + rotation_vector[2] ** 2)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    dq = (math.cos(0.5 * angle), s * rotation_vector[0], s * rotation_vector[1], s * rotation_vector[2])
    return quat_normalized(quat_multiply(q, dq))


def geodetic_to_ned(lat0: float, lon0: float, alt0: float, lat: float, lon: float, alt: float) -> Vec3:
    """Return the NED position (m) of (lat, lon in degrees, alt in m) relative to the origin (lat0, lon0, alt0).

    Azimuthal equidistant projection on a sphere, as in PX4's MapProjection::project.
    """
    phi0, phi = math.radians(lat0), math.radians(lat)
    dlam = math.radians(lon - lon0)
    # half-angle form, because near the origin the acos of almost 1 would lose millimetres
    h = math.sin(0.5 * (phi - phi0)) ** 2 + math.cos(phi0) * math.cos(phi) * math.sin(0.5 * dlam) ** 2
    c = 2.0 * math.asin(min(1.0, math.sqrt(h)))
    k = 1.0
    if c > 1e-12:
        k = c / math.sin(c)
    north = k * (math.sin(phi - phi0) + 2.0 * math.sin(phi0) * math.cos(phi) * math.sin(0.5 * dlam) ** 2)
    east = k * math.cos(phi) * math.sin(dlam)
    return (north * EARTH_RADIUS_M, east * EARTH_RADIUS_M, alt0 - alt)


def ned_to_geodetic(lat0: float, lon0: float, alt0: float, north: float, east: float, down: float) -> Vec3:
    """Return (lat, lon in degrees, alt in m) of a NED position (m): the inverse of `geodetic_to_ned`."""
    x, y = north / EARTH_RADIUS_M, east / EARTH_RADIUS_M
    c = math.sqrt(x * x + y * y)
    if c < 1e-15:
        return (lat0, lon0, alt0 - down)
    phi0 = math.radians(lat0)
    sc, cc = math.sin(c), math.cos(c)
    phi = math.asin(max(-1.0, min(1.0, cc * math.sin(phi0) + x * sc * math.cos(phi0) / c)))
    lam = math.radians(lon0) + math.atan2(y * sc, c * math.cos(phi0) * cc - x * math.sin(phi0) * sc)
    return (math.degrees(phi), math.degrees(lam), alt0 - down)
