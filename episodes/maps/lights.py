"""The lights of a map at dusk: street lamps and about half of the windows. They shine, and light nothing else."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from episodes.maps.scene import Instance, Material, Mesh
from foundation.frames import Vec3

WINDOWS = ("window", "pane-", "curtain", "doors")  # how names of materials begin
LAMPS = ("lamp-glass", "lantern")
LIT_PERCENT = 55  # of the windows
ROOM_M = 2.0  # windows in one cell of this size are lit together
WARM: Vec3 = (1.0, 0.70, 0.36)  # linear RGB
GLASS = 0.30  # share of light in the darkest part of a lit window's picture
WINDOW_EMISSION, LAMP_EMISSION = 0.75, 2.0


def with_lights(instances: Sequence[Instance]) -> tuple[Instance, ...]:
    """Return the things of a map with their lights on."""
    meshes: dict[int, Mesh] = {}
    materials: dict[int, Material] = {}
    for instance in instances:
        if id(instance.mesh) not in meshes:
            meshes[id(instance.mesh)] = _lit(instance.mesh, materials)
    return tuple(
        instance if (mesh := meshes[id(instance.mesh)]) is instance.mesh else replace(instance, mesh=mesh)
        for instance in instances
    )


def _lit(mesh: Mesh, lit: dict[int, Material]) -> Mesh:
    """Return a mesh with its lights on, itself where it has none; `lit` has the materials that shine, by identity."""
    materials, material = list(mesh.materials), mesh.material.copy()
    for row, looks in enumerate(mesh.materials):
        is_lamp = looks.name.startswith(LAMPS)
        if not (is_lamp or looks.name.startswith(WINDOWS)):
            continue
        if id(looks) not in lit:
            lit[id(looks)] = _shining(looks, LAMP_EMISSION if is_lamp else WINDOW_EMISSION)
        of_it = np.flatnonzero(mesh.material == row)
        material[of_it if is_lamp else of_it[_lit_windows(mesh, of_it)]] = len(materials)
        materials.append(lit[id(looks)])
    return mesh if len(materials) == len(mesh.materials) else replace(mesh, material=material, materials=(*materials,))


def _shining(looks: Material, emission: float) -> Material:
    if looks.texture is None:
        return replace(looks, color=WARM, emission=emission)
    floor = 255.0 * GLASS ** (1.0 / 2.2)
    picture = np.asarray(floor + (1.0 - floor / 255.0) * looks.texture, np.uint8)
    return replace(looks, color=WARM, texture=picture, emission=emission)


def _lit_windows(mesh: Mesh, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which of these triangles, those of windows, belong to a lit one: by the place of the window alone."""
    _, corners = np.unique(mesh.vertices[mesh.triangles[rows]].reshape(-1, 3), axis=0, return_inverse=True)
    corners = corners.reshape(-1, 3)
    links = coo_array((np.ones(2 * len(rows)), (np.tile(corners[:, 0], 2), corners[:, 1:].T.ravel())))
    links.resize(corners.max(initial=0) + 1, corners.max(initial=0) + 1)
    window = connected_components(links, directed=False)[1][corners[:, 0]]
    middle = mesh.vertices[mesh.triangles[rows]].mean(axis=1)
    count = np.maximum(np.bincount(window), 1)[:, None]
    middles = np.stack([np.bincount(window, middle[:, axis]) for axis in range(3)], axis=1) / count
    cell = np.floor(middles / ROOM_M).astype(np.int64)
    draw = (cell @ np.array((73_856_093, 19_349_663, 83_492_791)) & 0xFFFF_FFFF) * 2_654_435_761 >> 16
    return np.asarray((draw % 100 < LIT_PERCENT)[window], np.bool_)
