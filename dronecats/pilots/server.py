"""Serves a pilot as a model: an OpenAI-compatible chat endpoint on the loopback interface.

The agent connects to a base URL in the same way as for a model, and cannot distinguish a pilot from a model. Responses
are deterministic: the same request gets the same bytes, without a timestamp. `PilotPart` serves a built-in pilot in a
child process.
"""

import base64
import binascii
import contextlib
import hashlib
import json
import socket
import threading
import time
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from dronecats.agent.models.model import IMAGE_TOKENS, tokens_of_text
from dronecats.pilots import roster
from dronecats.pilots.actions import Pilot
from foundation.errors import UsageError

MAX_BODY_BYTES = 16 * 1024 * 1024
_MAX_IMAGES = 64
_IDLE_S = 60.0  # a connection without data is closed after this time


class PilotServer:
    """Serves one pilot under a model name."""

    def __init__(
        self, pilot: Pilot, name: str, *, owned_by: str = "dronecats", host: str = "127.0.0.1", port: int = 0
    ) -> None:
        """Bind the address. Port 0: the system chooses a port. Raises UsageError if the address cannot be bound."""
        try:
            self._http = _Http((host, port), _Handler)
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"the pilot server cannot listen on {host}:{port}: {error}. Choose another port"
            ) from error
        self._http.pilot, self._http.name, self._http.owned_by = pilot, name, owned_by
        self._thread: threading.Thread | None = None

    @property
    def port(self) -> int:
        return int(self._http.server_address[1])

    @property
    def base_url(self) -> str:
        """The base URL for an OpenAI client, without a slash at the end: `http://127.0.0.1:PORT/v1`."""
        host = str(self._http.server_address[0])
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/v1"

    def start(self) -> "PilotServer":
        """Start to serve in a daemon thread, and return self."""
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._http.serve_forever, kwargs={"poll_interval": 0.05}, name="pilot-server", daemon=True
            )
            self._thread.start()
        return self

    def close(self) -> None:
        """Stop serving and free the port. May be called more than once."""
        if self._thread is not None:
            self._http.shutdown()
            self._thread.join()
            self._thread = None
        self._http.server_close()

    def __enter__(self) -> "PilotServer":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotConfig:
    """The configuration of a pilot in a child process."""

    pilot: str  # name of the pilot (`dronecats.pilots.roster`)
    port: int = 0  # TCP port; 0: the system chooses one


