"""Builds glTF files field by field. Tests can write files that no exporter would write."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}

LAWN = np.array([(-20, 0, 20), (20, 0, 20), (20, 0, -20), (-20, 0, -20)], np.float32)  # glTF axes, faces up
SQUARE = np.array([0, 1, 2, 0, 2, 3])


class Glb:
    """A GLB file under construction. Tests may change `doc` before they call `write`."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.doc: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews", "textures", "images")},
        }

    def view(self, data: bytes, **fields: Any) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.doc["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **fields})
        self.binary += data
        return len(self.doc["bufferViews"]) - 1

    def accessor(self, values: Any, component: str = "f4", **fields: Any) -> int:
        array = np.asarray(values).astype(f"<{component}")
        array = array.reshape(len(array), -1)
        entry = {"bufferView": self.view(array.tobytes()), "componentType": COMPONENTS[component]}
        self.doc["accessors"].append({**entry, "count": len(array), "type": KINDS[array.shape[1]], **fields})
        return len(self.doc["accessors"]) - 1

    def primitive(
        self, positions: Any = LAWN, order: Any = SQUARE, component: str = "u2", **fields: Any
    ) -> dict[str, Any]:
        attributes = {"POSITION": self.accessor(positions), **fields.pop("attributes", {})}
        made: dict[str, Any] = {"attributes": attributes, **fields}
        if order is not None:
            made["indices"] = self.accessor(order, component)
        return made

    def mesh(self, *primitives: dict[str, Any]) -> int:
        self.doc["meshes"].append({"primitives": list(primitives)})
        return len(self.doc["meshes"]) - 1

    def node(self, root: bool = True, **fields: Any) -> int:
        self.doc["nodes"].append(fields)
        if root:
            self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)
        return len(self.doc["nodes"]) - 1

    def lawn(self) -> "Glb":
        """Add a square of 40 m at height 0."""
        self.node(name="Lawn", mesh=self.mesh(self.primitive()))
        return self

    def bytes(self) -> bytes:
        doc = {k: v for k, v in self.doc.items() if v != []}
        if "buffers" not in doc and self.binary:
            doc["buffers"] = [{"byteLength": len(self.binary)}]
        return container(json.dumps(doc).encode(), bytes(self.binary))

    def write(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path


def container(text: bytes, binary: bytes = b"") -> bytes:
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def block(size: tuple[float, float, float], colour: tuple[int, int, int] = (150, 150, 150)) -> Any:
    """Return a trimesh box (glTF axes) that stands at height 0. It has one base colour and no vertex colours."""
    import trimesh

    made = trimesh.creation.box(size)
    made.apply_translation((0.0, size[1] / 2, 0.0))
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*(c / 255 for c in colour), 1.0], metallicFactor=0.0, roughnessFactor=0.9
    )
    made.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(made.vertices), 2)), material=material)
    return made
