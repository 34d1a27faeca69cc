"""Reads the meshes of a glTF file and its tree of nodes. All primitives of a glTF mesh become one `Mesh`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf.document import AXES, REMEDY, Document, element_count, from_gltf, indices, vectors
from episodes.maps.gltf.materials import TexturedMaterial
from episodes.maps.scene import Material, Mesh, turn
from foundation.frames import Vec3

MAX_VERTICES = 3_000_000  # limit of each mesh in the file, and of all meshes together without their unused vertices
MAX_READ = 20_000_000  # vertices read in total, before unused ones are removed
MAX_TRIANGLES = 1_000_000  # limit of the scene; a mesh counts once for each instance
MAX_COORDINATE_M = 1e6
TINTS = 31.0  # vertex colours are rounded to the levels 0 … 31 per channel; each rounded colour becomes a material

_POINTS_AND_LINES = (0, 1, 2, 3)
_TRIANGLES, _STRIP, _FAN = 4, 5, 6

MAX_DEPTH = 200
MAX_PLACE_M = 20_000.0
_EXACT = 1e-6  # tolerance of a matrix that counts as a pure yaw


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Vertices that primitives share."""

    first: int  # index of the block's first vertex in the new mesh
    position: NDArray[np.float32]  # (V, 3) m, FRD
    normal: NDArray[np.float32] | None
    uv: NDArray[np.float32]
    color: NDArray[np.float32] | None  # (V, 3) linear


def triangle_count(document: Document, index: int) -> int:
    """Return how many triangles a mesh declares, without reading them."""
    total = 0
    for k, primitive in enumerate(_primitives(document, index)):
        where = f"meshes[{index}].primitives[{k}]"
        mode = document.natural(primitive, "mode", where, _TRIANGLES)
        corners = element_count(document, _corner_accessor(document, primitive, where), where)
        total += 0 if mode in _POINTS_AND_LINES else corners // 3 if mode == _TRIANGLES else max(corners - 2, 0)
    return total


def materials_of(document: Document, index: int) -> set[int]:
    """Return the indices of the materials of a mesh."""
    return {
        document.natural(p, "material", f"meshes[{index}]") for p in _primitives(document, index) if "material" in p
    }


def _primitives(document: Document, index: int) -> list[Mapping[str, Any]]:
    return document.objects(
        document.entry("meshes", index, "mesh"), "primitives", f"meshes[{index}].primitives", 100_000
    )


def _corner_accessor(document: Document, primitive: Mapping[str, Any], where: str) -> Any:
    """Return the index of the accessor whose count is the number of corners of a primitive."""
    if document.extension(primitive, "KHR_draco_mesh_compression", where) is not None:
        document.fail(where, f"is compressed: {REMEDY['KHR_draco_mesh_compression']}")
    attributes = document.mapping(primitive, "attributes", f"{where}.attributes")
    if "POSITION" not in attributes:
        document.fail(f"{where}.attributes", "has no POSITION")
    return primitive.get("indices", attributes["POSITION"])


