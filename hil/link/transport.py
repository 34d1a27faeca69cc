"""Byte pipes to an autopilot, opened by URL: UDP, TCP and serial. MAVSDK's URL forms work too."""

import contextlib
import select
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol
from urllib.parse import urlsplit

from foundation import extras
from foundation.errors import DronecatsError, LinkError, UsageError
from foundation.machine import is_host, port_holder

FORMS = "udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT, tcpin://HOST:PORT or serial://DEVICE:BAUD"
BITS_PER_BYTE = 10  # of a serial line, 8N1: a start bit, eight data bits, a stop bit
BAUD = 57_600  # default rate of a serial line, as in MAVSDK and for PX4's TELEM1
SEND_S = 5.0  # wall seconds after which a TCP client that no longer reads is dropped
PEER_S = 3.0  # wall seconds; nothing is sent to an address that is silent for longer
BUFFER_BYTES = 4 * 1024 * 1024  # receive buffer: a renderer that is busy for 100 ms must not lose telemetry


class Transport(Protocol):
    """Receives and sends bytes. The default methods are for a link with only one other end."""

    url: str
    peer: str = ""  # source address of the last `receive`; "": there is only one other end

    def time_s(self) -> float:
        """Return the time (s) of the clock that measures silence: the wall clock, or in lockstep the vehicle's."""
        return time.monotonic()

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes from one address; b'' if none arrived within `timeout_s` (s). Raises LinkError.

        Real links measure the time-out by the wall clock; links in lockstep measure it by `time_s`.
        """
        ...

    def send(self, data: bytes) -> None: ...

    def follow(self, peer: str) -> None:
        """Send only to this address from now on. Does nothing if there is only one other end."""
        return None

    def close(self) -> None: ...


class UdpTransport(Transport):
    """A UDP socket that listens (`udpin`) or sends first (`udpout`).

    Until `follow` names one address, it sends to the last sender and to all addresses that have sent within PEER_S. So
    two vehicles that send to one port both get every message. The target ids in the message name the receiver. One
    thread may receive while others send.
    """

    def __init__(self, url: str, host: str, port: int, *, listen: bool) -> None:
        self.url = url
        family = _family(host)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._peers: dict[Any, float] = {}  # address -> wall clock when it last sent, the newest last
        self._followed: Any = None  # the only receiver; None: no address is followed
        self._waiting: tuple[bytes, Any] | None = None  # a datagram from another address, for the next `receive`
        self._lock = threading.Lock()  # for `_peers`: a camera's server threads send while its main thread receives
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._socket.bind(("127.0.0.1" if host.startswith("127.") else "", 0))
                self._peers[(socket.gethostbyname(host) if family == socket.AF_INET else host, port)] = 0.0
        except OSError as error:
            self._socket.close()
            raise bind_error(error, "UDP", host, port) from None
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The local port, useful if port 0 was requested."""
        return int(self._socket.getsockname()[1])

    def receive(self, timeout_s: float) -> bytes:
        if self._waiting is None and not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        datagrams: list[bytes] = []
        first: Any = None
        # an ICMP refusal of an earlier send raises OSError here: the peer is not up yet, so there is no data
        with contextlib.suppress(OSError):
            while len(datagrams) < 256:
                data, address = self._waiting or self._socket.recvfrom(65536)
                self._waiting = None
                if datagrams and address != first:
                    self._waiting = data, address
                    break
                first = address
                datagrams.append(data)
        if datagrams:
            self.peer = _shown(first)
            with self._lock:
                self._peers.pop(first, None)
                self._peers[first] = time.monotonic()
        return b"".join(datagrams)

    def follow(self, peer: str) -> None:
        with self._lock:
            self._followed = next((address for address in self._peers if _shown(address) == peer), self._followed)

    def send(self, data: bytes) -> None:
        with self._lock:
            if len(self._peers) > 1:
                newest, oldest_s = next(reversed(self._peers)), time.monotonic() - PEER_S
                self._peers = {peer: at_s for peer, at_s in self._peers.items() if peer == newest or at_s > oldest_s}
            peers = tuple(self._peers) if self._followed is None else (self._followed,)
        for peer in peers:
            with contextlib.suppress(OSError):  # no network at the moment: the datagram is lost
                self._socket.sendto(data, peer)

    def close(self) -> None:
        self._socket.close()


