"""Messages that steer the vehicle: external setpoints, the sticks of a ground station, and the target to follow.

Setpoints are decoded, or rejected, by PX4's rules for type masks and frames. Accepted setpoints are stored with the
time of arrival.
Sources: MAVLink POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK; the rules as read and measured on PX4 1.15.
"""

import math

from autopilot.mavlink.node import Node, Port
from autopilot.mavlink.status_makers import Message
from autopilot.records import FREE, KIND_ATTITUDE, KIND_RATES, NAN, CascadeSetpoint
from foundation.frames import Quat, Vec3, geodetic_to_ned, quat_normalized, rotate
from foundation.mavlink import dialect

LOCAL_NED, BODY_NED = dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_NED
GLOBAL_INT = dialect.MAV_FRAME_GLOBAL_INT
GLOBAL_RELATIVE_INT = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
GLOBAL_TERRAIN_INT = dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
FORCE, YAW_IGNORE, YAW_RATE_IGNORE = 0x200, 0x400, 0x800
LIMIT = 1e6  # m/s, m/s², rad, rad/s; a larger number counts as nan, so that the cascade does not overflow


class RejectedError(ValueError):
    """A setpoint that PX4 would reject. The text is the reason."""


def _group(mask: int, first_bit: int, vector: Vec3, limit: float = LIMIT) -> Vec3:
    """Return a vector, with nan for a component that the mask ignores or that is not below `limit`."""
    x, y, z = (value if not mask >> first_bit + i & 1 and abs(value) < limit else NAN for i, value in enumerate(vector))
    return (x, y, z)


def _angle(mask: int, bit: int, value: float) -> float:
    return value if not mask & bit and abs(value) < LIMIT else NAN


def trajectory(mask: int, frame: int, position: Vec3, velocity: Vec3, acceleration: Vec3, yaw: float, yaw_rate: float,
               attitude: Quat, heading: float) -> CascadeSetpoint:  # fmt: skip
    """Return the raw fields of a message (frame LOCAL_NED or BODY_NED) as a setpoint in the local frame.

    `attitude` and `heading` (rad) are the vehicle's. In BODY_NED the position is ignored, and so is the velocity if
    the mask ignores one of its components. The heading alone rotates the velocity (z stays world down). The attitude
    rotates the acceleration. Raises RejectedError for another frame, for a force setpoint, or if no axis is controlled.
    """
    if mask & FORCE:
        raise RejectedError("force not supported")
    p = _group(mask, 0, position, math.inf)  # any distance is valid: flight modes limit speeds
    v = _group(mask, 3, velocity)
    a = _group(mask, 6, acceleration)
    if frame == BODY_NED:
        p = FREE
        if mask & 0x38:
            v = FREE
        c, s = math.cos(heading), math.sin(heading)
        v = (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])
        a = rotate(attitude, a)
    elif frame != LOCAL_NED:
        raise RejectedError(f"coordinate frame {frame} unsupported")
    if not any(math.isfinite(x) for x in (*p, *v, *a)):
        raise RejectedError("invalid")
    return CascadeSetpoint(
        position_ned=p,
        velocity_ned=v,
        acceleration_ned=a,
        yaw=_angle(mask, YAW_IGNORE, yaw),
        yaw_rate=_angle(mask, YAW_RATE_IGNORE, yaw_rate),
    )


def _accept(node: Node, setpoint: CascadeSetpoint) -> None:
    offboard = node.vehicle.commander.flight.offboard
    offboard.setpoint, offboard.time_us = setpoint, node.time_us


def _take(node: Node, m: Message, frame: int, position: Vec3) -> None:
    """Store the trajectory setpoint of a message; complain about a setpoint that PX4 would reject."""
    state = node.vehicle.state
    try:
        setpoint = trajectory(
            m.type_mask, frame, position, (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz), m.yaw, m.yaw_rate,
            state.attitude, state.yaw,
        )  # fmt: skip
    except RejectedError as reason:
        node.complain(f"{m.get_type()} {reason}")
    else:
        _accept(node, setpoint)


def local_ned(node: Node, port: Port, message: Message) -> None:
    """Handle SET_POSITION_TARGET_LOCAL_NED."""
    _take(node, message, message.coordinate_frame, (message.x, message.y, message.z))


