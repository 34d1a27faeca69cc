"""A wire that is opened again when it breaks: a pulled cable, a bridge that restarts."""

import contextlib
import time
from collections.abc import Callable

from foundation.errors import DronecatsError, LinkError
from hil.link.transport import Transport

RETRY_S = 0.5  # wall seconds between two attempts


class Reopening(Transport):
    """A transport around a transport. While it is broken it receives nothing and what is sent is lost.

    How long that may last is not decided here: `Conversation` raises when the vehicle has been silent for too long.
    """

    def __init__(self, open_transport: Callable[[], Transport]) -> None:
        """Open it for the first time. Raises UsageError and LinkError as `open_transport` does."""
        self._open = open_transport
        self._transport: Transport | None = open_transport()
        self.url = self._transport.url
        self.reopened = 0  # how often it has come back
        self._retry_s = 0.0

    def follow(self, peer: str) -> None:
        if self._transport is not None:
            self._transport.follow(peer)

    def receive(self, timeout_s: float) -> bytes:
        if self._transport is None and not self._reopen(timeout_s):
            return b""
        try:
            assert self._transport is not None
            data = self._transport.receive(timeout_s)
            self.peer = self._transport.peer
            return data
        except LinkError:
            self._break()
            return b""

    def send(self, data: bytes) -> None:
        if self._transport is not None:
            try:
                self._transport.send(data)
            except LinkError:
                self._break()

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def _break(self) -> None:
        if self._transport is not None:
            with contextlib.suppress(DronecatsError, OSError):
                self._transport.close()
        self._transport, self._retry_s = None, time.monotonic()

    def _reopen(self, timeout_s: float) -> bool:
        """Try again when it is time to; wait for that at most `timeout_s`."""
        left_s = self._retry_s + RETRY_S - time.monotonic()
        if left_s > timeout_s:
            time.sleep(timeout_s)
            return False
        time.sleep(max(0.0, left_s))
        self._retry_s = time.monotonic()
        try:
            self._transport = self._open()
        except DronecatsError:  # a device that is not back yet, a server that does not listen yet
            return False
        self.reopened += 1
        return True
