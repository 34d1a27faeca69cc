"""FOLLOW_TARGET: where the target of the FOLLOW mode is."""

import math

from autopilot.mavlink.node import Node
from autopilot.mavlink.port import Port
from autopilot.mavlink.telemetry_source import Message
from foundation.frames import geodetic_to_ned

POSITION, VELOCITY = 1, 2  # bits of est_capabilities
FASTEST = 100.0  # m/s, a target that claims more is not believed


def follow_target(node: Node, port: Port, message: Message) -> None:
    """Keep the target's place with the time of its arrival; one without a place is ignored."""
    state, target = node.vehicle.state, node.vehicle.commander.flight.target
    # clients leave the capabilities at 0 and send a place all the same
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