def global_int(node: Node, port: Port, message: Message) -> None:
    """Handle SET_POSITION_TARGET_GLOBAL_INT.

    A message with a position is ignored while the local height of its reference (sea level, home or ground) is unknown.
    As in PX4, the whole position is ignored if the mask ignores one of its coordinates.
    """
    state, m = node.vehicle.state, message
    position = FREE
    if not m.type_mask & 0x7:
        if m.coordinate_frame not in (GLOBAL_INT, GLOBAL_RELATIVE_INT, GLOBAL_TERRAIN_INT):
            node.complain(f"SET_POSITION_TARGET_GLOBAL_INT coordinate frame {m.coordinate_frame} unsupported")
            return
        down = _altitude_to_down(node, m.coordinate_frame, m.alt)
        if down is None:
            return
        north, east, _ = geodetic_to_ned(
            state.origin_lat_deg, state.origin_lon_deg, state.origin_alt_m, m.lat_int * 1e-7, m.lon_int * 1e-7, 0.0
        )
        position = (north, east, down)
    _take(node, m, LOCAL_NED, position)


def _altitude_to_down(node: Node, frame: int, altitude: float) -> float | None:
    """Return local z (m) of an altitude in MAV_FRAME 5 (sea level), 6 (home) or 11 (ground); None if unknown."""
    state, home = node.vehicle.state, node.vehicle.commander.flight.home
    if not state.origin_set:
        return None
    if frame == GLOBAL_INT:
        return state.origin_alt_m - altitude
    if frame == GLOBAL_RELATIVE_INT and home is not None:
        return home.position_ned[2] - altitude
    clearance = state.range_m()
    if frame == GLOBAL_TERRAIN_INT and math.isfinite(clearance):
        return state.position_ned[2] + clearance - altitude
    return None


def attitude_target(node: Node, port: Port, message: Message) -> None:
    """Handle SET_ATTITUDE_TARGET: take the attitude if mask bit 7 is 0, else the body rates if bits 0 and 1 are 0."""
    m, mask = message, message.type_mask
    yaw_rate = m.body_yaw_rate if not mask & 0x4 and abs(m.body_yaw_rate) < LIMIT else 0.0
    if mask & 0x40 or not math.isfinite(m.thrust):
        node.complain("SET_ATTITUDE_TARGET invalid: no thrust")
        return
    thrust = min(max(m.thrust, 0.0), 1.0)
    if not mask & 0x80:
        q = tuple(m.q)
        norm = math.sqrt(sum(x * x for x in q)) if all(abs(x) < 10.0 for x in q) else NAN
        if not norm > 0.5:  # zeros and nan are no attitude
            node.complain("SET_ATTITUDE_TARGET invalid: attitude")
            return
        _accept(
            node, CascadeSetpoint(kind=KIND_ATTITUDE, attitude=quat_normalized(q), yaw_rate=yaw_rate, thrust=thrust)
        )
    elif not mask & 0x3 and abs(m.body_roll_rate) < LIMIT and abs(m.body_pitch_rate) < LIMIT:
        rates = (m.body_roll_rate, m.body_pitch_rate, yaw_rate)
        _accept(node, CascadeSetpoint(kind=KIND_RATES, rates_frd=rates, thrust=thrust))
    else:
        node.complain("SET_ATTITUDE_TARGET invalid: nothing controlled")


POSITION, VELOCITY = 1, 2  # bits of est_capabilities
FASTEST = 100.0  # m/s; a larger component of a target's velocity counts as 0


def follow_target(node: Node, port: Port, message: Message) -> None:
    """Store the target's position and velocity, and the time at which the message arrived.

    A message is ignored if it has no position, or while the local frame's origin is unknown.
    """
    state, target = node.vehicle.state, node.vehicle.commander.flight.target
    # some clients leave the capabilities at 0 but do send a position
    placed = message.est_capabilities == 0 or message.est_capabilities & POSITION
    if not state.origin_set or not placed or abs(message.lat) > 90e7 or abs(message.lon) > 180e7:
        return
    north, east, down = geodetic_to_ned(
        state.origin_lat_deg, state.origin_lon_deg, state.origin_alt_m, message.lat * 1e-7, message.lon * 1e-7,
        message.alt,
    )  # fmt: skip
    vn, ve, vd = (float(v) if abs(v) < FASTEST else 0.0 for v in message.vel)
    if message.est_capabilities and not message.est_capabilities & VELOCITY:
        vn = ve = vd = 0.0
    target.time_us = node.time_us
    target.position_ned = (north, east, down if abs(down) < 1e5 else math.nan)
    target.velocity_ned = (vn, ve, vd)


def _axis(value: int) -> float:
    return value / 1000.0 if abs(value) <= 1000 else 0.0  # a larger value, such as INT16_MAX, means: axis not sent


def manual_control(node: Node, port: Port, message: Message) -> None:
    """Store the sticks and the time at which the message arrived."""
    if message.target not in (0, node.system_id):
        return
    sticks = node.vehicle.commander.flight.sticks
    sticks.time_us = node.time_us
    sticks.forward, sticks.right, sticks.yaw = _axis(message.x), _axis(message.y), _axis(message.r)
    sticks.throttle = message.z / 1000.0 if 0 <= message.z <= 1000 else 0.5  # axis not sent: hold the height
