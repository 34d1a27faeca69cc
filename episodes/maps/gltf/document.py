"""Reads and writes the parts of glTF files: GLB container, JSON, arrays and axes. Every number that is read is checked.

Source: glTF 2.0, sections 3.6.2 and 4.4. glTF has +X right, +Y up and −Z ahead. Maps have NED axes, and their assets
have FRD axes. All lengths are in metres.
"""

import base64
import binascii
import json
import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from foundation.errors import UsageError
from foundation.files import file_errors_as

_F = TypeVar("_F", np.float32, np.float64)

# NED or FRD = AXES @ glTF. AXES is a rotation, so the winding of triangles does not change.
AXES = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

MAX_BYTES = 256 * 2**20  # limit of a file's size
MAX_JSON_BYTES = 32 * 2**20
MAX_JSON_OBJECTS = 1_000_000  # lists and objects in the JSON; they determine the memory that decoding takes
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942

LIMITS = {  # table → largest number of entries
    "scenes": 1_000,
    "nodes": 50_000,
    "meshes": 50_000,
    "accessors": 250_000,
    "bufferViews": 250_000,
    "buffers": 100,
    "materials": 20_000,
    "textures": 5_000,
    "images": 2_000,
}
# files that require other extensions are rejected: ignoring these would change the meaning of the file
SUPPORTED = frozenset(
    {
        "KHR_materials_unlit",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_emissive_strength",
        "KHR_materials_specular",
        "KHR_materials_ior",
        "KHR_materials_clearcoat",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_materials_sheen",
        "KHR_materials_variants",
        "KHR_lights_punctual",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_xmp_json_ld",
    }
)
# extension → advice
REMEDY = {
    "KHR_draco_mesh_compression": "export it without Draco compression",
    "EXT_meshopt_compression": "export it without meshopt compression",
    "KHR_texture_basisu": "export it with PNG or JPEG textures",
    "EXT_texture_webp": "export it with PNG or JPEG textures",
    "EXT_mesh_gpu_instancing": "export it without GPU instancing",
}

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def from_gltf(xyz: NDArray[_F]) -> NDArray[_F]:
    """Convert vectors (…, 3) from glTF axes to NED or FRD. Only signs and order change, so the numbers stay exact."""
    turned: NDArray[_F] = np.stack([-xyz[..., 2], xyz[..., 0], -xyz[..., 1]], axis=-1) + xyz.dtype.type(
        0
    )  # + 0: no negative zeros
    return turned


def to_gltf(frd: NDArray[_F]) -> NDArray[_F]:
    """Convert vectors (…, 3) from NED or FRD to glTF axes, exactly."""
    turned: NDArray[_F] = np.stack([frd[..., 1], -frd[..., 2], -frd[..., 0]], axis=-1) + frd.dtype.type(0)
    return turned


