"""A server that replaces a model and sends one reply after a fixed time, to measure the agent's own time.

    python -m benchmarks.stand_in SECONDS REPLY

The endpoint is OpenAI-compatible and on the loopback. The server prints its address as the first line, and ends
when its standard input ends. `GET /times` returns the times of the newest question and of its reply, in s of the
monotonic clock that all processes of the machine share.
"""

import json
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class StandIn(ThreadingHTTPServer):
    """An HTTP server that answers every question with `reply` after `seconds`."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, seconds: float, reply: str) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.seconds = seconds
        message = {
            "choices": [{"index": 0, "message": {"role": "assistant", "content": reply}, "finish_reason": "stop"}]
        }
        self.body = json.dumps({**message, "usage": {"prompt_tokens": 1000, "completion_tokens": 30}}).encode()
        self.times = {"asked": 0.0, "answered": 0.0}


class _Handler(BaseHTTPRequestHandler):
    server: StandIn
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = -1  # sends header and body together

    def do_GET(self) -> None:
        self._send(json.dumps(self.server.times if self.path == "/times" else {"data": []}).encode())

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        arrived_s = time.monotonic()
        if self.server.seconds:
            time.sleep(self.server.seconds)
        self.server.times = {"asked": arrived_s, "answered": time.monotonic()}
        self._send(self.server.body)

    def _send(self, body: bytes) -> None:
        self.send_response_only(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Log nothing."""


def main() -> None:
    """Serve until standard input ends."""
    server = StandIn(float(sys.argv[1]), sys.argv[2])
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    sys.stdout.write(f"http://127.0.0.1:{server.server_port}\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    main()
