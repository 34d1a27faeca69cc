"""The safety envelope: limits of positions and speeds. Each limit acts before the vehicle reaches it.

All functions except `load` are pure. `admit` takes a setpoint, the state and the limits. It returns the setpoint that
may be flown, and the names of the limits that changed it. The speed towards a limit is at most GAIN · distance. So a
vehicle stops before the limit, even if its velocity lags half a second behind its setpoint.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from foundation.errors import LinkError, UsageError
from foundation.frames import Vec3, geodetic_to_ned, wrap_pi
from foundation.polygon import contains
from foundation.typed_file import Number, Positive, replaced, toml_table
from hil.link.offboard import OffboardSetpoint, PositionSetpoint, VelocitySetpoint
from hil.link.telemetry import VehicleState

PLACE_GAIN = 1.0  # 1/s, PX4 flies to a place with this speed per metre of distance: MPC_XY_P 0.95, MPC_Z_P 1
HEADING_GAIN = 1.0  # 1/s, PX4 turns to a setpoint's heading with this yaw rate per radian
# 1/s, highest speed per metre of distance to a limit. A real PX4 can stop in time: it reaches nine tenths of a velocity
# step within a second.
GAIN = 0.5
STANDSTILL = VelocitySetpoint((0.0, 0.0, 0.0), 0.0)
BACK_MAX = 0.5  # m/s, highest speed at which a vehicle beyond a limit is brought back
TOUCHING_M = 1e-3  # m: a line that passes a corner at less than this distance touches it
TOUCHING_MPS = 1e-5  # m/s: a wall (horizontal limit) acts if the speed towards it is this near to the highest allowed
STALE_US = 500_000  # µs, highest usable age of a position or attitude

Corner = Annotated[tuple[Number, Number], Meta(extra={"wrong": "is not a corner [north, east]"})]  # m, from home
GeodeticCorner = Annotated[tuple[Number, Number], Meta(extra={"wrong": "is not a corner [latitude, longitude]"})]  # °
Polygon = Annotated[tuple[Corner, ...], Meta(min_length=3)]
GeodeticPolygon = Annotated[tuple[GeodeticCorner, ...], Meta(min_length=3)]


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of the envelope. Heights and distances are from home."""

    ceiling_m: Positive = 30.0
    floor_m: Number = 0.7  # for the agent's setpoints only; the autopilot takes off and lands by itself
    radius_m: Positive = 100.0  # horizontal
    speed: Positive = 1.5  # m/s, horizontal; the paper's controller asks for at most 1.2
    climb: Positive = 1.2  # m/s, up or down
    yaw_rate: Positive = 1.2  # rad/s; the paper's 60°/s is 1.05
    margin_m: Positive = 1.0  # distance from each horizontal limit at which the vehicle stops
    height_margin_m: Positive = 0.3  # distance from ceiling and floor at which the vehicle stops
    battery_min: Positive | None = 0.25  # share of the charge below which the flight ends; None: not checked
    flight_time_max_s: Positive | None = 900.0  # longest time from the start of Offboard; None: not checked
    frame_s: Positive = 1.0  # s, highest age of a frame for a decision; the vehicle holds until a newer one comes
    heartbeat_s: Positive = 3.0  # s of vehicle time without a heartbeat until the vehicle must hold
    exclusions: tuple[Polygon, ...] = ()  # areas that the vehicle may not enter at any height
    exclusions_geodetic: tuple[GeodeticPolygon, ...] = ()  # more such areas, in degrees


