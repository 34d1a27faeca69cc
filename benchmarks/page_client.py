"""A client of a live page, used instead of a browser. It receives everything that the page sends."""

import time
from typing import Any

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.typing import Subprotocol

HEAD = 16  # bytes of a delivery's header: size, compressed size
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 5.0), "fov": 1.0,
    "near": 0.1, "far": 1000.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 1.0, 0.0),
}  # fmt: skip


class PageClient:
    """Connects as a browser does, sends a camera pose (CAMERA), and receives messages."""

    def __init__(self, url: str) -> None:
        """`url` is the address of the page. Raises OSError if the page is not served."""
        address = url.replace("http://", "ws://")
        protocol = Subprotocol(f"viser-v{viser.__version__}")
        self._socket = connect(address, subprotocols=[protocol], max_size=None, compression=None)
        self.bytes = 0  # received so far
        self.send(CAMERA)

    def send(self, message: dict[str, Any]) -> None:
        """Send a message to the page."""
        self._socket.send(msgspec.msgpack.encode(message))

    def receive(self, timeout_s: float) -> list[dict[str, Any]]:
        """Return the messages of the next delivery (WebSocket frame), if any. Raises OSError, ConnectionClosed."""
        try:
            data = self._socket.recv(timeout_s)
        except TimeoutError:
            return []
        assert isinstance(data, bytes)
        self.bytes += len(data)
        return decoded(data)

    def until(self, wanted: Any, timeout_s: float) -> list[dict[str, Any]]:
        """Return all messages up to the end of the first delivery that has a message for which `wanted` is true.

        Raises TimeoutError if there is none within `timeout_s`.
        """
        due_s, messages = time.monotonic() + timeout_s, []
        while True:
            left_s = due_s - time.monotonic()
            if left_s <= 0.0:
                raise TimeoutError
            new = self.receive(left_s)
            messages += new
            if any(wanted(message) for message in new):
                return messages

    def close(self) -> None:
        self._socket.close()


def decoded(delivery: bytes) -> list[dict[str, Any]]:
    """Return the messages in one delivery of a page. Arrays are not decoded: a number replaces each array."""
    size, packed = (int.from_bytes(delivery[at : at + 8], "little") for at in (0, 8))
    inner = zstandard.ZstdDecompressor().decompress(delivery[HEAD : HEAD + packed], max_output_size=size)
    return list(msgspec.msgpack.decode(inner)["messages"])
