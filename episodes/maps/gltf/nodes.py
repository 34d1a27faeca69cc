"""The tree of a glTF file: where each mesh stands. Source: glTF 2.0, section 3.5."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf.axes import from_gltf, linear_from_gltf
from episodes.maps.gltf.document import Document
from episodes.maps.scene import Mesh
from episodes.world.visibility import turn
from foundation.frames import Vec3

MAX_DEPTH = 200
MAX_PLACE_M = 20_000.0
_EXACT = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """One node that shows a mesh."""

    name: str
    mesh: int  # index in the file
    matrix: NDArray[np.float64]  # (4, 4) from the node's axes to the scene's, glTF's axes, m
    extras: Mapping[str, Any]


def placed(document: Document) -> list[Placed]:
    """Return the nodes of the file's scene that show a mesh, in the order in which the file lists them.

    Raises UsageError for a node with two parents, a loop, a tree deeper than MAX_DEPTH, or a place far away.
    """
    found: list[Placed] = []
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
            found.append(Placed(name, node["mesh"], matrix, extras if isinstance(extras, dict) else {}))
        children = node.get("children", [])
        if not isinstance(children, list) or len(children) > document.count("nodes"):
            document.fail(f"{where}.children", "is not a list of nodes")
        waiting.extend((child, matrix, depth + 1) for child in reversed(children))
    return found


def _roots(document: Document) -> list[Any]:
    if not document.count("scenes"):
        children = {c for node in _nodes(document) for c in _whole(node.get("children"))}
        return [k for k in range(document.count("nodes")) if k not in children]
    scene = document.entry("scenes", document.tree.get("scene", 0), "scene")
    roots = scene.get("nodes", [])
    if not isinstance(roots, list) or len(roots) > document.count("nodes"):
        document.fail("scene.nodes", "is not a list of nodes")
    return roots


def _nodes(document: Document) -> Iterator[Mapping[str, Any]]:
    return (document.entry("nodes", k, "nodes") for k in range(document.count("nodes")))


def _whole(values: Any) -> list[int]:
    return [v for v in values if isinstance(v, int)] if isinstance(values, list) else []


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
    """Return (position_ned in m, yaw in rad, what is left to be done to the mesh or None).

    An instance of ours is turned about the vertical only, so any other turn, and every scale, goes into the mesh; the
    matrix (3, 3) that does it is in FRD axes. `hint_yaw` is the exact yaw that was written, used while it agrees.
    """
    n, e, d = (float(v) for v in from_gltf(matrix[:3, 3]))
    linear = linear_from_gltf(matrix[:3, :3])
    yaw = math.atan2(linear[1, 0], linear[0, 0])
    if np.abs(linear - turn(yaw)).max() > _EXACT:
        return (n, e, d), 0.0, linear
    if isinstance(hint_yaw, int | float) and abs(hint_yaw) < 1e3 and np.abs(turn(hint_yaw) - linear).max() < _EXACT:
        yaw = float(hint_yaw)
    return (n, e, d), yaw, None


def deformed(mesh: Mesh, linear: NDArray[np.float64]) -> Mesh | None:
    """Return a mesh under a linear map (3, 3) of its FRD axes, or None when that leaves nothing of it.

    A reflection turns the winding round, as glTF asks, so that what faced outwards still does.
    """
    determinant = float(np.linalg.det(linear))
    if abs(determinant) < 1e-12:
        return None
    normals = mesh.normals @ np.linalg.inv(linear)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(
        vertices=(mesh.vertices @ linear.T).astype(np.float32),
        normals=normals.astype(np.float32),
        uv=mesh.uv,
        triangles=mesh.triangles if determinant > 0.0 else np.ascontiguousarray(mesh.triangles[:, ::-1]),
        material=mesh.material,
        materials=mesh.materials,
    )
