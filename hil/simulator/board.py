"""The wire to an autopilot board in PX4's hardware-in-the-loop mode: the simulator's messages share it with all others.

There is no lockstep here: the board stamps what arrives with its own clock. It decodes HIL messages only while it says
in its heartbeat that it is in HIL mode (SYS_HITL), and it would take HIL_STATE_QUATERNION for its estimate, so that is
never sent. Source: PX4 mavlink_receiver.cpp.
"""

import contextlib
import time
from collections.abc import Callable

from foundation.errors import LinkError, UsageError
from foundation.mavlink import Packer, Parser, dialect
from hil.link.transport import Transport
from hil.simulator.interface import HIL_ENABLED, SENSOR_BYTES

RATE_MAX_HZ, RATE_LEAST_HZ = 250, 200  # of HIL_SENSOR; a rate controller on less does not hold the vehicle
BITS_PER_BYTE = 10  # start and stop bit included
SHARE = 0.5  # of the wire for HIL_SENSOR; commands and parameters of the clients need the rest
HEARTBEAT_S = 1.0  # wall seconds
REOPEN_S = 1.0  # wall seconds between two attempts at a cable that was pulled
FORGET_S = 3.0  # wall seconds without a heartbeat after which the board counts as gone, as MAVSDK has it
ACTUATORS, HEARTBEAT = dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS, dialect.MAVLINK_MSG_ID_HEARTBEAT
MAVLINK_1, MAVLINK_2 = 0xFE, 0xFD  # first byte of a frame
HELLO = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_GENERIC, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)


def sensor_period_us(url: str) -> int:
    """Return the time (µs, whole milliseconds) between two HIL_SENSOR that a wire carries; 4 ms on any but a slow line.

    Raises UsageError for a serial line that is too slow.
    """
    baud = url.rpartition(":")[2]
    if not url.startswith("serial://") or not baud.isdigit():
        return 1_000_000 // RATE_MAX_HZ
    carried_hz = SHARE * int(baud) / BITS_PER_BYTE / SENSOR_BYTES
    if carried_hz < RATE_LEAST_HZ:
        raise UsageError(
            f"--hitl {url}: {baud} baud carry {carried_hz:.0f} sensor messages a second beside the other traffic, and "
            f"flying needs {RATE_LEAST_HZ}; use USB, or 460800 baud or more on both ends"
        )
    return -(-1_000 // min(RATE_MAX_HZ, int(carried_hz))) * 1_000


class BoardLine:
    """One board at the end of a wire, which may be pulled and put back."""

    def __init__(self, connect: Callable[[], Transport], packer: Packer) -> None:
        """`connect` opens the wire, now and after it broke. Raises what it raises, but only now."""
        self._connect, self._packer = connect, packer
        self._transport: Transport | None = connect()
        self._parser = Parser()
        self._rest = b""  # the beginning of a frame whose end has not come yet
        self._clients = bytearray()  # what they have not yet been sent
        self._hello_due_s = self._reopen_due_s = 0.0
        self._heard_s = -FORGET_S  # when the autopilot's last heartbeat came
        self._hil = False
        self.actuators: dialect.MAVLink_message | None = None  # the newest HIL_ACTUATOR_CONTROLS
        self.actuators_s = 0.0  # wall time at which it came

    @property
    def present(self) -> bool:
        """Whether the autopilot's heartbeat is heard."""
        return self._transport is not None and time.monotonic() - self._heard_s < FORGET_S

    @property
    def in_hil(self) -> bool:
        """Whether the board says that it takes simulated sensors."""
        return self.present and self._hil

    def exchange(self) -> None:
        """Take in what has come, say hello when it is due, and open a wire again that broke."""
        now_s = time.monotonic()  # the board runs on wall time
        if self._transport is None and now_s >= self._reopen_due_s:
            self._reopen_due_s = now_s + REOPEN_S
            with contextlib.suppress(LinkError):
                self._transport, self._rest = self._connect(), b""
        if now_s >= self._hello_due_s:
            self._hello_due_s = now_s + HEARTBEAT_S
            self.send(HELLO)
        data = b""
        if self._transport is not None:
            try:
                data = self._transport.receive(0.0)
            except LinkError:
                self._lose()
        frames, self._rest = split(self._rest + data)
        for frame in frames:
            self._take(frame, now_s)

    def send(self, *messages: dialect.MAVLink_message) -> None:
        """Send messages of the simulator's."""
        self.give(b"".join(self._packer.pack(message) for message in messages))

    def give(self, data: bytes) -> None:
        """Send what a client says, as it is."""
        if self._transport is not None and data:
            try:
                self._transport.send(data)
            except (LinkError, OSError):
                self._lose()

    def take(self) -> bytes:
        """Return what the board has said to the clients since the last call: everything but the motor outputs."""
        data = bytes(self._clients)
        self._clients.clear()
        return data

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def _take(self, frame: bytes, now_s: float) -> None:
        kind = frame[7] | frame[8] << 8 | frame[9] << 16 if frame[0] == MAVLINK_2 else frame[5]
        if kind != ACTUATORS:
            self._clients += frame
        for message in self._parser.feed(frame) if kind in (ACTUATORS, HEARTBEAT) else ():
            if kind == ACTUATORS:
                self.actuators, self.actuators_s = message, now_s
            elif message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1:
                self._heard_s, self._hil = now_s, bool(message.base_mode & HIL_ENABLED)

    def _lose(self) -> None:
        if self._transport is not None:
            self._transport.close()
        self._transport, self._hil = None, False


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """Return the MAVLink frames in a stretch of a wire, unknown messages too, and the beginning of one that goes on."""
    frames, at = [], 0
    while at < len(data):
        if data[at] not in (MAVLINK_1, MAVLINK_2):
            at += 1  # noise, or a boot loader's chatter
            continue
        if len(data) - at < 10:
            break
        length = 8 + data[at + 1]
        if data[at] == MAVLINK_2:
            length += 4 + (13 if data[at + 2] & 1 else 0)  # longer header; a signature
        if len(data) - at < length:
            break
        frames.append(data[at : at + length])
        at += length
    return frames, data[at:]
