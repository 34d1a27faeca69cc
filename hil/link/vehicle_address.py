"""The address that the vehicle speaks from: a UDP port hears everybody, and only one of them is the vehicle."""

import math
from collections.abc import Callable

from foundation.mavlink import Parser, dialect
from hil.link.transport import Transport

REPLACED_S = 3.0  # s of the transport's clock without the vehicle, after which another address may take its place
NOTICE_S = 10.0  # s between two notices of ignored messages


class VehicleAddress:
    """Parses what arrives, separately for the vehicle and for others, and tells which messages are the vehicle's.

    The address of the vehicle's first heartbeat is held. Another address that uses the vehicle's ids is ignored until
    the held one has been silent for REPLACED_S: a bridge that restarts comes back with another port.
    """

    def __init__(self, transport: Transport, notice: Callable[[str], None]) -> None:
        """`notice` receives a line for the user when another address speaks with the vehicle's ids."""
        self._transport, self._notice = transport, notice
        self._held: str | None = None
        self._parser = Parser()  # of the held address
        self._other: str | None = None  # the last address that spoke and is not held
        self._other_parser = Parser()
        self._heard_s = 0.0  # when the held address last spoke
        self._noticed_s = -math.inf

    def messages(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Return the messages that are completed by what the transport has just received."""
        peer = self._transport.peer
        if peer == self._held:
            return self._parser.feed(data)
        if peer != self._other:
            self._other, self._other_parser = peer, Parser()
        return self._other_parser.feed(data)

    def hold(self) -> None:
        """Take the address of what was just received for the vehicle's."""
        self._held, self._heard_s = self._transport.peer, self._transport.time_s()
        self._parser, self._other, self._other_parser = self._other_parser, None, Parser()
        self._transport.follow(self._held)

    def admits(self) -> bool:
        """Return whether a message with the vehicle's ids that was just received may be the vehicle's."""
        peer, now_s = self._transport.peer, self._transport.time_s()
        if peer != self._held:
            silent_s = now_s - self._heard_s
            if silent_s < REPLACED_S:
                if now_s >= self._noticed_s + NOTICE_S:
                    self._noticed_s = now_s
                    self._notice(f"{peer} sends messages with the id of the vehicle at {self._held}; ignored")
                return False
            self._notice(f"the vehicle now speaks from {peer}; {self._held} has been silent for {silent_s:.1f} s")
            self.hold()
        self._heard_s = now_s
        return True
