"""Casts rays against triangles. Rays pass through the holes of cut-out surfaces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

from episodes.maps.cutouts import Cutouts, cutouts_of, is_cut_out, is_opaque_texel
from episodes.maps.scene import Instance, Mesh
from foundation.compiled import njit

NOTHING = -1  # triangle index of a ray without a hit
BEYOND_M = 1e-4  # m past a hole, where the ray continues
MOST_HOLES = 200  # along one ray; a ray through more holes counts as blocked
FAR = 1e30
BEFORE = 0.999  # hits count up to this share of the way to a point, so that the point itself is no hit


class Hits(NamedTuple):
    """The first hit of each of N rays."""

    triangle: NDArray[np.int32]  # (N,) NOTHING for a ray without a hit
    distance: NDArray[np.float32]  # (N,) as a multiple of the direction vector; FAR for a ray without a hit


class RayScene:
    """Triangles indexed for ray casting, numbered mesh after mesh."""

    def __init__(self, meshes: Sequence[Mesh], corners: Sequence[NDArray[np.floating]]) -> None:
        """`corners`: for each mesh, the corners (T, 3, 3) of its triangles, m; all meshes in the axes of the rays."""
        materials = list({id(m): m for mesh in meshes for m in mesh.materials}.values())
        self._cutouts, which = cutouts_of(materials)
        row_of = {id(m): k for k, m in enumerate(materials)}
        every = np.concatenate([np.zeros((0, 3, 3)), *corners]).astype(np.float32)
        has_holes = np.concatenate([np.zeros(0, np.bool_), *(is_cut_out(mesh) for mesh in meshes)])
        self._opaque_rows, self._cut_rows = (np.flatnonzero(has_holes == cut).astype(np.int32) for cut in (False, True))
        self._opaque = _embree_scene(every[self._opaque_rows])
        self._cut = _embree_scene(every[self._cut_rows]) if has_holes.any() else None
        cut = [(mesh, is_cut_out(mesh)) for mesh in meshes]
        self._uv = np.concatenate([np.zeros((0, 3, 2), np.float32), *(m.uv[m.triangles[k]] for m, k in cut)])
        rows = [np.array([row_of[id(a)] for a in m.materials], np.int64)[m.material[k]] for m, k in cut]
        self._which = which[np.concatenate([np.zeros(0, np.int64), *rows])]

    @classmethod
    def of_instances(cls, instances: Sequence[Instance]) -> "RayScene":
        """Return the ray scene of instances at their poses, in NED."""
        return cls([i.mesh for i in instances], [i.triangles_ned() for i in instances])

    @classmethod
    def of_mesh(cls, mesh: Mesh) -> "RayScene":
        """Return the ray scene of a mesh in its own axes."""
        return cls([mesh], [mesh.vertices[mesh.triangles]])

    def first_hits(self, start: ArrayLike, way: ArrayLike, reach: float = FAR) -> Hits:
        """Return the first hits of N rays along `way` (N, 3).

        `start` is one point (3,) for all rays, or a point for each ray (N, 3). `reach` is the length of the rays, as a
        multiple of `way`.
        """
        starts, ways, reaches = _prepared(start, way, reach)
        hit = self._opaque.run(starts, ways, reaches, output=1)
        is_hit = hit["primID"] >= 0
        hits = Hits(np.full(len(ways), NOTHING, np.int32), np.full(len(ways), FAR, np.float32))
        hits.triangle[is_hit] = self._opaque_rows[hit["primID"][is_hit]]
        hits.distance[is_hit] = hit["tfar"][is_hit]
        self._first_cutout_hits(starts, ways, np.where(is_hit, hits.distance, reaches), hits)
        return hits

    def are_blocked(self, start: ArrayLike, way: ArrayLike, reach: float) -> NDArray[np.bool_]:
        """Return for each ray whether it hits anything within `reach`; see `first_hits`."""
        starts, ways, reaches = _prepared(start, way, reach)
        blocked = np.asarray(self._opaque.run(starts, ways, reaches, query="OCCLUDED")) >= 0
        free = np.flatnonzero(~blocked)
        hits = Hits(np.full(len(free), NOTHING, np.int32), np.full(len(free), FAR, np.float32))
        self._first_cutout_hits(starts[free], ways[free], reaches[free], hits)
        blocked[free] = hits.triangle != NOTHING
        return blocked

    def _first_cutout_hits(
        self, start: NDArray[np.float32], way: NDArray[np.float32], reach: NDArray[np.float32], hits: Hits
    ) -> None:
        """Write into `hits` the first hit of each ray on an opaque texel of a cut-out surface within `reach`."""
        if self._cut is None:
            return
        going = np.arange(len(way))
        gone = np.zeros(len(way), np.float32)
        step = (BEYOND_M / np.maximum(np.linalg.norm(way, axis=1), 1e-9)).astype(np.float32)
        for _ in range(MOST_HOLES):
            if not len(going):
                return
            origin = start[going] + way[going] * gone[going, None]
            hit = self._cut.run(origin, np.ascontiguousarray(way[going]), reach[going] - gone[going], output=1)
            met = hit["primID"] >= 0
            going, triangle = going[met], hit["primID"][met]
            gone[going] += hit["tfar"][met]
            there = _are_there(self._cutouts, self._which, self._uv, triangle, hit["u"][met], hit["v"][met])
            hits.triangle[going[there]] = self._cut_rows[triangle[there]]
            hits.distance[going[there]] = gone[going[there]]
            going = going[~there]
            gone[going] += np.maximum(step[going], gone[going] * 1e-6)
            going = going[gone[going] < reach[going]]
        hits.triangle[going], hits.distance[going] = self._cut_rows[0], gone[going]


def _prepared(
    start: ArrayLike, way: ArrayLike, reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return starts (N, 3), directions (N, 3) and lengths (N,) of rays as Embree reads them."""
    ways = np.ascontiguousarray(way, np.float32)
    starts = np.ascontiguousarray(np.broadcast_to(np.asarray(start, np.float32), ways.shape))
    return starts, ways, np.full(len(ways), reach, np.float32)


def _embree_scene(triangles: NDArray[np.float32]) -> EmbreeScene:
    scene = EmbreeScene()
    TriangleMesh(scene, triangles)
    return scene


@njit(cache=True, nogil=True, allocates=True)
def _are_there(
    cutouts: Cutouts,
    which: NDArray[np.int32],
    uv: NDArray[np.float32],
    triangle: NDArray[np.int32],
    b: NDArray[np.float32],
    c: NDArray[np.float32],
) -> NDArray[np.bool_]:
    """Return whether the texel at each hit is opaque; (1 - b - c, b, c) are the hit's barycentric coordinates."""
    there = np.zeros(len(triangle), np.bool_)
    for k in range(len(triangle)):
        at, a = uv[triangle[k]], 1.0 - float(b[k]) - float(c[k])
        u = a * at[0, 0] + b[k] * at[1, 0] + c[k] * at[2, 0]
        v = a * at[0, 1] + b[k] * at[1, 1] + c[k] * at[2, 1]
        there[k] = is_opaque_texel(cutouts, which[triangle[k]], u, v)
    return there
