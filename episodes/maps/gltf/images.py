"""Pictures inside a glTF file. Their sizes are read from their headers first, so that none is decoded for its bulk."""

import struct
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf.document import REMEDY, Document

MAX_SIDE = 8192
MAX_TEXELS = 48 * 2**20  # of all pictures of a map together, after they are reduced
SIDES = (2048, 1024, 512, 256, 128, 64, 32, 16)  # the largest side is the first at which the pictures keep to that
OPAQUE_FROM = 128  # alpha below which a texel of a cut-out texture does not count

Picture = NDArray[np.uint8]


def encode(picture: Picture) -> bytes:
    """Return an (H, W, 3) sRGB picture as PNG, which keeps every bit."""
    done, data = cv2.imencode(".png", picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise ValueError("the picture cannot be encoded")
    return data.tobytes()


class Images:
    """The pictures of one file, decoded on demand and once."""

    def __init__(self, document: Document, used: Iterable[int]) -> None:
        """Measure the pictures that will be used. Raises UsageError for one that is too large or of another format."""
        self._document = document
        self._kept: dict[tuple[int, bool], Picture] = {}
        self._data = {k: self._bytes_of(k) for k in sorted(set(used))}
        self._sizes = {k: self._measured(k, data) for k, data in self._data.items()}
        for self._side in SIDES:
            shrunk = (min(1.0, self._side / max(w, h)) for w, h in self._sizes.values())
            areas = (w * h * s * s for (w, h), s in zip(self._sizes.values(), shrunk, strict=True))
            if sum(areas) <= MAX_TEXELS:
                break

    def picture(self, index: int, cut_out: bool) -> Picture:
        """Return an image as (H, W, 3) sRGB. Of a cut-out one the transparent texels get its mean colour.

        Nothing is transparent for our renderer; what lies under transparent texels is often black or white and would
        show as specks around leaves.
        """
        key = (index, cut_out)
        if key not in self._kept:
            self._kept[key] = self._decoded(index, cut_out)
        return self._kept[key]

    def _bytes_of(self, index: int) -> bytes:
        image, where = self._document.entry("images", index, "source"), f"images[{index}]"
        if "uri" in image:
            return self._document.data(image["uri"], f"{where}.uri")
        return bytes(self._document.view(image.get("bufferView"), f"{where}.bufferView")[0])

    def _measured(self, index: int, data: bytes) -> tuple[int, int]:
        size = png_size(data) or jpeg_size(data)
        if size is None:
            self._document.fail(f"images[{index}]", f"is neither PNG nor JPEG: {REMEDY['KHR_texture_basisu']}")
        if not 0 < min(size) <= max(size) <= MAX_SIDE:
            self._document.fail(
                f"images[{index}]", f"is {size[0]}×{size[1]} pixels; a side of 1 … {MAX_SIDE} is allowed"
            )
        return size

    def _decoded(self, index: int, cut_out: bool) -> Picture:
        try:
            raw = cv2.imdecode(np.frombuffer(self._data[index], np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            raw = None
        width, height = self._sizes[index]
        if raw is None or raw.shape[:2] != (height, width) or raw.dtype not in (np.uint8, np.uint16):
            self._document.fail(f"images[{index}]", "is damaged: it cannot be decoded")
        if raw.dtype == np.uint16:
            raw = (raw >> 8).astype(np.uint8)
        if raw.ndim == 2:
            raw = np.repeat(raw[..., None], 3, axis=2)
        shrink = self._side / max(width, height)
        if shrink < 1.0:
            size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
            raw = cv2.resize(raw, size, interpolation=cv2.INTER_AREA)
        picture = np.ascontiguousarray(raw[..., 2::-1])
        if cut_out and raw.shape[2] == 4:
            solid = raw[..., 3] >= OPAQUE_FROM
            if solid.any():
                picture[~solid] = picture[solid].mean(axis=0).astype(np.uint8)
        return picture


def png_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) that a PNG declares, or None when it is none. Source: PNG, section 11.2.2."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) that a JPEG declares, or None when it is none. Source: ITU-T T.81, annex B."""
    if data[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2 : at + 4])[0]
        if marker == 0xFF:  # fill byte
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + length
    return None


def source_of(document: Document, texture: Any, where: str) -> int:
    """Return the index of the image that a texture shows."""
    entry = document.entry("textures", texture, where)
    if "source" not in entry:
        document.fail(f"textures[{texture}]", f"has no PNG or JPEG source: {REMEDY['KHR_texture_basisu']}")
    document.entry("images", entry["source"], f"textures[{texture}].source")
    return int(entry["source"])