class Shapes:
    """The meshes of one file, each read once, on demand."""

    def __init__(self, document: Document, looks: Mapping[int, TexturedMaterial]) -> None:
        """`looks`: the materials of the meshes, by their index in the file."""
        self._document = document
        self._looks = looks
        self._plain = TexturedMaterial(Material("plain", (1.0, 1.0, 1.0)))
        self._tint = cache(_tinted)  # materials are compared by identity
        self._meshes: dict[int, Mesh | None] = {}
        self._read_vertices = self._kept_vertices = 0
        self.left_out = 0  # primitives of points and lines, which have no surface

    def mesh(self, index: int) -> Mesh | None:
        """Return a mesh in FRD axes; None if it has no triangles. Raises UsageError if it is invalid or too large."""
        if index not in self._meshes:
            self._meshes[index] = self._read(index)
        return self._meshes[index]

    def _read(self, index: int) -> Mesh | None:
        raw: dict[Any, _Block] = {}  # vertices in the order of the file
        made: dict[Any, _Block] = {}  # vertices in the order of the new mesh
        triangles, which = [], []
        worn: dict[int, tuple[int, Material]] = {}  # identity of a material → (its row, material)
        first = 0
        start = self._read_vertices
        for k, primitive in enumerate(_primitives(self._document, index)):
            where = f"meshes[{index}].primitives[{k}]"
            mode = self._document.natural(primitive, "mode", where, _TRIANGLES)
            if mode in _POINTS_AND_LINES:
                self.left_out += 1
                continue
            if mode > _FAN:
                self._document.fail(f"{where}.mode", f"is {mode}, which glTF does not know")
            _corner_accessor(self._document, primitive, where)
            look = self._looks[primitive["material"]] if "material" in primitive else self._plain
            key, block = self._block(primitive, where, look, raw)
            corners = self._corners(primitive, where, mode, block)
            if self._read_vertices - start > MAX_VERTICES:
                self._document.fail(f"meshes[{index}]", f"has more than {MAX_VERTICES} vertices: simplify it")
            if block.normal is None:
                self._room(corners.size, where)
                block, corners = _flat(block, corners)
                key = ("flat", k)
            if key not in made:
                made[key] = replace(block, first=first)
                first += len(block.position)
            if len(corners):
                triangles.append(corners + np.int32(made[key].first))
                which.append(self._material_rows(look.material, corners, block, worn))
        if not triangles:
            return None
        blocks = made.values()
        joined = Mesh(
            vertices=np.concatenate([b.position for b in blocks]),
            normals=np.concatenate([b.normal for b in blocks if b.normal is not None]),
            uv=np.concatenate([b.uv for b in blocks]),
            triangles=np.concatenate(triangles),
            material=np.concatenate(which),
            materials=tuple(material for _, material in worn.values()),
        )
        mesh = compact(joined)
        self._kept_vertices += len(mesh.vertices)
        if self._kept_vertices > MAX_VERTICES:
            self._document.fail(f"meshes[{index}]", f"brings the map above {MAX_VERTICES} vertices: simplify it")
        return mesh

    def _room(self, vertices: int, where: str) -> None:
        """Count vertices before they are read. Raises UsageError above a limit."""
        self._read_vertices += vertices
        if self._read_vertices > MAX_READ:
            self._document.fail(where, f"brings the file above {MAX_READ} vertices: simplify it")
        if vertices > MAX_VERTICES:
            self._document.fail(where, f"has more than {MAX_VERTICES} vertices: simplify it")

    def _block(
        self, primitive: Mapping[str, Any], where: str, look: TexturedMaterial, blocks: dict[Any, _Block]
    ) -> tuple[Any, _Block]:
        """Return (key, vertices) of a primitive. Primitives with equal keys share vertices, which are read once."""
        attributes = self._document.mapping(primitive, "attributes", f"{where}.attributes")
        uv_name = f"TEXCOORD_{look.uv_set}"
        names = ("POSITION", "NORMAL", uv_name, "COLOR_0")
        places = tuple(attributes.get(name) for name in names)
        key = (*(p if isinstance(p, int) else None for p in places), look.uv_scale, look.uv_turn, look.uv_offset)
        if key in blocks:
            return key, blocks[key]
        size = element_count(self._document, places[0], f"{where}.attributes.POSITION")
        self._room(size, where)
        read = {
            name: vectors(self._document, place, f"{where}.attributes.{name}", *widths)
            for name, place, widths in zip(names, places, ((3,), (3,), (2,), (3, 4)), strict=True)
            if name in attributes
        }
        for name, values in read.items():
            if len(values) != size:
                self._document.fail(f"{where}.attributes.{name}", f"has {len(values)} entries for {size} vertices")
        position = read["POSITION"]
        if np.abs(position).max() > MAX_COORDINATE_M:
            self._document.fail(f"{where}.attributes.POSITION", f"reaches beyond {MAX_COORDINATE_M:g} m")
        normal = from_gltf(_unit(read["NORMAL"])) if "NORMAL" in read else None
        uv = look.uv(read[uv_name]) if uv_name in read else np.zeros((size, 2), np.float32)
        color = read["COLOR_0"][:, :3] if "COLOR_0" in read else None
        blocks[key] = _Block(0, from_gltf(position), normal, np.clip(uv, -1e4, 1e4), color)
        return key, blocks[key]

    def _corners(self, primitive: Mapping[str, Any], where: str, mode: int, block: _Block) -> NDArray[np.int32]:
        """Return a primitive's triangles (T, 3). Strips and fans become separate triangles."""
        size = len(block.position)
        if "indices" in primitive:
            order = indices(self._document, primitive["indices"], f"{where}.indices", size)
        else:
            order = np.arange(size, dtype=np.int32)
        if mode == _TRIANGLES:
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        if len(order) < 3:
            return np.zeros((0, 3), np.int32)
        if mode == _FAN:
            return np.stack([order[1:-1], order[2:], np.full(len(order) - 2, order[0])], axis=1)
        odd = np.arange(len(order) - 2) % 2
        return np.stack([order[:-2], np.where(odd, order[2:], order[1:-1]), np.where(odd, order[1:-1], order[2:])], 1)

    def _material_rows(
        self, material: Material, corners: NDArray[np.int32], block: _Block, worn: dict[int, tuple[int, Material]]
    ) -> NDArray[np.int32]:
        """Return each triangle's row (T,) in `worn`; add missing rows to `worn`. Vertex colours become tints."""

        def row(look: Material) -> int:
            return worn.setdefault(id(look), (len(worn), look))[0]

        if block.color is None:
            return np.full(len(corners), row(material), np.int32)
        mean = np.clip(block.color[corners].mean(axis=1), 0.0, 1.0)
        levels = np.rint(np.sqrt(mean) * TINTS).astype(np.int64)
        codes, of = np.unique((levels[:, 0] * 32 + levels[:, 1]) * 32 + levels[:, 2], return_inverse=True)
        rows = [row(self._tint(material, int(code))) for code in codes]
        return np.array(rows, np.int32)[of.reshape(-1)]


