"""A bad wire between two MAVLink ends: whatever one says reaches the other through a `Channel` of its own."""

import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from dronecats.border.errors import LinkError, UsageError
from hil.impairment import Channel, Impairment
from hil.transport import Transport, bind_error, connect

LONGEST_WAIT_S = 0.05  # s without anything to do after which a thread looks whether it is to end
MAVLINK1, MAVLINK2, SIGNED, SIGNATURE_BYTES = 0xFE, 0xFD, 0x01, 13


class Frames:
    """Cuts a stream of bytes where its MAVLink frames begin and end, whatever they hold: a wire reads no messages."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the whole frames, in order; bytes that belong to none form units of their own."""
        data = self._rest + data
        units, at = [], 0
        while at < len(data):
            length = _frame_length(data, at)
            if length is None or at + length > len(data):
                break
            units.append(data[at : at + length])
            at += length
        self._rest = data[at:]
        return units


def _frame_length(data: bytes, at: int) -> int | None:
    """Return the bytes of the unit that begins at `at`, None while its header is not all there."""
    magic = data[at]
    if magic not in (MAVLINK1, MAVLINK2):
        starts = [i for i in (data.find(MAVLINK1, at), data.find(MAVLINK2, at)) if i >= 0]
        return min(starts, default=len(data)) - at
    if len(data) < at + 3:
        return None
    if magic == MAVLINK1:
        return 8 + data[at + 1]
    return 12 + data[at + 1] + (SIGNATURE_BYTES if data[at + 2] & SIGNED else 0)


class TcpListener:
    """The listening end of a TCP connection, one client at a time; the next may come when that one has gone."""

    def __init__(self, url: str, host: str, port: int) -> None:
        self.url = url
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise bind_error(error, "TCP", host, port) from None
        self._client: socket.socket | None = None

    @property
    def port(self) -> int:
        """The local port, useful when 0 was asked for."""
        return int(self._listener.getsockname()[1])

    def receive(self, timeout_s: float) -> bytes:
        client = self._client
        if not select.select([client or self._listener], [], [], timeout_s)[0]:
            return b""
        if client is None:
            self._client = self._listener.accept()[0]
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b""
        try:
            data = client.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._client = None
            client.close()
        return data

    def send(self, data: bytes) -> None:
        client = self._client
        if client is not None:
            try:
                client.sendall(data)
            except OSError:
                self._client = None  # `receive` sees it closed, too; what was said to nobody is gone

    def close(self) -> None:
        self._listener.close()
        if self._client is not None:
            self._client.close()


def open_end(url: str) -> Transport:
    """Return an open end: the URLs of `--connect`, and tcpin://HOST:PORT. Raises UsageError, LinkError."""
    scheme, _, rest = url.partition("://")
    if scheme != "tcpin":
        return connect(url)
    host, _, port = rest.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"'{url}' is no address to listen at; use tcpin://HOST:PORT")
    return TcpListener(url, host, int(port))


class ImpairedWire:
    """Runs between an agent and an autopilot from `start` to `close`, on two threads, one per direction."""

    def __init__(
        self,
        agent: Transport,
        autopilot: Transport,
        up: Impairment,
        down: Impairment,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,  # s; a wire is impaired in wall time, as a real one is
    ) -> None:
        self._agent, self._autopilot = agent, autopilot
        self._clock, self._zero_s = clock, clock()
        self.up, self.down = Channel(up, seed, "up"), Channel(down, seed, "down")
        self.fault: LinkError | None = None  # what ended the wire, None while it works
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=self._carry, args=(agent, autopilot, self.up), name="wire-up", daemon=True),
            threading.Thread(target=self._carry, args=(autopilot, agent, self.down), name="wire-down", daemon=True),
        ]

    def start(self) -> "ImpairedWire":
        """Carry from now on, which is second 0 of the cuts; return self."""
        self._zero_s = self._clock()
        for thread in self._threads:
            thread.start()
        return self

    @property
    def time_s(self) -> float:
        """Seconds since `start`."""
        return self._clock() - self._zero_s

    def pull(self, from_s: float, seconds: float) -> None:
        """Pull the cable, both ways, at a second of the wire's time that has yet to come, and plug it in again."""
        for channel in (self.up, self.down):
            wire = channel.impairment
            channel.impairment = replace(wire, cuts=(*wire.cuts, (from_s, from_s + seconds)))

    def check(self) -> None:
        """Raise the LinkError that ended the wire, if one did."""
        if self.fault is not None:
            raise self.fault

    def close(self) -> None:
        """End both directions and close both ends."""
        self._ending.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()
        self._agent.close()
        self._autopilot.close()

    def __enter__(self) -> "ImpairedWire":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _carry(self, source: Transport, sink: Transport, channel: Channel) -> None:
        frames = Frames()
        try:
            while not self._ending.is_set():
                next_s = channel.next_s
                patience_s = LONGEST_WAIT_S if next_s is None else min(LONGEST_WAIT_S, max(0.0, next_s - self.time_s))
                units = frames.feed(source.receive(patience_s))
                now_s = self.time_s
                for unit in units:
                    channel.put(now_s, unit)
                for unit in channel.arrived(now_s):
                    sink.send(unit)
        except (LinkError, OSError) as fault:
            self.fault = fault if isinstance(fault, LinkError) else LinkError(f"the wire to {sink.url} broke: {fault}")
            self._ending.set()
