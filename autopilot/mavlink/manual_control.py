"""MANUAL_CONTROL: joystick axes from a ground station."""

from autopilot.mavlink.node import Node
from autopilot.mavlink.port import Port
from autopilot.mavlink.telemetry_source import Message


def _axis(value: int) -> float:
    return max(-1.0, min(1.0, value / 1000.0)) if value != 32767 else 0.0  # INT16_MAX: axis not fitted


def manual_control(node: Node, port: Port, message: Message) -> None:
    """Keep the sticks with the time of their arrival."""
    if message.target not in (0, node.system_id):
        return
    sticks = node.vehicle.commander.flight.sticks
    sticks.time_us = node.time_us
    sticks.forward, sticks.right, sticks.yaw = _axis(message.x), _axis(message.y), _axis(message.r)
    sticks.throttle = max(0.0, _axis(message.z))
