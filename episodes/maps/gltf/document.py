"""The JSON of a glTF file, read with every number checked before anything is done with it."""

import base64
import binascii
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from episodes.maps.gltf import container
from foundation.errors import UsageError

LIMITS = {
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
# a required extension that is not here changes what the file means, so that it cannot be read without
KNOWN = frozenset(
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
REMEDY = {
    "KHR_draco_mesh_compression": "export it without Draco compression",
    "EXT_meshopt_compression": "export it without meshopt compression",
    "KHR_texture_basisu": "export it with PNG or JPEG textures",
    "EXT_texture_webp": "export it with PNG or JPEG textures",
    "EXT_mesh_gpu_instancing": "export it without GPU instancing",
}


class Document:
    """A glTF document. Every reader raises UsageError that names the file, the place and the reason."""

    def __init__(self, path: Path) -> None:
        """Read the container and the tables of a file."""
        self.source = str(path)
        self.tree, self._binary = container.read(path)
        self._decoded: dict[str, bytes] = {}
        version = self.mapping(self.tree, "asset", "asset").get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            self.fail("asset.version", f"is {quoted(version)}; glTF 2.0 is read")
        self._lists = {name: self.objects(self.tree, name, name, limit) for name, limit in LIMITS.items()}
        required = self.tree.get("extensionsRequired", [])
        for name in required if isinstance(required, list) else [required]:
            if not isinstance(name, str) or name not in KNOWN:
                remedy = REMEDY.get(str(name), "export it without")
                self.fail("extensionsRequired", f"asks for {quoted(name)}, which is not supported: {remedy}")

    def fail(self, where: str, reason: str) -> NoReturn:
        """Raise UsageError about one place of the file."""
        raise UsageError(f"map file '{self.source}': {where} {reason}.")

    def count(self, table: str) -> int:
        """Return how many entries one of the document's tables has."""
        return len(self._lists[table])

    def entry(self, table: str, index: Any, where: str) -> Mapping[str, Any]:
        """Return an entry of a table of the document by the index that `where` names."""
        rows = self._lists[table]
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(rows):
            self.fail(where, f"is {quoted(index)}, but there are {len(rows)} {table}")
        return rows[index]

    def objects(self, parent: Mapping[str, Any], key: str, where: str, limit: int) -> list[Mapping[str, Any]]:
        """Return a list of objects; [] when it is absent."""
        value = parent.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail(where, "is not a list of objects")
        if len(value) > limit:
            self.fail(where, f"has {len(value)} entries; {limit} are allowed")
        return value

    def mapping(self, parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
        """Return an object; {} when it is absent."""
        value = parent.get(key, {})
        if not isinstance(value, dict):
            self.fail(where, "is not an object")
        return value

    def extension(self, parent: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any] | None:
        """Return an extension of an object, or None."""
        extensions = self.mapping(parent, "extensions", f"{where}.extensions")
        return self.mapping(extensions, name, f"{where}.extensions.{name}") if name in extensions else None

    def whole(self, parent: Mapping[str, Any], key: str, where: str, default: int | None = None) -> int:
        """Return a whole number ≥ 0."""
        value = parent.get(key, default)
        if isinstance(value, float) and value.is_integer():  # some exporters write 3.0
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**32:
            self.fail(f"{where}.{key}", "is missing" if value is None else f"is {quoted(value)}, not a whole number")
        return value

    def numbers(self, parent: Mapping[str, Any], key: str, where: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return as many finite numbers as the default has."""
        value = parent.get(key, default)
        if not isinstance(value, list | tuple) or len(value) != len(default):
            self.fail(f"{where}.{key}", f"is not a list of {len(default)} numbers")
        return tuple(self._finite(v, f"{where}.{key}") for v in value)

    def number(self, parent: Mapping[str, Any], key: str, where: str, default: float) -> float:
        """Return a finite number."""
        return self._finite(parent.get(key, default), f"{where}.{key}")

    def _finite(self, value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(where, f"is {quoted(value)}, not a number")
        if not abs(value) < 1e30:  # false for nan and inf, and exact for whole numbers of any size
            self.fail(where, f"is {quoted(value)}, which is not finite")
        return float(value)

    def view(self, index: Any, where: str) -> tuple[memoryview, int | None]:
        """Return (the bytes of a bufferView, its stride if it has one)."""
        view = self.entry("bufferViews", index, where)
        name = f"bufferViews[{index}]"
        if self.extension(view, "EXT_meshopt_compression", name) is not None:
            self.fail(name, f"is compressed: {REMEDY['EXT_meshopt_compression']}")
        data = self._buffer(view.get("buffer"), f"{name}.buffer")
        start = self.whole(view, "byteOffset", name, 0)
        length = self.whole(view, "byteLength", name)
        if start + length > len(data):
            self.fail(name, f"ends at byte {start + length} of a buffer of {len(data)}")
        stride = self.whole(view, "byteStride", name) if "byteStride" in view else None
        return memoryview(data)[start : start + length], stride

    def _buffer(self, index: Any, where: str) -> bytes:
        buffer = self.entry("buffers", index, where)
        name = f"buffers[{index}]"
        declared = self.whole(buffer, "byteLength", name)
        data = self.data(buffer["uri"], f"{name}.uri") if "uri" in buffer else self._binary
        if declared > len(data):
            self.fail(name, f"declares {declared} bytes but {len(data)} are there")
        return data

    def data(self, uri: Any, where: str) -> bytes:
        """Return the bytes of a data: URI, decoded once. Nothing outside the file is ever opened."""
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
        """Return an object's name as short printable text; "" when it has none."""
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
