"""Writes a map as a binary glTF file. The same scene gives the same bytes."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf import extras, materials
from episodes.maps.gltf.document import pack_glb, to_gltf
from episodes.maps.gltf.meshes import compact
from episodes.maps.scene import Instance, Material, Mesh, Scene

_FLOAT, _SHORT, _INT = 5126, 5123, 5125  # component types of an accessor
_VERTICES, _INDICES = 34962, 34963  # targets of a bufferView
_LAST_SHORT = 65535  # glTF reserves this index for primitive restart


def save(scene: Scene, path: Path) -> None:
    """Write a map to a .glb that `load` reads back as the same scene and that other programs can show.

    A mesh that several instances share is written once. Consecutive triangles of one material are a primitive, so the
    triangles keep their order, on which the bytes of rendered pictures depend. Instances without triangles are left
    out, and `Instance.attitude` is not written.
    """
    path.write_bytes(to_bytes(scene))


def to_bytes(scene: Scene) -> bytes:
    """Return the bytes of the .glb of a map."""
    return _Writer().pack(scene)


class _Writer:
    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._row_of: dict[int, int] = {}  # identity of a mesh or material → its index in the file
        self._image_of: dict[tuple[int, int], int] = {}  # identities of a picture and its cutout → index

    def pack(self, scene: Scene) -> bytes:
        nodes = [self._node(instance) for instance in scene.instances if len(instance.mesh.triangles)]
        heights = np.ascontiguousarray(scene.terrain.down, "<f8").tobytes()
        facts = extras.of_scene(scene, self._view(heights), heights)
        document = {
            "asset": {"version": "2.0", "generator": "DroneCATS"},
            "scene": 0,
            "scenes": [{"name": scene.name, "nodes": list(range(len(nodes))), "extras": facts}],
            "nodes": nodes,
            "meshes": self._meshes,
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._binary)}],
        }
        if self._images:  # glTF allows no empty lists
            document["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]
            document["textures"] = [{"sampler": 0, "source": k} for k in range(len(self._images))]
            document["images"] = self._images
        return pack_glb(document, bytes(self._binary))

    def _node(self, instance: Instance) -> dict[str, Any]:
        place = to_gltf(np.array(instance.position_ned, np.float64))
        node: dict[str, Any] = {"name": instance.name, "mesh": self._mesh(instance), "translation": place.tolist()}
        if instance.yaw != 0.0:
            # a turn clockwise seen from above is a turn by −yaw about +Y
            node["rotation"] = [0.0, -math.sin(instance.yaw / 2) + 0.0, 0.0, math.cos(instance.yaw / 2)]
        return {**node, "extras": extras.of_instance(instance)}

    def _mesh(self, instance: Instance) -> int:
        mesh = instance.mesh
        if id(mesh) not in self._row_of:
            primitives = self._primitives(compact(mesh))
            self._row_of[id(mesh)] = len(self._meshes)
            self._meshes.append({"name": instance.kind, "primitives": primitives})
        return self._row_of[id(mesh)]

    def _primitives(self, mesh: Mesh) -> list[dict[str, Any]]:
        position = to_gltf(mesh.vertices.astype(np.float32))
        attributes = {
            "POSITION": self._vectors(position, low_and_high=True),
            "NORMAL": self._vectors(to_gltf(mesh.normals.astype(np.float32))),
            "TEXCOORD_0": self._vectors(mesh.uv.astype(np.float32)),
        }
        short = len(position) <= _LAST_SHORT
        order = np.ascontiguousarray(mesh.triangles, "<u2" if short else "<u4")
        view = self._view(order.tobytes(), _INDICES)
        ends = [*(np.flatnonzero(np.diff(mesh.material)) + 1).tolist(), len(order)]
        primitives, first = [], 0
        for end in ends:
            accessor = {
                "bufferView": view,
                "byteOffset": 3 * first * order.itemsize,
                "componentType": _SHORT if short else _INT,
                "count": 3 * (end - first),
                "type": "SCALAR",
            }
            self._accessors.append(accessor)
            material = self._material(mesh.materials[mesh.material[first]])
            primitives.append(
                {"attributes": attributes, "indices": len(self._accessors) - 1, "material": material, "mode": 4}
            )
            first = end
        return primitives

    def _vectors(self, values: NDArray[np.float32], low_and_high: bool = False) -> int:
        accessor: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(values, "<f4").tobytes(), _VERTICES),
            "componentType": _FLOAT,
            "count": len(values),
            "type": f"VEC{values.shape[1]}",
        }
        if low_and_high:  # the specification requires them for every POSITION
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def _material(self, material: Material) -> int:
        if id(material) not in self._row_of:
            fields = materials.standard(material)
            if material.texture is not None:
                texture = {"index": self._image(material.texture, material.cutout)}
                fields["pbrMetallicRoughness"]["baseColorTexture"] = texture
                if "emissiveFactor" in fields:
                    fields["emissiveTexture"] = texture
            look = (*material.color, material.emission, material.specular, material.drift, material.foliage)
            exact = [float(v) for v in look]
            self._row_of[id(material)] = len(self._materials)
            self._materials.append({"name": material.name, **fields, "extras": {materials.EXTRA: exact}})
        return self._row_of[id(material)]

    def _image(self, picture: NDArray[np.uint8], cutout: NDArray[np.bool_] | None) -> int:
        key = id(picture), id(cutout)
        if key not in self._image_of:
            self._image_of[key] = len(self._images)
            png = materials.encode(picture, cutout)
            self._images.append({"mimeType": "image/png", "bufferView": self._view(png)})
        return self._image_of[key]

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._binary += b"\0" * (-len(self._binary) % 8)
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._views.append(view if target is None else {**view, "target": target})
        self._binary += data
        return len(self._views) - 1
