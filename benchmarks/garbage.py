"""Measures how far a simulator falls behind real time while it receives garbage, and how it serves a client meanwhile.

    python -m benchmarks.garbage [--json] [--only NAME …] [--seconds S] [--seed N] [--short]

Every row has a fresh simulator and one sender: a process that sends garbage as fast as it can, in turn to the agent's
port and to the truth bus. A client on the agent's port sends a PING 20 times a second. Figures of a row:

    lag        greatest delay of a tick of the simulator
    late       share of the ticks that were more than 2 ms late
    given up   time that the simulator never catches up: it skips a lag above 0.5 s
    core       share of a processor core that the simulator used; below 1 it can hold real time
    answered   share of the PINGs that were answered within 1 s, and the time within which 95 % of these answers came

Sender and simulator need a core each. A busy machine also causes a lag, so compare with the row `nothing`. `core` is
nearly the same on a busy machine. `--short` sends for one second and only checks that it runs.
"""

import json
import multiprocessing
import random
import socket
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from benchmarks.machine import Machine, benchmark_parser, process_cpu_s
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.stages.stage import SIMULATOR
from foundation.mavlink import Packer, Parser, dialect

EPISODE = "blocks-commanding-01"  # its map is built quickly
LOOPBACK = "127.0.0.1"
SECONDS = 8.0
PREPARED = 64  # datagrams of each kind, sent repeatedly
LONGEST = 60_000  # bytes, upper limit of a datagram
PING_S = 0.05  # s between two PINGs
ANSWER_S = 1.0  # s; a later answer does not count

Making = Callable[[random.Random], bytes]


def _packets(draw: random.Random, count: int) -> list[bytes]:
    packer = Packer(draw.randrange(1, 256), draw.randrange(1, 256))
    kinds = (
        dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        dialect.MAVLink_ping_message(draw.randrange(1 << 40), draw.randrange(1 << 30), 0, 0),
        dialect.MAVLink_command_long_message(1, 1, 512, 0, draw.randrange(400), 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, draw.choices(range(256), k=251)),
    )
    return [packer.pack(draw.choice(kinds)) for _ in range(count)]


def _cut(draw: random.Random, packet: bytes) -> bytes:
    return packet[: draw.randrange(1, len(packet))]


def random_bytes(draw: random.Random) -> bytes:
    return draw.randbytes(draw.randrange(1, LONGEST))


def truncated(draw: random.Random) -> bytes:
    return _cut(draw, _packets(draw, 1)[0])


def concatenated(draw: random.Random) -> bytes:
    """Return a datagram of random size: packets in a row, about half of them truncated."""
    packets = [_cut(draw, packet) if draw.random() < 0.5 else packet for packet in _packets(draw, 1500)]
    return b"".join(packets)[: draw.randrange(1, LONGEST)]