SIMULATED = Limits(  # for simulated flights: so wide that no flight of the benchmark reaches a limit
    ceiling_m=120.0, floor_m=-1e3, radius_m=1000.0, speed=40.0, climb=40.0, yaw_rate=3.5,
    battery_min=None, flight_time_max_s=None,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Admitted:
    """A setpoint that may be flown."""

    setpoint: OffboardSetpoint
    limited: tuple[str, ...]  # names of the limits that changed it, in order


def with_local_exclusions(limits: Limits, state: VehicleState) -> Limits:
    """Return the limits with every exclusion in metres from home. Raises LinkError while the origin is unknown."""
    if not limits.exclusions_geodetic:
        return limits
    if state.origin is None or state.home_ned is None:
        raise LinkError("the exclusions are in latitude and longitude, but the autopilot has sent no origin or home")
    home, (lat, lon, alt) = state.home_ned, state.origin
    polygons = tuple(
        tuple(_from_home(geodetic_to_ned(lat, lon, alt, *corner, alt), home) for corner in polygon)
        for polygon in limits.exclusions_geodetic
    )
    return replace(limits, exclusions=limits.exclusions + polygons, exclusions_geodetic=())


def _from_home(position_ned: Vec3, home_ned: Vec3) -> Corner:
    return position_ned[0] - home_ned[0], position_ned[1] - home_ned[1]


def broken_off(state: VehicleState, limits: Limits, elapsed_s: float) -> str | None:
    """Return the reason to end a flight after `elapsed_s`; None: it may continue."""
    battery = state.battery_remaining
    if limits.battery_min is not None and battery is not None and battery < limits.battery_min:
        return f"the battery is at {battery:.0%}, below the envelope's limit of {limits.battery_min:.0%}"
    if limits.flight_time_max_s is not None and elapsed_s > limits.flight_time_max_s:
        return f"the envelope's flight time of {limits.flight_time_max_s:g} s is over"
    return None


def unwatched(state: VehicleState, limits: Limits) -> str | None:
    """Return the reason why the battery limit cannot be checked; None: all limits can be checked."""
    if limits.battery_min is not None and state.battery_remaining is None:
        return f"battery_min = {limits.battery_min:g} cannot be checked, because the autopilot sends no battery level"
    return None


def admit(
    setpoint: OffboardSetpoint, state: VehicleState, home_ned: Vec3, limits: Limits, time_us: int, behind_us: int = 0
) -> Admitted:
    """Return `setpoint`, or the setpoint that replaces it. `state` needs position and attitude.

    `behind_us` is the known delay of all telemetry. It does not count towards the age of a position or attitude.
    """
    assert state.position_ned is not None
    assert state.euler is not None
    if not _is_a_number(setpoint):
        return Admitted(STANDSTILL, ("not a number",))
    for name, measured_us in (("stale position", state.position_us), ("stale attitude", state.attitude_us)):
        if time_us - behind_us - measured_us > STALE_US:
            return Admitted(STANDSTILL, (name,))
    if time_us - state.heartbeat_us > limits.heartbeat_s * 1e6:
        return Admitted(STANDSTILL, ("lost heartbeat",))
    north, east, down = (p - h for p, h in zip(state.position_ned, home_ned, strict=True))
    if isinstance(setpoint, PositionSetpoint):
        return _position(setpoint, (north, east, down), home_ned, state.euler[2], limits)
    return _velocity(setpoint, (north, east, down), state.euler[2], limits)


def _is_a_number(setpoint: OffboardSetpoint) -> bool:
    if isinstance(setpoint, PositionSetpoint):
        return all(map(math.isfinite, (*setpoint.position_ned, setpoint.yaw)))
    return all(map(math.isfinite, (*setpoint.velocity_body, setpoint.yaw_rate)))


def _velocity(setpoint: VelocitySetpoint, at: Vec3, yaw: float, limits: Limits) -> Admitted:
    limited: list[str] = []
    forward, right, down = setpoint.velocity_body
    c, s = math.cos(yaw), math.sin(yaw)
    north, east = c * forward - s * right, s * forward + c * right
    speed = math.hypot(north, east)
    if speed > limits.speed:
        north, east = north * limits.speed / speed, east * limits.speed / speed
        limited.append("speed")
    if abs(down) > limits.climb:
        down = math.copysign(limits.climb, down)
        limited.append("climb")
    height = -at[2]
    up_max = _towards(limits.ceiling_m - height, limits.height_margin_m)
    down_max = _towards(height - limits.floor_m, limits.height_margin_m)
    if -down > up_max:
        down = -up_max
        limited.append("ceiling")
    elif down > down_max:
        down = down_max
        limited.append("floor")
    walls = _walls(at, limits)
    inside = _nearest_velocity((north, east), [(normal, allowed) for _, normal, allowed in walls], limits.speed)
    if inside != (north, east):
        north, east = inside
        limited += [name for name, normal, allowed in walls if _along(inside, normal) > allowed - TOUCHING_MPS]
    yaw_rate = max(-limits.yaw_rate, min(limits.yaw_rate, setpoint.yaw_rate))
    if yaw_rate != setpoint.yaw_rate:
        limited.append("yaw rate")
    if not limited:
        return Admitted(setpoint, ())
    return Admitted(VelocitySetpoint((c * north + s * east, -s * north + c * east, down), yaw_rate), _once(limited))


def _position(setpoint: PositionSetpoint, at: Vec3, home: Vec3, yaw: float, limits: Limits) -> Admitted:
    """Return the admitted setpoint for a place.

    A place beyond a limit is moved inside. If the place, or the way to the place, enters an exclusion or its margin,
    the vehicle keeps its present north and east. A velocity setpoint towards the place and the heading replaces the
    setpoint if the autopilot would fly or turn faster than the limits allow. It also replaces the setpoint inside an
    exclusion, which the vehicle leaves over the nearest edge.
    """
    limited: list[str] = []
    north, east, down = (p - h for p, h in zip(setpoint.position_ned, home, strict=True))
    top, bottom = limits.ceiling_m - limits.height_margin_m, limits.floor_m + limits.height_margin_m
    height = max(bottom, min(top, -down)) if bottom < top else -down
    if height != -down:
        limited.append("ceiling" if -down > top else "floor")
    distance, reach = math.hypot(north, east), limits.radius_m - limits.margin_m
    if distance > reach:
        north, east = north * reach / distance, east * reach / distance
        limited.append("radius")
    if any(_is_barred((at[0], at[1]), (north, east), p, limits.margin_m) for p in limits.exclusions):
        north, east = at[0], at[1]
        limited.append("exclusion")
    away = (north - at[0], east - at[1], -height - at[2])
    turned = wrap_pi(setpoint.yaw - yaw)
    fast, steep = math.hypot(*away[:2]) * PLACE_GAIN > limits.speed, abs(away[2]) * PLACE_GAIN > limits.climb
    spins = abs(turned) * HEADING_GAIN > limits.yaw_rate
    is_excluded = any(contains(polygon, (at[0], at[1])) for polygon in limits.exclusions)
    if fast or steep or spins or is_excluded:
        share = limits.speed / math.hypot(*away[:2]) if fast else PLACE_GAIN
        down = max(-limits.climb, min(limits.climb, away[2] * PLACE_GAIN))
        c, s = math.cos(yaw), math.sin(yaw)
        body = ((c * away[0] + s * away[1]) * share, (-s * away[0] + c * away[1]) * share, down)
        turn = max(-limits.yaw_rate, min(limits.yaw_rate, turned * HEADING_GAIN))
        admitted = _velocity(VelocitySetpoint(body, turn), at, yaw, limits)
        names = ["speed"] * fast + ["climb"] * steep + ["yaw rate"] * spins
        return Admitted(admitted.setpoint, _once([*limited, *names, *admitted.limited]))
    if not limited:
        return Admitted(setpoint, ())
    return Admitted(replace(setpoint, position_ned=(home[0] + north, home[1] + east, home[2] - height)), _once(limited))


def _is_barred(at: Corner, to: Corner, polygon: Sequence[Corner], margin_m: float) -> bool:
    """Return whether the line from `at` to `to` enters an exclusion, or approaches it to less than `margin_m`."""
    if contains(polygon, to) or crosses(at, to, polygon):
        return True
    edges = list(zip(polygon, (*polygon[1:], polygon[0]), strict=True))
    here_m, there_m = (min(_edge(place, a, b)[1] for a, b in edges) for place in (at, to))
    nearest_m = min(there_m, *(_edge(corner, at, to)[1] for corner in polygon))
    return nearest_m < margin_m and nearest_m < here_m - TOUCHING_M


def _towards(room_m: float, margin_m: float) -> float:
    """Return the highest speed (m/s) towards a limit at distance `room_m`; in the margin, negative (away from it)."""
    return max(-BACK_MAX, GAIN * (room_m - margin_m))


def _nearest_velocity(wish: Corner, walls: Sequence[tuple[Corner, float]], speed: float) -> Corner:
    """Return the horizontal velocity (m/s, NE) that is nearest to `wish` and that all walls allow.

    A wall is a unit vector and the highest speed (m/s) along it, which is negative in the wall's margin. The
    length of `wish` and of the result is at most `speed`. If no velocity satisfies all walls (possible in several
    margins), negative speeds of walls count as 0.

    The allowed velocities are a convex polygon within a circle. So the nearest one is `wish`, its projection on a wall,
    or a corner (of two walls, or of a wall and the circle).
    """
    for lowest in (-speed, 0.0):
        bounds = [(normal, max(allowed, lowest)) for normal, allowed in walls if allowed < speed]
        candidates = [wish]
        for normal, allowed in bounds:
            excess = _along(wish, normal) - allowed
            candidates.append((wish[0] - excess * normal[0], wish[1] - excess * normal[1]))
            n, e = allowed * normal[0], allowed * normal[1]
            rest = math.sqrt(speed * speed - allowed * allowed)
            candidates += [(n - side * normal[1], e + side * normal[0]) for side in (-rest, rest)]
        for ((n1, e1), allowed1), ((n2, e2), allowed2) in itertools.combinations(bounds, 2):
            sine = n1 * e2 - e1 * n2
            if abs(sine) > 1e-6:
                candidates.append(((allowed1 * e2 - allowed2 * e1) / sine, (allowed2 * n1 - allowed1 * n2) / sine))
        possible = [
            v for v in candidates
            if math.hypot(*v) <= speed + 1e-6 and all(_along(v, normal) <= allowed + 1e-6 for normal, allowed in bounds)
        ]  # fmt: skip
        if possible:
            return min(possible, key=lambda v: math.dist(v, wish))
    return 0.0, 0.0


def _along(velocity: Corner, direction: Corner) -> float:
    return velocity[0] * direction[0] + velocity[1] * direction[1]


def _walls(at: Vec3, limits: Limits) -> list[tuple[str, Corner, float]]:
    """Return the horizontal limits: name, direction towards the limit (unit), highest speed (m/s) in this direction."""
    walls: list[tuple[str, Corner, float]] = []
    distance = math.hypot(at[0], at[1])
    if distance > 1e-6:
        walls.append(("radius", (at[0] / distance, at[1] / distance), limits.radius_m - distance))
    for polygon in limits.exclusions:
        within = contains(polygon, (at[0], at[1]))
        edges = [_edge((at[0], at[1]), a, b) for a, b in zip(polygon, (*polygon[1:], polygon[0]), strict=True)]
        if within:  # the vehicle must leave over the nearest edge
            (n, e), room = min(edges, key=lambda edge: edge[1])
            walls.append(("exclusion", (-n, -e), -room))
        else:
            walls.extend(("exclusion", towards, room) for towards, room in edges)
    return [(name, towards, _towards(room, limits.margin_m)) for name, towards, room in walls]


def _edge(at: Corner, a: Corner, b: Corner) -> tuple[Corner, float]:
    """Return the direction (unit vector) from `at` to the nearest point of the edge a–b, and the distance in m."""
    along = (b[0] - a[0], b[1] - a[1])
    length = along[0] ** 2 + along[1] ** 2
    share = ((at[0] - a[0]) * along[0] + (at[1] - a[1]) * along[1]) / length if length else 0.0
    share = max(0.0, min(1.0, share))
    n, e = a[0] + share * along[0] - at[0], a[1] + share * along[1] - at[1]
    room = math.hypot(n, e)
    return ((n / room, e / room) if room > 1e-9 else (0.0, 0.0)), room


def crosses(a: Corner, b: Corner, polygon: Sequence[Corner]) -> bool:
    """Return whether the line from a to b crosses an edge of a polygon, or touches one of its corners."""

    def side(p: Corner, q: Corner, r: Corner) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return any(_edge(corner, a, b)[1] < TOUCHING_M for corner in polygon) or any(
        side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
        for c, d in zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    )


def _once(names: list[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


def load(path: Path, base: Limits) -> Limits:
    """Return `base` with the values that the file sets. Raises UsageError that names the file and the field."""
    where = f"--envelope {path}"
    limits = replaced(base, toml_table(path, where), where)
    if limits.floor_m + 2 * limits.height_margin_m >= limits.ceiling_m:
        raise UsageError(
            f"{where}: between floor_m and ceiling_m there is no room beside two height_margin_m. Lower height_margin_m"
        )
    if limits.radius_m <= limits.margin_m:
        raise UsageError(f"{where}: radius_m leaves no room beside margin_m. Lower margin_m")
    return limits
