"""A local HTTP server that records requests and gives fixed or computed responses."""

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True, slots=True)
class Sent:
    """One request as received."""

    path: str  # with its query
    headers: dict[str, str]  # names in lower case
    body: Any  # read as JSON


class Recording:
    """Context manager: `url` is valid while it is open, `sent` also afterwards."""

    def __init__(
        self,
        answer: bytes | Callable[[Sent], tuple[int, bytes]] = b"{}",
        status: int = 200,
        listed: bytes | None = None,
    ) -> None:
        """`answer`: the body of every response, or a function from a request to (status, body).

        `listed`: the body of the response to a GET request, which lists the models; None: status 501.
        """
        self.sent: list[Sent] = []
        self.paths: list[str] = []  # of the GET requests, with their queries
        sent, paths = self.sent, self.paths

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                headers = {name.lower(): value for name, value in self.headers.items()}
                sent.append(Sent(self.path, headers, json.loads(body)))
                response = (status, answer) if isinstance(answer, bytes) else answer(sent[-1])
                self.send_response(response[0])
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(response[1])))
                self.end_headers()
                self.wfile.write(response[1])

            def do_GET(self):
                paths.append(self.path)
                self.send_response(501 if listed is None else 200)
                self.send_header("Content-Length", str(len(listed or b"")))
                self.end_headers()
                self.wfile.write(listed or b"")

            def log_message(self, format, *args):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"

    def __enter__(self) -> "Recording":
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *_) -> None:
        self._server.shutdown()
        self._server.server_close()