def version_1(draw: random.Random) -> bytes:
    """Return MAVLink 1 frames of the shortest length, all with an invalid checksum."""
    return b"\xfe\x00" * draw.randrange(1, LONGEST // 2)


def pings(draw: random.Random) -> bytes:
    """Return a datagram of intact PINGs. The simulator answers each of them."""
    ping = dialect.MAVLink_ping_message(draw.randrange(1 << 40), draw.randrange(1 << 30), 0, 0)
    return Packer(9, 9).pack(ping) * draw.randrange(1, 30)


ROWS: dict[str, Sequence[Making]] = {
    "nothing": (),
    "random bytes": (random_bytes,),
    "truncated": (truncated,),
    "concatenated": (concatenated,),
    "MAVLink 1": (version_1,),
    "all of these": (random_bytes, truncated, concatenated, version_1),
    "intact messages": (pings,),
}


def send(makers: Sequence[Making], ports: Sequence[int], seconds: float, seed: int, sent: Any) -> None:
    """Send datagrams to the ports in turn for `seconds`; store the count of datagrams and bytes in `sent`."""
    draw = random.Random(seed)
    prepared = [make(draw) for make in makers for _ in range(PREPARED)]
    draw.shuffle(prepared)
    ends_s, count, size = time.monotonic() + seconds, 0, 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        while time.monotonic() < ends_s:
            for datagram in prepared:
                wire.sendto(datagram, (LOOPBACK, ports[count % len(ports)]))
                count, size = count + 1, size + len(datagram)
    sent[0], sent[1] = count, size


class Client:
    """Sends PINGs and records how long each answer took."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._packer, self._parser = Packer(245, 191), Parser()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sent_s: dict[int, float] = {}
        self.answers_s: list[float] = []

    def ping(self, seconds: float) -> None:
        """Send PINGs for `seconds`, and record the answers."""
        ends_s, due_s, number = time.monotonic() + seconds, time.monotonic(), 0
        while time.monotonic() < ends_s + ANSWER_S:
            if due_s <= time.monotonic() < ends_s:
                number, due_s = number + 1, due_s + PING_S
                self._sent_s[number] = time.monotonic()
                message = dialect.MAVLink_ping_message(number, number, 0, 0)
                self._socket.sendto(self._packer.pack(message), (LOOPBACK, self._port))
            self._take()

    def _take(self) -> None:
        self._socket.settimeout(PING_S / 10)
        try:
            data = self._socket.recv(65536)
        except TimeoutError:
            return
        for message in self._parser.feed(data):
            if message.get_type() == "PING" and message.target_system == 245:
                took_s = time.monotonic() - self._sent_s.get(message.seq, 0.0)
                if took_s < ANSWER_S:
                    self.answers_s.append(took_s)

    @property
    def pings(self) -> int:
        return len(self._sent_s)

    def close(self) -> None:
        self._socket.close()


def measure(name: str, seconds: float, seed: int) -> dict[str, Any]:
    """Return the figures of one row of ROWS."""
    with tempfile.TemporaryDirectory() as folder, closing(Supervisor(Path(folder))) as supervisor:
        simulator = supervisor.start(SIMULATOR, SimulatorConfig(episode=EPISODE, count=1))
        ports = simulator.ready()
        client, sent = Client(ports["agent"][0]), multiprocessing.Array("d", 2)
        targets = (ports["agent"][0], ports["truth"])
        sender = multiprocessing.Process(target=send, args=(ROWS[name], targets, seconds + ANSWER_S, seed, sent))
        if ROWS[name]:
            sender.start()
        before_s, began_s = process_cpu_s(simulator.pid), time.monotonic()
        client.ping(seconds)
        core = (process_cpu_s(simulator.pid) - before_s) / (time.monotonic() - began_s)
        if ROWS[name]:
            sender.join()
        pace = simulator.do("pace")
        client.close()
    answers_s = sorted(client.answers_s)
    return {
        "garbage": name,
        "lag_ms": round(1e3 * pace["lag_max_s"], 1),
        "late_share": pace["late_share"],
        "given_up_s": pace["skipped_s"],
        "core": round(core, 3),
        "answered_share": round(len(answers_s) / client.pings, 3),
        "answer_ms": round(1e3 * answers_s[int(0.95 * (len(answers_s) - 1))], 1) if answers_s else None,
        "datagrams": int(sent[0]),
        "megabytes": round(sent[1] / 1e6, 1),
    }


def line(figures: dict[str, Any]) -> str:
    answer = "–" if figures["answer_ms"] is None else f"{figures['answer_ms']:.0f} ms"
    return (
        f"{figures['garbage']:16} lag {figures['lag_ms']:7.1f} ms  late {figures['late_share']:6.1%}  "
        f"given up {figures['given_up_s']:6.2f} s  core {figures['core']:4.2f}  "
        f"answered {figures['answered_share']:6.1%} in {answer:8} "
        f"({figures['datagrams']} datagrams, {figures['megabytes']:.0f} MB)"
    )


def main() -> None:
    """Measure the rows, and print a line for each."""
    parser = benchmark_parser(__doc__, short="send one second of two rows, to check that it runs")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=list(ROWS), help=", ".join(ROWS))
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help=f"seconds of a row (default {SECONDS:g})"
    )
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    names = args.only or (("nothing", "all of these") if args.short else ROWS)
    machine = Machine()
    for name in names:
        figures = measure(name, 1.0 if args.short else args.seconds, args.seed)
        print(json.dumps({**figures, "machine": machine.figures()}) if args.json else line(figures), flush=True)


if __name__ == "__main__":
    main()
