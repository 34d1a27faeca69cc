"""The impaired wire on real sockets: complete frames in both directions, over UDP and TCP, and as a command."""

import os
import re
import signal
import socket
import subprocess
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.cli.main import main
from foundation.mavlink import Packer, Parser, dialect
from foundation.wire import Frames
from hil.impairment import ImpairedWire, Impairment
from hil.link.transport import Transport, connect
from tests.hil.link import listening
from tests.support.command_line import DRONECATS
from tests.support.ports import free_port

PERFECT = Impairment()


def pings(count: int) -> list[bytes]:
    packer = Packer(245, 191)
    return [packer.pack(dialect.MAVLink_ping_message(1000 + n, n, 0, 0)) for n in range(count)]


def hear(end: Transport, count: int, seconds: float = 5.0) -> list[int]:
    """Receive pings until there are `count` or the time is over. Return their sequence numbers in order."""
    parser, until = Parser(), time.monotonic() + seconds
    numbers: list[int] = []
    while len(numbers) < count and time.monotonic() < until:
        numbers += [m.seq for m in parser.feed(end.receive(0.05))]
    return numbers


def udp_wire(up: Impairment, down: Impairment = PERFECT, seed: int = 0) -> tuple[ImpairedWire, Transport, Transport]:
    """Return a wire, the agent's end and the autopilot's end."""
    autopilot = listening.udp()
    listener = listening.udp()
    wire = ImpairedWire(listener, connect(f"udpout://127.0.0.1:{autopilot.port}"), up, down, seed)
    return wire, connect(f"udpout://127.0.0.1:{listener.port}"), autopilot


@given(st.lists(st.one_of(st.sampled_from(pings(3)), st.binary(max_size=30))), st.lists(st.integers(1, 40)))
def test_splitting_into_frames_preserves_all_bytes(parts: list[bytes], sizes: list[int]) -> None:
    data, frames, out = b"".join(parts), Frames(), b""
    at = 0
    for size in sizes:
        out += b"".join(frames.feed(data[at : at + size]))
        at += size
    out += b"".join(frames.feed(data[at:]))
    assert data.startswith(out)
    assert len(data) - len(out) < 300  # an incomplete frame at the end


def test_mavlink_1_2_and_signed_frames_are_split_at_their_start() -> None:
    ours = pings(2)
    old = b"\xfe\x03\x00\x01\x01\x00abcXY"
    signed = bytes([0xFD, 2, 1, 0, 0, 1, 1, 4, 0, 0]) + b"ab" + b"XY" + bytes(13)
    data = ours[0] + b"noise" + old + signed + ours[1]
    assert Frames().feed(data) == [ours[0], b"noise", old, signed, ours[1]]
    bitten = Frames()
    assert [u for i in range(len(data)) for u in bitten.feed(data[i : i + 1]) if len(u) > 1] == [
        ours[0], old, signed, ours[1],
    ]  # fmt: skip


def test_a_perfect_wire_changes_nothing() -> None:
    wire, agent, autopilot = udp_wire(PERFECT)
    with wire:
        for frame in pings(50):
            agent.send(frame)
        assert hear(autopilot, 50) == list(range(50))
        for frame in pings(50):
            autopilot.send(frame)
        assert hear(agent, 50) == list(range(50))


def test_the_seed_determines_the_lost_frames() -> None:
    received = []
    for seed in (1, 1, 2):
        wire, agent, autopilot = udp_wire(Impairment(loss=0.3), seed=seed)
        with wire:
            for frame in pings(100):
                agent.send(frame)
            received.append(hear(autopilot, 100, seconds=0.5))
            assert len(received[-1]) == 100 - wire.up.counts.lost
    assert received[0] == received[1] != received[2]
    assert 50 <= len(received[0]) <= 90


def test_the_delay_applies_in_one_direction_and_has_the_set_length() -> None:
    wire, agent, autopilot = udp_wire(Impairment(delay_s=0.3))
    with wire:
        sent_s = time.monotonic()
        agent.send(pings(1)[0])
        assert hear(autopilot, 1) == [0]
        assert 0.3 <= time.monotonic() - sent_s < 0.6
        sent_s = time.monotonic()
        autopilot.send(pings(1)[0])
        assert hear(agent, 1) == [0]
        assert time.monotonic() - sent_s < 0.25


def test_an_impairment_ends_after_its_duration() -> None:
    wire, agent, autopilot = udp_wire(PERFECT)
    with wire:
        agent.send(pings(1)[0])
        assert hear(autopilot, 1) == [0]
        wire.impair(Impairment(loss=1.0), PERFECT, seconds=0.5)
        began_s = wire.time_s
        while wire.time_s < began_s + 0.2:
            agent.send(pings(2)[1])
            assert autopilot.receive(0.01) == b""
        while wire.time_s < began_s + 0.8:
            autopilot.receive(0.01)
        agent.send(pings(3)[2])
        assert hear(autopilot, 1) == [2]


def test_tcp_carries_frames_both_ways_and_a_client_can_reconnect() -> None:
    far, near = listening.tcp(), listening.tcp()
    with ImpairedWire(near, connect(f"tcp://127.0.0.1:{far.port}"), PERFECT, PERFECT):
        for _ in range(2):
            agent = connect(f"tcp://127.0.0.1:{near.port}")
            for frame in pings(20):
                agent.send(frame)
            assert hear(far, 20) == list(range(20))
            far.send(pings(1)[0])
            assert hear(agent, 1) == [0]
            agent.close()
    far.close()


def test_a_closed_connection_is_reported() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    wire = ImpairedWire(
        connect("udpin://127.0.0.1:0"), connect(f"tcp://127.0.0.1:{listener.getsockname()[1]}"), PERFECT, PERFECT
    )
    with wire:
        listener.accept()[0].close()
        until = time.monotonic() + 5.0
        while wire.fault is None and time.monotonic() < until:
            time.sleep(0.01)
        with pytest.raises(Exception, match="closed"):
            wire.check()
    listener.close()


def command(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*DRONECATS, "impair", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_the_command_prints_its_counts_and_exits_on_ctrl_c() -> None:
    autopilot = listening.udp()
    port = free_port()
    process = command(
        "--listen", f"udpin://127.0.0.1:{port}", "--to", f"udpout://127.0.0.1:{autopilot.port}",
        "--loss", "0.5,0", "--seed", "1",
    )  # fmt: skip
    assert process.stdout is not None
    assert str(port) in process.stdout.readline()
    agent = connect(f"udpout://127.0.0.1:{port}")
    for frame in pings(40):
        agent.send(frame)
    received = hear(autopilot, 40, seconds=1.0)
    os.kill(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    counted = re.search(r"taken 40, arrived (\d+), lost (\d+)", output)
    assert counted is not None, output
    assert (int(counted[1]), int(counted[2])) == (len(received), 40 - len(received))
    assert "taken 0, arrived 0" in output


def test_wrong_options_are_rejected(capsys: pytest.CaptureFixture[str]) -> None:
    for option, value in (
        ("--loss", "2"), ("--delay", "1,2,3"), ("--cut", "5"), ("--report", "0"), ("--baud", "nan"),
        ("--queue", "4096"),
    ):  # fmt: skip
        ends = ["--listen", "udpin://127.0.0.1:0", "--to", "udpout://127.0.0.1:9"]
        assert main(["impair", *ends, option, value]) == 2, option
        assert option.strip("-") in capsys.readouterr().err
