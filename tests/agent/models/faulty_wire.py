"""A scripted TCP server. Each connection gets the next response or fault (hang, trickle, reset) of the script."""

import contextlib
import json
import re
import socket
import struct
import threading
from collections import Counter
from itertools import cycle


def answer(status, body, *headers):
    """Return a complete HTTP response with a body of bytes or of JSON."""
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    lines = [f"HTTP/1.1 {status} X", *headers, f"Content-Length: {len(data)}", "Connection: close", "", ""]
    return "\r\n".join(lines).encode() + data


def completion(text, *headers):
    return answer(200, {"choices": [{"message": {"content": text}}]}, *headers)


HTML = b"<html><body>gateway</body></html>"


class Wire:
    """A server that executes one act of the script per connection and repeats the last."""

    def __init__(self, *script):
        self.script, self.served = script, 0
        self.bodies = []  # request bodies
        self._lock = threading.Lock()
        self.over, self.dropped = threading.Event(), threading.Event()
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}/v1"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._socket.accept()
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        with connection, self._noticing():
            received = b""
            while b"\r\n\r\n" not in received:
                received += connection.recv(65536)
            head, _, body = received.partition(b"\r\n\r\n")
            if head.startswith(b"GET"):  # the client's check of the server
                connection.sendall(answer(404, b""))
                return
            length = int(re.findall(rb"Content-Length: (\d+)", head)[0])
            while len(body) < length:
                body += connection.recv(65536)
            with self._lock:
                act = self.script[min(self.served, len(self.script) - 1)]
                self.served += 1
                self.bodies.append(body)
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
    """Send `head`, then one byte every 20 ms without end. No single read times out."""

    def act(wire, connection):
        connection.sendall(head)
        while not wire.over.wait(0.02):
            connection.sendall(b"a")

    return act


# temporary faults
AGAIN = {
    "429 with seconds": say(answer(429, b"busy", "Retry-After: 0")),
    "503 with a date": say(answer(503, b"busy", "Retry-After: Sun, 01 Mar 2020 12:00:00 GMT")),
    "500": say(answer(500, HTML)),
    "408": say(answer(408, b"")),
    "nothing": say(b""),
    "reset": reset,
    "half a header": say(b"HTTP/1.1 200 OK\r\nContent-Len"),
    "half a body": cut(completion("x")),
    "half a body of unknown length": say(b'HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n{"choices": [{"mess'),
    "no HTTP": say(b"220 mail ready\r\n\r\n"),
    "OpenRouter busy": say(answer(200, {"error": {"code": 429, "message": "slow down"}})),
    "OpenRouter's provider down": say(answer(200, {"error": {"code": "502", "message": "down"}})),
    "in the middle of a reply": say(
        answer(200, {"choices": [{"finish_reason": "error", "message": {"content": "Go"}, "error": {"code": 502}}]})
    ),
    "Anthropic overloaded": say(answer(200, {"type": "error", "error": {"type": "overloaded_error"}})),
    "Gemini unavailable": say(answer(200, {"error": {"status": "UNAVAILABLE", "message": "later"}})),
}


def behind(reply, *faults):
    """Return an act: each question gets two of the faults, in turn, and then the answer `reply(body)`."""
    coming, request_counts = cycle(faults), Counter[bytes]()

    def act(wire, connection):
        body = wire.bodies[-1]
        request_counts[body] += 1
        fault = next(coming) if faults and request_counts[body] <= 2 else None
        (fault or say(answer(200, reply(body))))(wire, connection)

    return act