class TcpTransport(Transport):
    """A TCP client."""

    def __init__(self, url: str, host: str, port: int) -> None:
        self.url = url
        try:
            self._socket = socket.create_connection((host, port), timeout=5.0)
        except OSError as error:
            raise LinkError(f"nothing answers at {url}: {error}") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def receive(self, timeout_s: float) -> bytes:
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        try:
            data = self._socket.recv(65536)
        except OSError as error:
            raise LinkError(f"the connection to {self.url} broke: {error}") from None
        if not data:
            raise LinkError(f"the other side closed the connection to {self.url}")
        return data

    def send(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise LinkError(f"the connection to {self.url} broke: {error}") from None

    def close(self) -> None:
        self._socket.close()


class TcpListener(Transport):
    """A TCP server for one client at a time. A later client replaces an earlier one."""

    def __init__(self, url: str, host: str, port: int, instead: str = "choose another port") -> None:
        """Listen. Port 0: the system chooses a free port.

        Raises UsageError for a port that is in use, with the advice `instead`.
        """
        self.url = url
        self._listening = socket.socket(_family(host), socket.SOCK_STREAM)
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # else the port is blocked after use
        try:
            self._listening.bind((host, port))
            self._listening.listen(1)  # the second of two servers on the same port fails here
        except OSError as error:
            self._listening.close()
            raise bind_error(error, "TCP", host, port, instead) from None
        self._listening.setblocking(False)
        self._client: socket.socket | None = None
        self.connections = 0  # clients accepted so far

    @property
    def port(self) -> int:
        """The local port, useful if port 0 was requested."""
        return int(self._listening.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether a client is connected. A lost connection is noticed at the next `send` or `receive`."""
        return self._client is not None

    def accept(self) -> bool:
        """Accept a waiting client; return whether there was one. Never waits."""
        try:
            client, _ = self._listening.accept()
        except BlockingIOError:
            return False
        self._drop()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.settimeout(SEND_S)
        self._client = client
        self.connections += 1
        return True

    def receive(self, timeout_s: float) -> bytes:
        """Return the client's bytes; b'' if none arrived in time, or if a client has just connected or gone."""
        watched = [self._listening] + ([self._client] if self._client else [])
        ready = select.select(watched, [], [], timeout_s)[0]
        if self._listening in ready:
            self.accept()
            return b""
        return self._read() if ready else b""

    def send(self, data: bytes) -> None:
        """Send to the client, if there is one. A lost connection is closed, but is not an error."""
        if self._client is not None:
            try:
                self._client.sendall(data)
            except OSError:
                self._drop()

    def _read(self) -> bytes:
        """Return the bytes of a client that has data to read; b'' if it has gone."""
        assert self._client is not None
        data = b""
        with contextlib.suppress(OSError):
            data = self._client.recv(65536)
        if not data:
            self._drop()
        return data

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        self._drop()
        self._listening.close()


class SerialTransport(Transport):
    """A serial line, through pyserial (extra `serial`)."""

    def __init__(self, url: str, device: str, baud: int) -> None:
        extras.require("serial")
        import serial

        self.url = url
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=1.0)
        except (OSError, ValueError) as error:
            raise LinkError(f"the serial device {device} cannot be opened: {error}") from None

    def receive(self, timeout_s: float) -> bytes:
        try:
            if not select.select([self._port.fileno()], [], [], timeout_s)[0]:
                return b""
            data = bytes(self._port.read(65536))
        except OSError as error:
            raise LinkError(f"the serial line {self.url} broke: {error}") from None
        if not data:  # readable without bytes: the device was removed
            raise LinkError(f"the serial line {self.url} broke: the device was removed")
        return data

    def send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise LinkError(f"the serial line {self.url} broke: {error}") from None

    def close(self) -> None:
        self._port.close()


class MemoryTransport(Transport):
    """One end of a pipe inside a process. A read of an empty pipe calls `pump`, which advances the other side.

    So the vehicle's time advances only while the reader waits (lockstep).
    """

    def __init__(
        self,
        url: str,
        take: Callable[[], bytes],
        give: Callable[[bytes], None],
        pump: Callable[[], None],
        time_s: Callable[[], float],
    ) -> None:
        """`time_s` reads the clock (s) that `pump` advances."""
        self.url = url
        self._take, self._give, self._pump, self._time_s = take, give, pump, time_s

    def time_s(self) -> float:
        return self._time_s()

    def receive(self, timeout_s: float) -> bytes:
        data = self._take()
        if not data:
            due_s = self._time_s() + timeout_s
            while not data and self._time_s() < due_s:
                self._pump()
                data = self._take()
        return data

    def send(self, data: bytes) -> None:
        self._give(data)

    def close(self) -> None:
        pass


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _shown(address: Any) -> str:
    """Return a socket's address as HOST:PORT."""
    host = f"[{address[0]}]" if ":" in address[0] else address[0]
    return f"{host}:{address[1]}"


def connect(url: str) -> Transport:
    """Return an open transport. Raises UsageError for a malformed URL or a port in use, LinkError if nothing answers.

    MAVSDK's forms work too: udp:// listens, tcpout:// connects, serial:// without a rate takes 57,600 baud.
    """
    scheme, _, rest = url.partition("://")
    if scheme == "serial" and rest:
        device, colon, baud = rest.rpartition(":")
        if not colon:
            return SerialTransport(url, rest, BAUD)
        if device and baud.isdigit():
            return SerialTransport(url, device, int(baud))
        raise UsageError(f"--connect {url!r} must be serial://DEVICE:BAUD, for example serial:///dev/ttyACM0:57600")
    try:
        datagrams = urlsplit(url)
        host, port = datagrams.hostname or "0.0.0.0", datagrams.port
    except ValueError:
        host, port = "", None
    if port is None or not 0 <= port <= 65535 or not is_host(host):
        raise UsageError(f"--connect {url!r} is not a link. Use {FORMS}")
    if scheme in ("udpin", "udp"):
        return UdpTransport(url, host, port, listen=True)
    if scheme == "udpout":
        return UdpTransport(url, host, port, listen=False)
    if scheme in ("tcp", "tcpout"):
        return TcpTransport(url, host, port)
    if scheme == "tcpin":
        return TcpListener(url, host, port)
    raise UsageError(f"--connect {url!r} is not a link. Use {FORMS}")


def bind_error(error: OSError, protocol: str, host: str, port: int, instead: str = "choose another port") -> UsageError:
    """Return the error for a port that cannot be bound. Its text names the program that holds the port, if known.

    `instead`: the advice to a user who cannot stop that program.
    """
    holder = port_holder(protocol, port)
    by = f" by {holder}" if holder else ""
    if error.errno in (98, 48):  # EADDRINUSE on Linux and macOS
        return UsageError(f"{protocol} port {port} is in use{by}. Stop that program, or {instead}")
    return UsageError(f"{protocol} port {port} on {host} cannot be opened: {error.strerror or error}")


RETRY_S = 0.5  # wall seconds between two attempts


class Reopening(Transport):
    """Wraps a transport, and reopens it when it breaks. Meanwhile it receives nothing, and discards sent bytes.

    The retries have no time limit, because `Conversation` raises if the vehicle is silent for too long.
    """

    def __init__(self, open_transport: Callable[[], Transport]) -> None:
        """Open the transport for the first time. Raises UsageError and LinkError like `open_transport`."""
        self._open = open_transport
        self._transport: Transport | None = open_transport()
        self.url = self._transport.url
        self.reopened = 0
        self._retry_s = 0.0

    @property
    def connected(self) -> bool:
        """Whether the transport is open."""
        return self._transport is not None

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
        """Wait at most `timeout_s` for the next attempt; return whether the transport is open again."""
        left_s = self._retry_s + RETRY_S - time.monotonic()
        if left_s > timeout_s:
            time.sleep(timeout_s)
            return False
        time.sleep(max(0.0, left_s))
        self._retry_s = time.monotonic()
        try:
            self._transport = self._open()
        except DronecatsError:  # the device is not back yet, or the server does not listen yet
            return False
        self.reopened += 1
        return True
