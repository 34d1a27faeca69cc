"""Messages on demand: one now (REQUEST_MESSAGE) or another interval (SET_MESSAGE_INTERVAL)."""

import math
from collections.abc import Sequence

from autopilot.mavlink.port import Port
from autopilot.mavlink.status_makers import standard_mode
from autopilot.mavlink.streams import BY_ID, BY_NAME
from foundation.mavlink import dialect
from foundation.px4 import MODES

ACCEPTED, DENIED, FAILED = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_FAILED
BROADCAST = frozenset({dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES})
LISTED_MODES = tuple(mode for name, mode in MODES.items() if name not in ("READY", "TERMINATION"))


def _message_id(parameters: Sequence[float]) -> int:
    return round(parameters[0]) if abs(parameters[0]) < 1e8 else -1


def set_message_interval(port: Port, p: Sequence[float]) -> int:
    """param1 the message, param2 the interval in µs (0 default, -1 off). Returns FAILED for an unknown message."""
    message_id = _message_id(p)
    if message_id not in BY_ID:
        return int(FAILED)
    interval = round(p[1]) if abs(p[1]) < 1e10 else 0
    if interval == 0:
        port.set_default_interval(message_id)
    else:
        port.set_interval(message_id, interval)
    return int(ACCEPTED)


def get_message_interval(port: Port, p: Sequence[float]) -> int:
    """Sends MESSAGE_INTERVAL: µs, -1 not streamed, 0 unknown message."""
    message_id = _message_id(p)
    interval = port.interval_us(message_id) if message_id in BY_ID else 0
    port.send(dialect.MAVLink_message_interval_message(message_id & 0xFFFF, min(interval, 0x7FFFFFFF)))
    return int(ACCEPTED)


def request_message(port: Port, p: Sequence[float]) -> int:
    """param1 the message. Returns DENIED for an unknown one."""
    message_id = _message_id(p)
    if message_id == dialect.MAVLINK_MSG_ID_AVAILABLE_MODES:
        _send_modes(port, p[1])
    elif message_id in BY_ID:
        port.send_telemetry(message_id)
    else:
        return int(DENIED)
    return int(ACCEPTED)


def send_one(port: Port, name: str) -> int:
    """Send one message of the stream table."""
    port.send_telemetry(BY_NAME[name].message_id)
    return int(ACCEPTED)


def _send_modes(port: Port, index: float) -> None:
    """Send AVAILABLE_MODES: all for index 0, else the one with that index (from 1)."""
    wanted = round(index) if math.isfinite(index) and abs(index) < 1e6 else 0
    for i, mode in enumerate(LISTED_MODES, start=1):
        if wanted in (0, i):
            properties = 2 if mode.name in ("ORBIT", "PRECLAND") else 0  # MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
            port.send(
                dialect.MAVLink_available_modes_message(
                    len(LISTED_MODES), i, standard_mode(mode.name), mode.custom_mode, properties, mode.name.encode()
                )
            )
