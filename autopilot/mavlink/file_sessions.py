"""The files that clients of MAVLink FTP hold open, and the last answer to each, in case it was lost."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import BinaryIO

from autopilot.mavlink.file_tree import INVALID_SESSION, NO_SESSIONS, Refusal

MOST = 16
IDLE_US = 30_000_000  # a session unused for so long makes room for another
REMEMBERED = 32  # clients

Client = Hashable  # a port and the sender's ids


@dataclass(slots=True)
class FileSession:
    """An open file of one client."""

    file: BinaryIO
    writable: bool
    used_us: int


class FileSessions:
    """Sessions by client and number."""

    def __init__(self) -> None:
        self._open: dict[tuple[Client, int], FileSession] = {}
        self._answers: dict[Client, tuple[bytes, bytes]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def make_room(self, now_us: int) -> None:
        """Make sure that another session can be opened. Raises Refusal."""
        if len(self._open) < MOST:
            return
        key, oldest = min(self._open.items(), key=lambda item: item[1].used_us)
        if now_us - oldest.used_us < IDLE_US:
            raise Refusal(NO_SESSIONS)
        self._close(key)

    def open(self, client: Client, wish: int, file: BinaryIO, writable: bool, now_us: int) -> int:
        """Keep a file open and return the number of its session: the one the client wishes, if it is free."""
        number = wish
        while (client, number) in self._open:
            number = (number + 1) % 256
        self._open[client, number] = FileSession(file, writable, now_us)
        return number

    def get(self, client: Client, number: int, now_us: int) -> FileSession:
        """Return an open session. Raises Refusal when the client has no such session."""
        session = self._open.get((client, number))
        if session is None:
            raise Refusal(INVALID_SESSION)
        session.used_us = now_us
        return session

    def close(self, client: Client, number: int) -> None:
        """End one session. Raises Refusal when the client has no such session."""
        if (client, number) not in self._open:
            raise Refusal(INVALID_SESSION)
        self._close((client, number))

    def reset(self, client: Client) -> None:
        """End all sessions of a client."""
        for key in [key for key in self._open if key[0] == client]:
            self._close(key)

    def answered(self, client: Client, request: bytes) -> bytes | None:
        """Return the answer already given, when a client repeats its last request."""
        last, answer = self._answers.get(client, (b"", b""))
        return answer if last == request else None

    def remember(self, client: Client, request: bytes, answer: bytes) -> None:
        """Keep the answer to a client's last request."""
        self._answers.pop(client, None)
        self._answers[client] = (request, answer)
        if len(self._answers) > REMEMBERED:
            del self._answers[next(iter(self._answers))]

    def _close(self, key: tuple[Client, int]) -> None:
        self._open.pop(key).file.close()
