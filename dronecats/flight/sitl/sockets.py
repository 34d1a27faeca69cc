"""The simulator's MAVLink ports on UDP. As in PX4, the simulator sends first, to a known address.

Any program on this machine can send to a port, and a real-time simulator has only milliseconds for each tick. So a port
passes on only intact frames. Each exchange reads a limited number of datagrams and processes them for a limited time.
Senders take turns. A sender that sends too much loses its own messages.
"""

import contextlib
import socket
import time
from collections.abc import Callable

from dronecats.flight.sitl.simulation import SimulatedVehicle, Simulation, TruthBus, VehiclePort
from foundation.mavlink import Parser
from foundation.wire import MARKER, frame_bytes
from hil.link.transport import BUFFER_BYTES, bind_error

SocketAddress = tuple[str, int]
DATAGRAM_BYTES = 8_000  # longer datagrams are dropped; the limit of PX4's mavlink_receiver.cpp
DATAGRAMS = 128  # datagrams that one exchange reads at most
WORK_S = 0.001  # wall s; default time to process frames in one exchange
SLICE_BYTES = 512  # bytes that one sender's turn processes: about 40 messages; takes 2 ms if all need answers
INBOX_BYTES = 65_536  # largest queue of one sender: enough for a mission or a burst of a file transfer
PEERS = 32  # largest number of senders that get data
SENDERS = 64  # largest number of senders with a queue, peers included


class Sender:
    """One address that sends to a port, with a queue of received bytes and a parser."""

    def __init__(self) -> None:
        self.is_peer = False  # whether it has sent a frame and therefore gets data
        self._parser = Parser()
        self._inbox = bytearray()

    @property
    def waits(self) -> bool:
        return bool(self._inbox)

    @property
    def bad(self) -> int:
        """Number of places in this sender's data that are not MAVLink."""
        return self._parser.bad

    def put(self, data: bytes) -> None:
        """Queue a datagram, or drop it if the queue is full."""
        if len(self._inbox) + len(data) <= INBOX_BYTES:
            self._inbox += data

    def take(self) -> bytes:
        """Parse the next SLICE_BYTES of the queue, and return the frames that end in them."""
        data = bytes(self._inbox[:SLICE_BYTES])
        del self._inbox[:SLICE_BYTES]
        return b"".join(self._parser.frames(data))


