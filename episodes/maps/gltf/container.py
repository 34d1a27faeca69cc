"""The GLB container and its axes: a header, one chunk of JSON, one of binary data.

Source: glTF 2.0, section 4.4. glTF has +X right, +Y up and −Z ahead. Ours is north or forward, east or
right, down. Both are in metres.
"""

import json
import math
import struct
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from foundation.errors import UsageError

_F = TypeVar("_F", np.float32, np.float64)

# ours = AXES @ glTF's; a rotation, so what is wound counter-clockwise stays so
AXES = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def from_gltf(xyz: NDArray[_F]) -> NDArray[_F]:
    """Return vectors (…, 3) in our axes; signs and order change only, so the numbers stay exact."""
    turned: NDArray[_F] = np.stack([-xyz[..., 2], xyz[..., 0], -xyz[..., 1]], axis=-1) + xyz.dtype.type(
        0
    )  # + 0: no negative zeros
    return turned


def to_gltf(frd: NDArray[_F]) -> NDArray[_F]:
    """Return vectors (…, 3) in glTF's axes, exactly."""
    turned: NDArray[_F] = np.stack([frd[..., 1], -frd[..., 2], -frd[..., 0]], axis=-1) + frd.dtype.type(0)
    return turned


def linear_from_gltf(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a (3, 3) linear map of glTF's axes as the same map of ours."""
    return np.asarray(AXES @ matrix @ AXES.T)


def quaternion_of(yaw: float) -> list[float]:
    """Return glTF's (x, y, z, w) of a turn by `yaw` (rad, clockwise from above): counter-clockwise about +Y."""
    return [0.0, -math.sin(yaw / 2) + 0.0, 0.0, math.cos(yaw / 2)]


MAX_BYTES = 256 * 2**20  # of a whole file
MAX_JSON_BYTES = 32 * 2**20
MAX_JSON_OBJECTS = 1_000_000  # brackets in the JSON: what its decoded form costs goes with them, not with its bytes

_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def read(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return (the JSON object, the binary chunk or b"") of a .glb. Raises UsageError in one sentence."""
    try:
        if not path.is_file():
            raise UsageError(f"map file '{path}' does not exist or is not a regular file.")
        with path.open("rb") as file:
            size = path.stat().st_size
            if size > MAX_BYTES:
                _refuse(path, f"is {size / 2**20:.0f} MiB large; a map may have {MAX_BYTES // 2**20} MiB")
            head = file.read(_HEADER.size)
            if head[:1] == b"{":
                _refuse(path, "is glTF text: export it as one binary file (.glb)")
            if len(head) < _HEADER.size or head[:4] != b"glTF":
                _refuse(path, "is not a binary glTF file (.glb): it does not begin with 'glTF'")
            _, version, length = _HEADER.unpack(head)
            if version != 2:
                _refuse(path, f"is of glTF container version {version}; version 2 is read")
            if not _HEADER.size < length <= size:
                _refuse(path, f"declares {length} bytes but has {size}")
            text, binary, left = b"", b"", length - _HEADER.size
            while left >= _CHUNK.size:
                span, kind = _CHUNK.unpack(file.read(_CHUNK.size))
                left -= _CHUNK.size
                if span > left:
                    _refuse(path, f"has a chunk that declares {span} bytes where {left} are left")
                left -= span
                if kind == _JSON and not text:
                    if span > MAX_JSON_BYTES:
                        _refuse(path, f"has more than {MAX_JSON_BYTES // 2**20} MiB of JSON, which no map needs")
                    text = file.read(span)
                elif kind == _BIN and not binary:
                    binary = file.read(span)
                else:  # chunks of other kinds are to be ignored, says the specification
                    file.seek(span, 1)
    except OSError as error:
        raise UsageError(f"map file '{path}' cannot be read: {error.strerror}.") from None
    return _document(path, text), binary


def pack(document: dict[str, Any], binary: bytes) -> bytes:
    """Return the bytes of a .glb; the same document gives the same bytes."""
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = _CHUNK.pack(len(text), _JSON) + text + _CHUNK.pack(len(binary), _BIN) + binary
    return _HEADER.pack(b"glTF", 2, _HEADER.size + len(chunks)) + chunks


def _refuse(path: Path, reason: str) -> NoReturn:
    raise UsageError(f"map file '{path}' {reason}.")


def _document(path: Path, text: bytes) -> dict[str, Any]:
    def constant(name: str) -> NoReturn:
        _refuse(path, f"has {name} in its JSON, which is not a number that JSON allows")

    if text.count(b"[") + text.count(b"{") > MAX_JSON_OBJECTS:
        _refuse(path, f"has more than {MAX_JSON_OBJECTS} lists and objects in its JSON")
    try:
        tree = json.loads(text.decode("utf-8"), parse_constant=constant)
    except (ValueError, RecursionError) as error:  # malformed, not UTF-8, numbers of thousands of digits, nested deeply
        _refuse(path, f"has JSON that cannot be read: {str(error).split(';')[0].split(': line')[0].rstrip('.')}")
    if not isinstance(tree, dict):
        _refuse(path, "has JSON that is not an object")
    return tree