def _tinted(material: Material, code: int) -> Material:
    red, green, blue = ((level / TINTS) ** 2 for level in (code // 1024, code // 32 % 32, code % 32))
    c = material.color
    return replace(material, name=f"{material.name}-{code}", color=(c[0] * red, c[1] * green, c[2] * blue))


def compact(mesh: Mesh) -> Mesh:
    """Return a mesh without the vertices that no triangle uses; the same object if there are none."""
    used, order = np.unique(mesh.triangles, return_inverse=True)
    if len(used) == len(mesh.vertices):
        return mesh
    return replace(
        mesh,
        vertices=mesh.vertices[used],
        normals=mesh.normals[used],
        uv=mesh.uv[used],
        triangles=order.reshape(-1, 3).astype(np.int32),
    )


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return normals of length one. Normals that already have this length are not changed."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    mended = np.where(length > 1e-6, normals / np.maximum(length, np.float32(1e-6)), np.array([0.0, 1.0, 0.0]))
    return np.where(np.abs(length - 1.0) < 1e-3, normals, mended).astype(np.float32)


def _flat(block: _Block, corners: NDArray[np.int32]) -> tuple[_Block, NDArray[np.int32]]:
    """Return separate vertices for each triangle, with its plane's normal, as glTF requires if normals are missing."""
    tri = block.position[corners].astype(np.float64)
    area = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(area, axis=1, keepdims=True)
    normal = np.where(length > 1e-12, area / np.maximum(length, 1e-12), (0.0, 0.0, -1.0)).astype(np.float32)
    order = corners.ravel()
    flat = _Block(
        first=0,
        position=block.position[order],
        normal=np.repeat(normal, 3, axis=0),
        uv=block.uv[order],
        color=None if block.color is None else block.color[order],
    )
    return flat, np.arange(len(order), dtype=np.int32).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """One node that shows a mesh."""

    name: str
    mesh: int  # index in the file
    matrix: NDArray[np.float64]  # (4, 4) from node to scene, both in glTF axes, m
    extras: Mapping[str, Any]


def placed(document: Document) -> list[Placed]:
    """Return the nodes of the file's scene that show a mesh, in the order in which the file lists them.

    Raises UsageError for a node with two parents, a loop, a tree deeper than MAX_DEPTH, or a place beyond MAX_PLACE_M.
    """
    nodes: list[Placed] = []
    seen: set[int] = set()
    waiting: list[tuple[Any, NDArray[np.float64] | None, int]] = [
        (index, None, 0) for index in reversed(_roots(document))
    ]
    while waiting:
        index, parent, depth = waiting.pop()
        node = document.entry("nodes", index, "a scene's node")
        where = f"nodes[{index}]"
        if index in seen:
            document.fail(where, "is reached twice: nodes must form a tree without loops")
        if depth > MAX_DEPTH:
            document.fail(where, f"lies more than {MAX_DEPTH} levels deep")
        seen.add(index)
        own = _matrix(document, node, where)
        matrix = own if parent is None else parent @ own
        if not np.isfinite(matrix).all() or np.abs(matrix).max() > MAX_PLACE_M:
            document.fail(where, f"is placed or scaled beyond {MAX_PLACE_M:g} m: glTF is in metres")
        if "mesh" in node:
            mesh = document.entry("meshes", node["mesh"], f"{where}.mesh")
            extras = node.get("extras")
            name = document.name_of(node) or document.name_of(mesh)
            nodes.append(Placed(name, node["mesh"], matrix, extras if isinstance(extras, dict) else {}))
        children = node.get("children", [])
        if not isinstance(children, list) or len(children) > document.count("nodes"):
            document.fail(f"{where}.children", "is not a list of nodes")
        waiting.extend((child, matrix, depth + 1) for child in reversed(children))
    return nodes


def _roots(document: Document) -> list[Any]:
    if not document.count("scenes"):
        numbers = range(document.count("nodes"))
        lists = (document.entry("nodes", k, "nodes").get("children") for k in numbers)
        children = {c for row in lists if isinstance(row, list) for c in row if isinstance(c, int)}
        return [k for k in numbers if k not in children]
    scene = document.entry("scenes", document.tree.get("scene", 0), "scene")
    roots = scene.get("nodes", [])
    if not isinstance(roots, list) or len(roots) > document.count("nodes"):
        document.fail("scene.nodes", "is not a list of nodes")
    return roots


def _matrix(document: Document, node: Mapping[str, Any], where: str) -> NDArray[np.float64]:
    """Return a node's own (4, 4) matrix, from its `matrix` or from translation · rotation · scale."""
    if "matrix" in node:
        identity = tuple(float(v) for v in np.eye(4).ravel())
        values = document.numbers(node, "matrix", where, identity)
        return np.array(values).reshape(4, 4).T
    x, y, z, w = document.numbers(node, "rotation", where, (0.0, 0.0, 0.0, 1.0))
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if length < 1e-9:
        document.fail(f"{where}.rotation", "is not a rotation")
    x, y, z, w = x / length, y / length, z / length, w / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(document.numbers(node, "scale", where, (1.0, 1.0, 1.0)))
    matrix[:3, 3] = document.numbers(node, "translation", where, (0.0, 0.0, 0.0))
    return matrix


def pose(matrix: NDArray[np.float64], hint_yaw: Any) -> tuple[Vec3, float, NDArray[np.float64] | None]:
    """Return (position_ned in m, yaw in rad, linear map (3, 3) to apply to the mesh in FRD axes, or None).

    An instance has only a yaw. If the node has another rotation or a scale, the linear map has the whole rotation and
    scale, and the yaw is 0. `hint_yaw`: the exact yaw from the extras, used if it fits the matrix.
    """
    n, e, d = (float(v) for v in from_gltf(matrix[:3, 3]))
    linear = AXES @ matrix[:3, :3] @ AXES.T
    yaw = math.atan2(linear[1, 0], linear[0, 0])
    if np.abs(linear - turn(yaw)).max() > _EXACT:
        return (n, e, d), 0.0, linear
    if isinstance(hint_yaw, int | float) and abs(hint_yaw) < 1e3 and np.abs(turn(hint_yaw) - linear).max() < _EXACT:
        yaw = float(hint_yaw)
    return (n, e, d), yaw, None


def deformed(mesh: Mesh, linear: NDArray[np.float64]) -> Mesh | None:
    """Return a mesh under a linear map (3, 3) of its FRD axes, or None if the map is singular.

    A reflection reverses the winding, as glTF requires, so that outward faces stay outward.
    """
    determinant = float(np.linalg.det(linear))
    if abs(determinant) < 1e-12:
        return None
    normals = mesh.normals @ np.linalg.inv(linear)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return replace(
        mesh,
        vertices=(mesh.vertices @ linear.T).astype(np.float32),
        normals=normals.astype(np.float32),
        triangles=mesh.triangles if determinant > 0.0 else np.ascontiguousarray(mesh.triangles[:, ::-1]),
    )
