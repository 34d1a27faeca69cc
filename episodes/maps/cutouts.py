"""Looks up the opacity of cut-out textures, for the renderer, its shadows and ray casts.

A texel is opaque or a hole. Opacity is not filtered, so that renderer, shadows and rays agree. Distant leaves still
cover the same share of the picture, because the same share of samples hits opaque texels.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Material, Mesh
from foundation.compiled import njit

Scalar = TypeVar("Scalar", bound=np.generic)
OPAQUE = -1  # index for a material without a cut-out


class Cutouts(NamedTuple):
    """The opaque texels of each cut-out texture, one texture after the other."""

    texels: NDArray[np.uint8]  # (N,) row by row, one bit per texel, so that they fit into the processor's cache
    first: NDArray[np.int64]  # (K,) first bit of each texture
    size: NDArray[np.int64]  # (K, 2) width and height of each texture


def cutouts_of(materials: Sequence[Material]) -> tuple[Cutouts, NDArray[np.int32]]:
    """Return the distinct cut-outs of some materials, and the index (M,) of each material's cut-out or OPAQUE."""
    shown, rows = distinct([material.cutout for material in materials])
    cutouts = Cutouts(
        texels=np.packbits(np.concatenate([np.zeros(0, np.bool_), *(s.ravel() for s in shown)]), bitorder="little"),
        first=np.cumsum([0, *(s.size for s in shown)], dtype=np.int64)[:-1],
        size=np.array([s.shape[::-1] for s in shown], np.int64).reshape(-1, 2),
    )
    return cutouts, rows


def distinct(pictures: Sequence[NDArray[Scalar] | None]) -> tuple[list[NDArray[Scalar]], NDArray[np.int32]]:
    """Return the distinct picture objects, and the index (M,) of each picture among them; -1 for None."""
    by_identity = {id(picture): picture for picture in pictures if picture is not None}
    row_of = {identity: row for row, identity in enumerate(by_identity)}
    return list(by_identity.values()), np.array([row_of.get(id(p), -1) for p in pictures], np.int32)


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