class UdpPort:
    """One local socket. It sends to the address `remote` and to the PEERS newest senders of MAVLink messages."""

    def __init__(
        self,
        local: SocketAddress,
        remote: SocketAddress | None,
        take: Callable[[], bytes],
        give: Callable[[bytes], None],
        *,
        shared: bool = False,
        malformed: Callable[[], None] = lambda: None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`take` returns the bytes to send; `give` gets received frames. `shared`: peers also get each other's frames.

        `malformed` is called once, at the first bytes that are not MAVLink. `now_s` reads the wall clock.
        """
        self._shared, self._malformed, self._now_s = shared, malformed, now_s
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        try:
            self._socket.bind(local)
        except OSError as error:
            self._socket.close()
            raise bind_error(error, "UDP", *local, instead="choose another --instance") from None
        self._socket.setblocking(False)
        self._remote = remote
        self._senders: dict[SocketAddress, Sender] = {}  # by the time of their last turn, oldest first
        self._peers: dict[SocketAddress, None] = {}  # senders of frames, by the time of their last frame, oldest first
        self._is_malformed = self._peers_turn = False
        self._take, self._give = take, give

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def exchange(self, until_s: float | None = None) -> None:
        """Read the socket, process received frames, and send.

        It processes frames until the wall time `until_s` (None: for WORK_S), but at least one slice.
        """
        self._receive()
        self._work(self._now_s() + WORK_S if until_s is None else until_s)
        self._send(self._take())

    def _receive(self) -> None:
        with contextlib.suppress(BlockingIOError):
            for _ in range(DATAGRAMS):
                try:
                    data, address = self._socket.recvfrom(DATAGRAM_BYTES + 1)
                except ConnectionRefusedError:
                    continue  # no program listens at `remote` yet
                if len(data) <= DATAGRAM_BYTES:
                    self._sender(address).put(data)

    def _sender(self, address: SocketAddress) -> Sender:
        sender = self._senders.get(address)
        if sender is None:
            if len(self._senders) >= SENDERS:
                del self._senders[next(old for old, sender in self._senders.items() if not sender.is_peer)]
            sender = self._senders[address] = Sender()
        return sender

    def _work(self, until_s: float) -> None:
        """Process a slice of the sender that has waited longest, and more slices until `until_s`.

        Peers and other senders alternate, so that neither many unknown senders nor a peer that sends much block the
        others.
        """
        while waiting := [address for address, sender in self._senders.items() if sender.waits]:
            self._peers_turn = not self._peers_turn
            address = next((a for a in waiting if self._senders[a].is_peer is self._peers_turn), waiting[0])
            sender = self._senders[address] = self._senders.pop(address)
            if frames := sender.take():
                self._accept(address, sender)
                self._give(frames)
                if self._shared:
                    self._send(frames, but=address)
            if sender.bad and not self._is_malformed:
                self._is_malformed = True
                self._malformed()
            if self._now_s() >= until_s:
                return

    def _accept(self, address: SocketAddress, sender: Sender) -> None:
        """Make the sender of a frame the newest peer; above PEERS, forget the oldest."""
        sender.is_peer = True
        self._peers.pop(address, None)
        self._peers[address] = None
        if len(self._peers) > PEERS:
            forgotten = next(iter(self._peers))
            del self._peers[forgotten]
            del self._senders[forgotten]

    def _send(self, data: bytes, but: SocketAddress | None = None) -> None:
        remote = () if self._remote is None or self._remote in self._peers else (self._remote,)
        for packet in packets(data):
            for peer in (*remote, *self._peers):
                if peer != but:
                    with contextlib.suppress(OSError):  # full buffer or absent listener: the datagram is lost
                        self._socket.sendto(packet, peer)

    def close(self) -> None:
        self._socket.close()


def packets(data: bytes, size: int = 1400) -> list[bytes]:
    """Split a stream of MAVLink 2 messages, between messages, into datagrams of at most about `size` bytes."""
    cut, at, start = [], 0, 0
    while at + 2 < len(data) and data[at] == MARKER:  # other bytes stay in one datagram
        length = frame_bytes(data, at)
        if at + length - start > size and at > start:
            cut.append(data[start:at])
            start = at
        at += length
    if start < len(data):
        cut.append(data[start:])
    return cut


LOOPBACK = "127.0.0.1"
# ports of clients; the instance number is added to all but GCS_PORT
AGENT_PORT, GCS_PORT, TRUTH_PORT = 14540, 14550, 19410
CAMERA_PORT = 8080  # TCP port of the camera, plus the instance number, or the next free port
AGENT_LOCAL, GCS_LOCAL, TRUTH_LOCAL = 14580, 18570, 19450  # ports of the simulator, plus the instance number


def truth_port(bus: TruthBus, instance: int | None) -> UdpPort:
    """Return the truth bus on UDP; `instance` None: an ephemeral port that sends only to programs that send first."""
    tap = bus.tap()
    if instance is None:
        return UdpPort((LOOPBACK, 0), None, tap.take, tap.receive, shared=True)
    local, remote = (LOOPBACK, TRUTH_LOCAL + instance), (LOOPBACK, TRUTH_PORT + instance)
    return UdpPort(local, remote, tap.take, tap.receive, shared=True)


class Ports:
    """All UDP ports of a simulation. `instance` None: ephemeral ports, of which only the GCS ports send first."""

    def __init__(self, simulation: Simulation[SimulatedVehicle], instance: int | None) -> None:
        self.agent, self.gcs, self.log = [], [], []
        self.truth = truth_port(simulation.bus, instance)
        for vehicle in simulation.vehicles:
            n = (instance or 0) + vehicle.index
            onboard, gcs, log = (vehicle.open_port(profile) for profile in ("onboard", "gcs", "minimal"))
            if instance is None:
                self.agent.append(_udp(onboard, 0, None))
                self.gcs.append(_udp(gcs, 0, GCS_PORT))
            else:
                self.agent.append(_udp(onboard, AGENT_LOCAL + n, AGENT_PORT + n))
                self.gcs.append(_udp(gcs, GCS_LOCAL + n, GCS_PORT))
            self.log.append(_udp(log, 0, None))

    def exchange(self, work_s: float) -> None:
        """Exchange data with all clients. Process their messages for about `work_s` of wall time."""
        until_s = time.monotonic() + work_s
        for port in self._all():
            port.exchange(until_s)

    def close(self) -> None:
        for port in self._all():
            port.close()

    def _all(self) -> list[UdpPort]:
        return [self.truth, *self.agent, *self.gcs, *self.log]


def _udp(port: VehiclePort, local: int, remote: int | None) -> UdpPort:
    there = (LOOPBACK, remote) if remote is not None else None
    return UdpPort((LOOPBACK, local), there, port.take, port.receive, malformed=port.note_malformed)
