"""The simulator's MAVLink ports on UDP, in PX4's convention: it speaks first, to a known place."""

import contextlib
import socket
from collections.abc import Callable

from hil.link.transport import BUFFER_BYTES, bind_error

SocketAddress = tuple[str, int]
MAVLINK_2 = 0xFD  # first byte of a frame


class UdpPort:
    """One local socket. Sends to its default remote and to everyone who has spoken to it."""

    def __init__(
        self,
        local: SocketAddress,
        remote: SocketAddress | None,
        take: Callable[[], bytes],
        give: Callable[[bytes], None],
        *,
        shared: bool = False,
    ) -> None:
        """`shared`: what one peer says goes to the others too, as on a bus."""
        self._shared = shared
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        try:
            self._socket.bind(local)
        except OSError as error:
            self._socket.close()
            raise bind_error(error, "UDP", *local, instead="choose another --instance") from None
        self._socket.setblocking(False)
        self._peers: list[SocketAddress] = [remote] if remote else []
        self._take, self._give = take, give

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def exchange(self) -> None:
        """Read what has come and send what there is to say."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(256):
                try:
                    data, peer = self._socket.recvfrom(65536)
                except ConnectionRefusedError:
                    continue  # nobody listens at the default remote yet
                if peer not in self._peers:
                    self._peers.append(peer)
                self._give(data)
                if self._shared:
                    self._send(data, but=peer)
        self._send(self._take())

    def _send(self, data: bytes, but: SocketAddress | None = None) -> None:
        for packet in packets(data):
            for peer in self._peers:
                if peer != but:
                    with contextlib.suppress(OSError):  # full buffers and absent listeners: UDP loses, that is its way
                        self._socket.sendto(packet, peer)

    def close(self) -> None:
        self._socket.close()


def packets(data: bytes, size: int = 1400) -> list[bytes]:
    """Return MAVLink 2 bytes cut between messages into datagrams of at most about `size` bytes."""
    cut, at, start = [], 0, 0
    while at + 2 < len(data) and data[at] == MAVLINK_2:  # anything else goes out as it is, in one piece
        length = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        if at + length - start > size and at > start:
            cut.append(data[start:at])
            start = at
        at += length
    if start < len(data):
        cut.append(data[start:])
    return cut
