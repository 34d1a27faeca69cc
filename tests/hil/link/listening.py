"""Transports that listen on a port chosen by the system."""

from hil.link.transport import TcpListener, UdpTransport, connect


def udp() -> UdpTransport:
    """Return a listening UDP transport."""
    end = connect("udpin://127.0.0.1:0")
    assert isinstance(end, UdpTransport)
    return end


def tcp() -> TcpListener:
    """Return a TCP server for one client at a time."""
    end = connect("tcpin://127.0.0.1:0")
    assert isinstance(end, TcpListener)
    return end
