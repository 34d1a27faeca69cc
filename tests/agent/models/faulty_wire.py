"""A server that hangs, trickles, breaks off, floods or lies, as it is told, connection by connection. Over real TCP."""

import contextlib
import json
import re
import socket
import struct
import threading


def answer(status, body, *headers):
    """Return a whole answer, of bytes or of JSON."""
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    lines = [f"HTTP/1.1 {status} X", *headers, f"Content-Length: {len(data)}", "Connection: close", "", ""]
    return "\r\n".join(lines).encode() + data


def completion(text, *headers):
    return answer(200, {"choices": [{"message": {"content": text}}]}, *headers)


class Wire:
    """A server that does, per connection, the next of what is scripted, the last for ever."""

    def __init__(self, *script):
        self.script, self.served = script, 0
        self.over, self.dropped = threading.Event(), threading.Event()
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}/v1"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._socket.accept()
                act = self.script[min(self.served, len(self.script) - 1)]
                self.served += 1
                threading.Thread(target=self._serve, args=(connection, act), daemon=True).start()

    def _serve(self, connection, act):
        with connection, self._noticing():
            received = b""
            while b"\r\n\r\n" not in received:
                received += connection.recv(65536)
            head, _, body = received.partition(b"\r\n\r\n")
            length = int(re.findall(rb"Content-Length: (\d+)", head)[0])
            while len(body) < length:
                body += connection.recv(65536)
            act(self, connection)

    @contextlib.contextmanager
    def _noticing(self):
        try:
            yield
        except OSError:
            self.dropped.set()

    def close(self):
        self.over.set()
        self._socket.close()


def say(data):
    return lambda wire, connection: connection.sendall(data)


def cut(data):
    """Send all but the last bytes."""
    return say(data[:-7])


def hang(wire, connection):
    wire.over.wait()


def reset(wire, connection):
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def trickle(head):
    """Send `head`, and then a byte every 20 ms for ever: no single read is ever late."""

    def act(wire, connection):
        connection.sendall(head)
        while not wire.over.wait(0.02):
            connection.sendall(b"a")

    return act
