"""Reads and sets parameters of the autopilot at the other end of a link.

PX4 puts the bytes of an INT32 into the float field (capability PARAM_ENCODE_BYTEWISE). For an unknown name, newer
versions of PX4 and our autopilot answer PARAM_ERROR; older versions do not answer. In both cases `read` returns None.
"""

import struct
from collections.abc import Iterable

from foundation.errors import LinkError, UsageError
from foundation.mavlink import dialect, first_field
from hil.link.link import Link

Value = int | float

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32
NAME_MOST = 16  # characters
TRIES = 6  # if a link loses one message in ten, one try in five fails, but six in a row are rare
RETRY_US = 500_000  # µs of vehicle time to wait for answers in one try
AT_ONCE = 4  # requests per tick of the link, 80 a second: 3 kB/s, which a telemetry radio carries
ERRORS = {
    1: "there is no such parameter", 2: "the value is out of its range", 3: "permission denied",
    4: "component not found", 5: "it is read-only",
}  # fmt: skip


class Parameters:
    """The parameters of one autopilot. Calls wait in vehicle time and raise LinkError when the vehicle is gone."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._values: dict[str, Value] = {}  # answers to the call in progress
        self._types: dict[str, int] = {}  # name -> MAV_PARAM_TYPE
        self._errors: dict[str, int] = {}  # name -> MAV_PARAM_ERROR

    def read(self, name: str) -> Value | None:
        """Return the value, None when the autopilot does not know the name or does not answer."""
        return self.read_many([name])[name]

    def read_many(self, names: Iterable[str]) -> dict[str, Value | None]:
        """Return name → value in the order of `names`, None for a name that is unknown or gets no answer."""
        wanted = list(dict.fromkeys(names))
        for name in wanted:
            _checked(name)
        self._forget(wanted)
        with self._link.listening(self._take):
            for _ in range(TRIES):
                missing = [name for name in wanted if not self._answered(name)]
                if not missing:
                    break
                self._request(missing)
        return {name: self._values.get(name) for name in wanted}

    def set(self, name: str, value: Value) -> Value:
        """Set a parameter and return the value that the autopilot holds afterwards, read back.

        Raises LinkError if the autopilot does not know the name, refuses, or holds another value;
        UsageError for a value that the parameter's type cannot hold.
        """
        if self.read(name) is None:
            raise LinkError(f"the autopilot has no parameter {name}")
        message, wanted = self._setting(name, value)
        held: Value | None = None
        for _ in range(TRIES):  # repeated, because the value read back may be a late answer to an earlier request
            self._send_setting(name, message)
            if name in self._errors:
                reason = ERRORS.get(self._errors[name], f"error {self._errors[name]}")
                raise LinkError(f"the autopilot does not set {name} to {value:g}: {reason}")
            held = self.read(name)
            if held == wanted:
                return held
        if held is None:
            raise LinkError(f"the autopilot did not confirm {name} = {value:g}")
        raise LinkError(f"the autopilot has {name} = {held:g} although {value:g} was set")

    def _send_setting(self, name: str, message: dialect.MAVLink_message) -> None:
        """Send a PARAM_SET and wait for its answer, for RETRY_US at most."""
        self._forget([name])
        with self._link.listening(self._take):
            self._link.send(message)
            self._wait([name])

    def _setting(self, name: str, value: Value) -> tuple[dialect.MAVLink_message, Value]:
        """Return the PARAM_SET and the value as the parameter's type holds it."""
        kind = self._types[name]
        wanted: Value
        if kind == INT32:
            if value != int(value) or not -(1 << 31) <= value < 1 << 31:
                raise UsageError(f"{name} must be a 32-bit integer, got {value:g}")
            wanted = int(value)
            field = struct.unpack("<f", struct.pack("<i", wanted))[0]
            if struct.unpack("<i", struct.pack("<f", field))[0] != wanted:
                raise UsageError(f"{name} = {wanted} cannot be sent, because its bits as a float are a signalling NaN")
        elif kind == REAL32:
            try:
                field = wanted = struct.unpack("<f", struct.pack("<f", value))[0]
            except OverflowError:
                raise UsageError(f"{name} must be a 32-bit float, got {value:g}") from None
        else:
            raise LinkError(f"{name} has MAV_PARAM_TYPE {kind}, which PX4 does not use")
        link = self._link
        return dialect.MAVLink_param_set_message(link.system, link.component, name.encode(), field, kind), wanted

    def _request(self, names: list[str]) -> None:
        """Ask for every name once, a few per tick, and wait for the answers."""
        link = self._link
        for start in range(0, len(names), AT_ONCE):
            for name in names[start : start + AT_ONCE]:
                link.send(dialect.MAVLink_param_request_read_message(link.system, link.component, name.encode(), -1))
            link.tick()
        self._wait(names)

    def _wait(self, names: list[str]) -> None:
        """Tick until all are answered, for RETRY_US at most."""
        end_us = self._link.time_us + RETRY_US
        while not all(self._answered(name) for name in names) and self._link.time_us < end_us:
            self._link.tick()

    def _answered(self, name: str) -> bool:
        return name in self._values or name in self._errors

    def _forget(self, names: list[str]) -> None:
        for name in names:
            self._values.pop(name, None)
            self._errors.pop(name, None)

    def _take(self, message: dialect.MAVLink_message) -> None:
        kind = message.get_msgId()
        if kind not in (dialect.MAVLINK_MSG_ID_PARAM_VALUE, dialect.MAVLINK_MSG_ID_PARAM_ERROR):
            return
        if (message.get_srcSystem(), message.get_srcComponent()) != (self._link.system, self._link.component):
            return
        name = str(message.param_id)
        if kind == dialect.MAVLINK_MSG_ID_PARAM_ERROR:
            self._errors[name] = int(message.error)
        else:
            self._values[name] = decoded(message)
            self._types[name] = int(message.param_type)


def decoded(message: dialect.MAVLink_message) -> Value:
    """Return the value of a received PARAM_VALUE. An INT32 is read from the frame's bytes."""
    if message.param_type == REAL32:
        return float(message.param_value)
    return int(struct.unpack("<i", first_field(message))[0])


def _checked(name: str) -> None:
    if not name or len(name) > NAME_MOST or not name.isascii():
        raise UsageError(f"{name!r} is not a parameter: a name has 1 to {NAME_MOST} ASCII characters")
