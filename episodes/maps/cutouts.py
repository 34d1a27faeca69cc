"""Looks up the opacity of cut-out textures, for the renderer, its shadows and ray casts.

A texel is opaque or a hole. Opacity is not filtered, so that renderer, shadows and rays agree. Distant leaves still
cover the same share of the picture, because the same share of samples hits opaque texels.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Material, Mesh
from foundation.compiled import njit

OPAQUE = -1  # index for a material without a cut-out


class Cutouts(NamedTuple):
    """The opaque texels of each cut-out texture, one texture after the other."""

    texels: NDArray[np.uint8]  # (N,) row by row, one bit per texel, so that they fit into the processor's cache
    first: NDArray[np.int64]  # (K,) first bit of each texture
    size: NDArray[np.int64]  # (K, 2) width and height of each texture


def cutouts_of(materials: Sequence[Material]) -> tuple[Cutouts, NDArray[np.int32]]:
    """Return the distinct cut-outs of some materials, and the index (M,) of each material's cut-out or OPAQUE."""
    row_of: dict[int, int] = {}
    shown: list[NDArray[np.bool_]] = []
    for material in materials:
        if material.cutout is not None and id(material.cutout) not in row_of:
            row_of[id(material.cutout)] = len(shown)
            shown.append(material.cutout)
    cutouts = Cutouts(
        texels=np.packbits(np.concatenate([np.zeros(0, np.bool_), *(s.ravel() for s in shown)]), bitorder="little"),
        first=np.cumsum([0, *(s.size for s in shown)], dtype=np.int64)[:-1],
        size=np.array([s.shape[::-1] for s in shown], np.int64).reshape(-1, 2),
    )
    return cutouts, np.array([row_of.get(id(m.cutout), OPAQUE) for m in materials], np.int32)


def is_cut_out(mesh: Mesh) -> NDArray[np.bool_]:
    """Return for each triangle (T,) whether its material has holes."""
    return np.array([m.cutout is not None for m in mesh.materials], np.bool_)[mesh.material]


@njit(cache=True, nogil=True, inline="always")
def is_opaque_texel(cutouts: Cutouts, which: int, u: float, v: float) -> bool:
    """Return whether the texel at (u, v) of a cut-out texture is opaque. Beyond 0 … 1 the texture repeats."""
    w, h = cutouts.size[which, 0], cutouts.size[which, 1]
    x, y = int((u - np.floor(u)) * w), int((v - np.floor(v)) * h)
    bit = cutouts.first[which] + min(y, h - 1) * w + min(x, w - 1)
    return bool(cutouts.texels[bit >> 3] >> (bit & 7) & 1)
