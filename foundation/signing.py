"""MAVLink 2 message signing at one end of a link. Once a key is set, unsigned messages are rejected.

Source: mavlink.io, guide/message_signing. A signature consists of the link id, a timestamp and the first 48
bits of SHA-256(key, message, link id, timestamp). This module replaces pymavlink's own check, which stores a message's
timestamp before it verifies the signature. There, one forged message with a late timestamp locks out the true sender.
"""

import hashlib
import hmac
import struct
from pathlib import Path

from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.mavlink import dialect

KEY_BYTES = 32
SIGNED = dialect.MAVLINK_IFLAG_SIGNED
UNITS_PER_MINUTE = 6_000_000  # a timestamp has units of 10 µs
LATEST = (1 << 48) - 1  # largest timestamp
UNSIGNED_MESSAGES = frozenset({"RADIO_STATUS"})  # accepted without a signature, because radio modems have no key
EPOCH_S = 1_420_070_400  # s of Unix time, 2015-01-01


def load_key(path: Path) -> bytes:
    """Return the key in a file of 32 bytes or 64 hexadecimal digits. Raises UsageError."""
    with file_errors_as(UsageError, f"--sign {path} cannot be read", ". Give a file with a key"):
        data = path.read_bytes()
    digits = data.strip()
    if len(digits) == 2 * KEY_BYTES:
        try:
            data = bytes.fromhex(digits.decode("ascii"))
        except ValueError:  # the error's text contains the key, so it is not shown
            data = b""
    if len(data) != KEY_BYTES or not any(data):
        raise UsageError(
            f"--sign {path} is not a key: it must have 64 hexadecimal digits or 32 bytes, not all zero. Make one"
            f" with `openssl rand -hex 32 > {path}`"
        )
    return data


def timestamp(unix_s: float) -> int:
    """Return a Unix time (s) as a signature's timestamp, in units of 10 µs since 2015-01-01."""
    return max(0, round((unix_s - EPOCH_S) * 1e5))


def is_signed(frame: bytes) -> bool:
    """Return whether a message has a signature, valid or not.

    A signature made with a key of 32 zero bytes does not count: PX4 1.17 signs like this while it has no key.
    """
    return (
        frame[0] == dialect.PROTOCOL_MARKER_V2
        and bool(frame[2] & SIGNED)
        and _digest(bytes(KEY_BYTES), frame[:-6]) != frame[-6:]
    )


def _digest(key: bytes, data: bytes) -> bytes:
    return hashlib.sha256(key + data).digest()[:6]


class Signing:
    """Signs the messages of a port and verifies received ones, once a key is set."""

    def __init__(self, link: int) -> None:
        self.rejected = 0  # messages without a valid signature
        self.unsigned = 0  # rejected messages without any signature
        self.believed = 0  # messages with a valid signature
        self._link = link & 0xFF
        self._key = b""
        self._time = 0  # newest timestamp, sent or accepted
        self._set_us = 0  # µs, the caller's `now_us` when `_time` was set
        self._newest_times: dict[tuple[int, int, int], int] = {}  # system, component, link → newest timestamp

    @property
    def active(self) -> bool:
        """True when a key is set."""
        return bool(self._key)

    def set_up(self, key: bytes, timestamp: int, now_us: int) -> None:
        """Set a key of 32 bytes and the time (units of 10 µs since 2015-01-01). A key of zeros ends the signing."""
        self._key = key if any(key) else b""
        self._time, self._set_us = min(timestamp, LATEST), now_us
        self._newest_times.clear()

    def accepts(self, message: dialect.MAVLink_message, now_us: int) -> bool:
        """Return whether the receiver may act on a message, and count the result.

        Without a key, every message is accepted and none is counted. UNSIGNED_MESSAGES are always treated like this.
        """
        if not self._key or message.get_type() in UNSIGNED_MESSAGES:
            return True
        frame = bytes(message.get_msgbuf())
        signed = is_signed(frame)
        good = signed and self._believes(frame, now_us)
        self.rejected += not good
        self.unsigned += not signed
        self.believed += good
        return good

    def _believes(self, frame: bytes, now_us: int) -> bool:
        if not hmac.compare_digest(_digest(self._key, frame[:-6]), frame[-6:]):
            return False
        timestamp = int.from_bytes(frame[-12:-6], "little")
        speaker = (frame[5], frame[6], frame[-13])
        now = self._now(now_us)
        # against replays: a sender's first message may be at most a minute old, and its timestamps must increase
        if timestamp <= self._newest_times.get(speaker, now - UNITS_PER_MINUTE):
            return False
        self._newest_times[speaker] = timestamp
        if timestamp > now:
            self._time, self._set_us = timestamp, now_us
        return True

    def sign(self, frame: bytes, crc_extra: int, now_us: int) -> bytes:
        """Return a MAVLink 2 frame with its signature. Without a key, return the frame unchanged."""
        if not self._key:
            return frame
        self._time, self._set_us = min(max(self._now(now_us), self._time + 1), LATEST), now_us
        body = bytearray(frame[:-2])
        body[2] |= SIGNED
        checksum = dialect.x25crc(bytes(body[1:]) + bytes([crc_extra]))
        body += struct.pack("<HB", checksum.crc, self._link) + self._time.to_bytes(6, "little")
        return bytes(body) + _digest(self._key, bytes(body))

    def _now(self, now_us: int) -> int:
        return self._time + max(now_us - self._set_us, 0) // 10
