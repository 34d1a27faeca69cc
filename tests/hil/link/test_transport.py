import contextlib
import os
import pty
import socket
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import DronecatsError, LinkError, UsageError
from hil.link.transport import MemoryTransport, TcpListener, UdpTransport, connect
from tests.hil.link import listening
from tests.support.refusal import refusal


def test_udp_sends_to_the_last_sender():
    server = connect("udpin://127.0.0.1:0")
    assert isinstance(server, UdpTransport)
    client = connect(f"udpout://127.0.0.1:{server.port}")
    server.send(b"to nobody")
    client.send(b"hello")
    assert server.receive(2.0) == b"hello"
    server.send(b"you")
    assert client.receive(2.0) == b"you"
    assert client.receive(0.0) == b""
    server.close()
    client.close()


def test_one_thread_can_receive_while_another_sends():
    server = listening.udp()
    client = connect(f"udpout://127.0.0.1:{server.port}")
    client.send(b"hello")
    server.receive(2.0)
    ended, interval_s, faults = threading.Event(), sys.getswitchinterval(), []

    def receive():
        try:
            while not ended.is_set():
                client.send(b".")
                server.receive(0.01)
        except RuntimeError as fault:
            faults.append(fault)

    sys.setswitchinterval(1e-6)
    thread = threading.Thread(target=receive)
    thread.start()
    try:
        sent = 0
        for _ in range(20_000):
            server.send(b"x")
            sent += len(client.receive(0.0))
    finally:
        ended.set()
        thread.join()
        sys.setswitchinterval(interval_s)
    while data := client.receive(0.1):
        sent += len(data)
    assert faults == []
    assert sent == 20_000  # no message was dropped for lack of a peer
    server.close()
    client.close()


def test_udp_sends_to_both_peers_until_one_is_silent(monkeypatch):
    server = listening.udp()
    one, other = (connect(f"udpout://127.0.0.1:{server.port}") for _ in range(2))
    for client in (one, other):
        client.send(b"hello")
        assert server.receive(2.0) == b"hello"
    server.send(b"for one")
    assert [one.receive(2.0), other.receive(2.0)] == [b"for one"] * 2
    monkeypatch.setattr("hil.link.transport.PEER_S", 0.0)
    server.send(b"again")
    assert [one.receive(0.0), other.receive(2.0)] == [b"", b"again"]
    for wire in (server, one, other):
        wire.close()


def test_the_error_for_a_port_in_use_names_port_and_process():
    holder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    holder.bind(("127.0.0.1", 0))
    port = holder.getsockname()[1]
    with pytest.raises(UsageError, match=rf"{port}.*{os.getpid()}"):
        connect(f"udpin://127.0.0.1:{port}")
    holder.close()


def test_tcp_raises_an_error_when_the_connection_ends_or_fails():
    listener = socket.create_server(("127.0.0.1", 0))
    client = connect(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
    peer, _ = listener.accept()
    peer.sendall(b"abc")
    assert client.receive(2.0) == b"abc"
    peer.close()
    with pytest.raises(LinkError, match="closed"):
        client.receive(2.0)
    client.close()
    listener.close()
    with pytest.raises(LinkError, match=r"127\.0\.0\.1:1"):
        connect("tcp://127.0.0.1:1")


def test_malformed_urls_are_rejected_with_one_sentence():
    for url in [
        "",
        "udpin",
        "udpin://",
        "udpin://1.2.3.4",
        "udpin://h:99999999",
        "ftp://h:1",
        "serial:///dev/x:fast",
        "udp://[::1",
        "udpout://192.168..1:14550",
        "tcp://192.168..1:5760",
        f"udpin://{'h' * 64}:1",
    ]:
        assert "--connect" in refusal(connect, url)


@given(st.text(max_size=30))
def test_any_text_as_url_raises_only_a_dronecats_error(text):
    with contextlib.suppress(DronecatsError):
        connect(text).close()


def test_memory_transport_pumps_only_when_it_has_no_data():
    queue, pumped = [b"first"], []

    def pump():
        pumped.append(1)
        if len(pumped) == 3:
            queue.append(b"second")

    def take():
        return queue.pop(0) if queue else b""

    pipe = MemoryTransport("memory://", take, queue.append, pump, lambda: len(pumped) / 10)
    assert pipe.receive(1.0) == b"first"
    assert not pumped
    assert pipe.receive(0.0) == b""
    assert not pumped
    assert pipe.receive(1.0) == b"second"
    assert len(pumped) == 3
    assert pipe.receive(0.5) == b""  # the vehicle is silent for 0.5 s of its own clock
    assert len(pumped) == 8


def test_a_tcp_server_listens_on_an_ipv6_address():
    server = TcpListener("tcpin://[::1]:0", "::1", 0)
    client = connect(f"tcp://[::1]:{server.port}")
    client.send(b"word")
    while not server.connected:
        server.receive(2.0)
    assert server.receive(2.0) == b"word"
    client.close()
    server.close()


def test_a_tcp_server_serves_the_newest_client():
    server = listening.tcp()
    server.send(b"to nobody")
    for word in (b"first", b"second"):
        client = connect(f"tcp://127.0.0.1:{server.port}")
        client.send(word)
        got = b""
        while not got:  # the first read accepts the client
            got = server.receive(2.0)
        assert got == word
        server.send(word + b" back")
        assert client.receive(2.0) == word + b" back"
        client.close()
    server.close()


def test_a_serial_url_without_a_baud_rate_is_accepted():
    line, far = pty.openpty()
    with contextlib.closing(connect(f"serial://{os.ttyname(far)}")) as port:
        os.write(line, b"hello")
        assert port.receive(2.0) == b"hello"
        port.send(b"you")
        assert os.read(line, 10) == b"you"
    os.close(line)
    os.close(far)


def test_a_disconnected_serial_device_raises_an_error():
    line, far = pty.openpty()
    port = connect(f"serial://{os.ttyname(far)}:115200")
    os.close(far)
    os.close(line)
    with pytest.raises(LinkError, match="broke"):
        port.receive(2.0)
    port.close()


def test_datagrams_are_lost_without_an_exception_if_the_network_is_down():
    wire = connect("udpout://255.255.255.255:9")  # the kernel rejects this address, as it does without a network
    wire.send(b"lost")
    assert wire.receive(0.0) == b""
    wire.close()