def read_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return (the JSON object, the binary chunk or b"") of a .glb. Raises UsageError for any other file."""
    with file_errors_as(UsageError, f"map file '{path}' cannot be read", "."):
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
                else:  # the specification requires that other chunks are ignored
                    file.seek(span, 1)
    return _document(path, text), binary


def pack_glb(document: dict[str, Any], binary: bytes) -> bytes:
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
    except (ValueError, RecursionError) as error:  # malformed, not UTF-8, huge integers, deep nesting
        _refuse(path, f"has JSON that cannot be read: {str(error).split(';')[0].split(': line')[0].rstrip('.')}")
    if not isinstance(tree, dict):
        _refuse(path, "has JSON that is not an object")
    return tree


class Document:
    """A glTF document. All methods that read raise UsageError with the file, the place and the reason."""

    def __init__(self, path: Path) -> None:
        """Read the container and the tables of a file."""
        self.source = str(path)
        self.tree, self._binary = read_glb(path)
        self._decoded: dict[str, bytes] = {}
        version = self.mapping(self.tree, "asset", "asset").get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            self.fail("asset.version", f"is {quoted(version)}; glTF 2.0 is read")
        self._lists = {name: self.objects(self.tree, name, name, limit) for name, limit in LIMITS.items()}
        required = self.tree.get("extensionsRequired", [])
        for name in required if isinstance(required, list) else [required]:
            if not isinstance(name, str) or name not in SUPPORTED:
                remedy = REMEDY.get(str(name), "export it without")
                self.fail("extensionsRequired", f"asks for {quoted(name)}, which is not supported: {remedy}")

    def fail(self, where: str, reason: str) -> NoReturn:
        """Raise UsageError about one place of the file."""
        raise UsageError(f"map file '{self.source}': {where} {reason}.")

    def count(self, table: str) -> int:
        """Return how many entries one of the document's tables has."""
        return len(self._lists[table])

    def entry(self, table: str, index: Any, where: str) -> Mapping[str, Any]:
        """Return an entry of a table by its index. `where` is the place of the index in the file, for errors."""
        rows = self._lists[table]
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(rows):
            self.fail(where, f"is {quoted(index)}, but there are {len(rows)} {table}")
        return rows[index]

    def objects(self, parent: Mapping[str, Any], key: str, where: str, limit: int) -> list[Mapping[str, Any]]:
        """Return a list of objects; [] if it is absent."""
        value = parent.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail(where, "is not a list of objects")
        if len(value) > limit:
            self.fail(where, f"has {len(value)} entries; {limit} are allowed")
        return value

    def mapping(self, parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
        """Return an object; {} if it is absent."""
        value = parent.get(key, {})
        if not isinstance(value, dict):
            self.fail(where, "is not an object")
        return value

    def extension(self, parent: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any] | None:
        """Return an extension of an object, or None."""
        extensions = self.mapping(parent, "extensions", f"{where}.extensions")
        return self.mapping(extensions, name, f"{where}.extensions.{name}") if name in extensions else None

    def natural(self, parent: Mapping[str, Any], key: str, where: str, default: int | None = None) -> int:
        """Return a whole number ≥ 0; `default` if it is absent. Without a default, it must not be absent."""
        value = parent.get(key, default)
        if isinstance(value, float) and value.is_integer():  # some exporters write 3.0
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**32:
            self.fail(f"{where}.{key}", "is missing" if value is None else f"is {quoted(value)}, not a whole number")
        return value

    def numbers(self, parent: Mapping[str, Any], key: str, where: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return finite numbers, as many as `default` has; `default` if they are absent."""
        value = parent.get(key, default)
        if not isinstance(value, list | tuple) or len(value) != len(default):
            self.fail(f"{where}.{key}", f"is not a list of {len(default)} numbers")
        return tuple(self._finite(v, f"{where}.{key}") for v in value)

    def number(self, parent: Mapping[str, Any], key: str, where: str, default: float) -> float:
        """Return a finite number; `default` if it is absent."""
        return self._finite(parent.get(key, default), f"{where}.{key}")

    def _finite(self, value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(where, f"is {quoted(value)}, not a number")
        if not abs(value) < 1e30:  # false for nan and inf; exact for integers of any size
            self.fail(where, f"is {quoted(value)}, which is not finite")
        return float(value)

    def view(self, index: Any, where: str) -> tuple[memoryview, int | None]:
        """Return (the bytes of a bufferView, its stride if it has one)."""
        view = self.entry("bufferViews", index, where)
        name = f"bufferViews[{index}]"
        if self.extension(view, "EXT_meshopt_compression", name) is not None:
            self.fail(name, f"is compressed: {REMEDY['EXT_meshopt_compression']}")
        data = self._buffer(view.get("buffer"), f"{name}.buffer")
        start = self.natural(view, "byteOffset", name, 0)
        length = self.natural(view, "byteLength", name)
        if start + length > len(data):
            self.fail(name, f"ends at byte {start + length} of a buffer of {len(data)}")
        stride = self.natural(view, "byteStride", name) if "byteStride" in view else None
        return memoryview(data)[start : start + length], stride

    def _buffer(self, index: Any, where: str) -> bytes:
        buffer = self.entry("buffers", index, where)
        name = f"buffers[{index}]"
        declared = self.natural(buffer, "byteLength", name)
        data = self.data(buffer["uri"], f"{name}.uri") if "uri" in buffer else self._binary
        if declared > len(data):
            self.fail(name, f"declares {declared} bytes but {len(data)} are there")
        return data

    def data(self, uri: Any, where: str) -> bytes:
        """Return the bytes of a data: URI; they are decoded once. Raises UsageError for a URI of another file."""
        if where not in self._decoded:
            head, comma, body = uri.partition(",") if isinstance(uri, str) else ("", "", "")
            if not (head.startswith("data:") and comma and head.endswith(";base64")):
                self.fail(where, f"is {quoted(uri)}: a map is one file, so export it with everything embedded")
            try:
                self._decoded[where] = base64.b64decode(body, validate=True)
            except (binascii.Error, ValueError):
                self.fail(where, "is not valid base64")
        return self._decoded[where]

    def name_of(self, parent: Mapping[str, Any]) -> str:
        """Return an object's name as short printable text; "" if it has none."""
        value = parent.get("name")
        if not isinstance(value, str):
            return ""
        return "".join(c for c in value if c.isprintable() and not 0xD800 <= ord(c) <= 0xDFFF).strip()[:64]


def quoted(value: Any) -> str:
    """Return a value for an error message, short and on one line."""
    if isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "an object"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**20:
        return f"a number of {int(math.log10(abs(value))) + 1} digits"
    text = repr(value[:64] if isinstance(value, str) else value)
    return text if len(text) <= 60 else text[:57] + "..."


def element_count(document: Document, index: Any, where: str) -> int:
    """Return how many elements an accessor declares, without reading them."""
    entry = document.entry("accessors", index, where)
    return document.natural(entry, "count", f"accessors[{index}]")


def vectors(document: Document, index: Any, where: str, *widths: int) -> NDArray[np.float32]:
    """Return an accessor's vectors (count, width) as floats. Integers are scaled if the accessor is normalised.

    Raises UsageError unless the width is one of `widths`, all data are in the file and all numbers are finite.
    """
    raw, normalised = _elements(document, index, where, widths)
    if raw.dtype.kind == "f":
        if not np.isfinite(raw).all():
            document.fail(f"accessors[{index}]", "has numbers that are not finite")
        return raw.astype(np.float32)
    floats = raw.astype(np.float32)
    return np.maximum(floats / np.float32(np.iinfo(raw.dtype).max), np.float32(-1.0)) if normalised else floats


def indices(document: Document, index: Any, where: str, vertices: int) -> NDArray[np.int32]:
    """Return an accessor's (count,) indices. Raises UsageError unless all are below `vertices`."""
    raw, _ = _elements(document, index, where, (1,))
    if raw.dtype.kind != "u":
        document.fail(f"accessors[{index}]", "has indices that are not unsigned whole numbers")
    if raw.size and int(raw.max()) >= vertices:
        document.fail(f"accessors[{index}]", f"points at vertex {int(raw.max())} of {vertices}")
    return raw[:, 0].astype(np.int32)


def _elements(document: Document, index: Any, where: str, widths: tuple[int, ...]) -> tuple[NDArray[Any], bool]:
    """Return an accessor's elements (count, width) as a view of the file, and whether they are normalised."""
    entry = document.entry("accessors", index, where)
    name = f"accessors[{index}]"
    if "sparse" in entry:
        document.fail(name, "is sparse, which is not supported: export it without sparse accessors")
    if "bufferView" not in entry:
        document.fail(name, "has no bufferView, so there is nothing in it")
    component, kind = entry.get("componentType"), entry.get("type")
    if not isinstance(component, int) or component not in COMPONENTS:
        document.fail(f"{name}.componentType", "is none that glTF knows")
    if not isinstance(kind, str) or WIDTHS.get(kind) not in widths:
        document.fail(f"{name}.type", f"does not suit {where}")
    dtype, width = np.dtype(COMPONENTS[component]), WIDTHS[kind]
    view, stride = document.view(entry["bufferView"], f"{name}.bufferView")
    stride = stride or dtype.itemsize * width
    total, offset = element_count(document, index, where), document.natural(entry, "byteOffset", name, 0)
    if stride < dtype.itemsize * width:
        document.fail(name, f"steps by {stride} bytes over elements of {dtype.itemsize * width}")
    if total == 0:
        document.fail(name, "is empty")
    if offset + stride * (total - 1) + dtype.itemsize * width > len(view):
        document.fail(name, f"declares {total} elements, more than its {len(view)} bytes hold")
    elements = np.ndarray((total, width), dtype, view, offset, (stride, dtype.itemsize))
    return elements, entry.get("normalized") is True