class PilotPart:
    """The endpoint of a pilot, with the interface `Part` of child processes (`dronecats.flight.processes.child`)."""

    def __init__(self, config: PilotConfig) -> None:
        """Raises UsageError if the pilot replays a file that has no replies."""
        name = config.pilot
        self._server = PilotServer(roster.answer(name), name, owned_by=roster.owner(name), port=config.port).start()

    def ready(self) -> dict[str, Any]:
        return {"base_url": self._server.base_url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        return None

    def turn(self) -> None:
        time.sleep(0.05)  # the server runs in its own thread; this thread only polls for the parent's commands

    def close(self) -> None:
        self._server.close()


def read_request(body: bytes) -> tuple[str, list[bytes]]:
    """Return (prompt text, images) of a chat completion request. Raises UsageError for an invalid request."""
    try:
        request = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise UsageError("The body is not JSON.") from error
    if not isinstance(request, dict):
        raise UsageError("The body must be a JSON object.")
    if not isinstance(request.get("model"), str):
        raise UsageError("`model` must be a string.")
    if request.get("stream"):
        raise UsageError("`stream` is not supported: request the whole reply.")
    messages = request.get("messages")
    if not isinstance(messages, list) or not messages:
        raise UsageError("`messages` must be a list with at least one message.")
    texts: list[str] = []
    images: list[bytes] = []
    for message in messages:
        if not isinstance(message, dict) or message.get("role") not in ("system", "developer", "user", "assistant"):
            raise UsageError("Every message must be an object with the role system, developer, user or assistant.")
        if message["role"] != "assistant":
            _read_content(message.get("content"), texts, images)
    return "\n".join(texts), images


def _read_content(content: Any, texts: list[str], images: list[bytes]) -> None:
    if isinstance(content, str):
        texts.append(content)
        return
    if not isinstance(content, list):
        raise UsageError("`content` must be a string or a list of parts.")
    for part in content:
        kind = part.get("type") if isinstance(part, dict) else None
        if kind == "text" and isinstance(part.get("text"), str):
            texts.append(part["text"])
        elif kind == "image_url":
            if len(images) >= _MAX_IMAGES:
                raise UsageError(f"A request carries at most {_MAX_IMAGES} images.")
            images.append(_image(part.get("image_url")))
        else:
            raise UsageError("A content part must be a `text` or an `image_url`.")


def _image(value: Any) -> bytes:
    url = value.get("url") if isinstance(value, dict) else value
    if not isinstance(url, str) or not url.startswith("data:image/") or ";base64," not in url[:64]:
        raise UsageError("`image_url.url` must be a base64 data URL of an image, because this server fetches nothing.")
    try:
        return base64.b64decode(url.split(",", 1)[1], validate=True)
    except (binascii.Error, ValueError) as error:
        raise UsageError("The image's base64 is broken.") from error


def completion(model: str, body: bytes, prompt: str, images: list[bytes], text: str) -> dict[str, Any]:
    """Return the chat.completion object of a reply. The id is a digest of the request; token counts are estimates."""
    prompt_tokens = tokens_of_text(prompt) + IMAGE_TOKENS * len(images)
    completion_tokens = tokens_of_text(text)
    return {
        "id": "chatcmpl-" + hashlib.sha256(body).hexdigest()[:24],
        "object": "chat.completion",
        "created": 0,  # deterministic
        "model": model,
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": "stop"}],
        "usage": {
            "prompt_tokens": prompt_tokens,
            "completion_tokens": completion_tokens,
            "total_tokens": prompt_tokens + completion_tokens,
        },
    }


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    pilot: Pilot
    name: str
    owned_by: str

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print no error: the usual cause is a client that disconnected during its request."""


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    protocol_version = "HTTP/1.1"  # keep-alive: a control loop sends several requests a second
    timeout = _IDLE_S

    def setup(self) -> None:
        super().setup()
        # send a reply at once, without waiting for the client to acknowledge the previous one
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def do_GET(self) -> None:
        if self._is_at("/v1/models"):
            model = {"id": self.server.name, "object": "model", "created": 0, "owned_by": self.server.owned_by}
            self._send(HTTPStatus.OK, {"object": "list", "data": [model]})

    def _is_at(self, path: str) -> bool:
        """Return whether the request is for `path`; refuse it if not."""
        is_at = self.path.split("?")[0].rstrip("/") == path
        if not is_at:
            self._refuse(HTTPStatus.NOT_FOUND, "This server has only /v1/models and /v1/chat/completions.")
        return is_at

    def do_POST(self) -> None:
        body = self._body()
        if body is None or not self._is_at("/v1/chat/completions"):
            return
        try:
            prompt, images = read_request(body)
            text = self.server.pilot(prompt, images)
        except UsageError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except Exception as error:  # the client gets the pilot's error instead of a closed connection
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, f"The pilot failed: {type(error).__name__}: {error}")
        else:
            self._send(HTTPStatus.OK, completion(self.server.name, body, prompt, images, text))

    def _body(self) -> bytes | None:
        """Return the request body; None, and the connection closes, if the length is missing, too large or wrong."""
        declared = self.headers.get("Content-Length", "")
        if not (declared.isascii() and declared.isdigit()) or len(declared) > 18:
            self.close_connection = True
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "The request needs a Content-Length.")
            return None
        if int(declared) > MAX_BODY_BYTES:
            self._discard(min(int(declared), 4 * MAX_BODY_BYTES))  # clients read the error after sending the body
            self.close_connection = True
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"A body has at most {MAX_BODY_BYTES} bytes.")
            return None
        body = self.rfile.read(int(declared))
        if len(body) < int(declared):
            self.close_connection = True
            return None
        return body

    def _discard(self, count: int) -> None:
        while count > 0:
            piece = self.rfile.read(min(count, 1 << 16))
            if not piece:
                return
            count -= len(piece)

    def _refuse(self, status: HTTPStatus, message: str) -> None:
        kind = "server_error" if status >= 500 else "invalid_request_error"
        self._send(status, {"error": {"message": message, "type": kind, "param": None, "code": None}})

    def _send(self, status: HTTPStatus, payload: dict[str, Any]) -> None:
        data = json.dumps(payload).encode()
        self.send_response_only(status)  # without the Date header: same request, same bytes
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        if self.close_connection:
            self.send_header("Connection", "close")
        with contextlib.suppress(ConnectionError, TimeoutError):
            self._headers_buffer.append(b"\r\n" + data)  # type: ignore[attr-defined]
            self.flush_headers()

    def log_message(self, *_: Any) -> None:
        """Print nothing."""
