"""All textures of a scene in one array of texels with their smaller copies, and how a kernel reads them.

A texel packs three ten-bit channels, each the square root of a linear value: ten bits are enough in the dark where
eight bits of linear light are not, and squaring is cheaper than the sRGB curve. uv (0, 0) is the top-left corner of the
picture, u to the right, v down; beyond 0 … 1 the picture repeats.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from dronecats.border.errors import UsageError

LARGEST_SIDE = 2048  # texels; larger pictures are reduced
MOST_TAPS = 8  # along the longer axis of a pixel's footprint
SHARPEN = -0.35  # levels; a little under the strict limit keeps lettering readable and is hidden by later smoothing


class Atlas(NamedTuple):
    """Texels of every level of every texture. A level's rows lie one after the other from its offset."""

    texels: NDArray[np.uint32]  # (N,) r << 20 | g << 10 | b
    offset: NDArray[np.int64]  # (L,) first texel of the level
    width: NDArray[np.int32]  # (L,)
    height: NDArray[np.int32]  # (L,)
    first_level: NDArray[np.int32]  # (K,) the full-size level of each texture
    levels: NDArray[np.int32]  # (K,) how many it has


def srgb_to_linear(value: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return linear light (0 … 1) of sRGB values (0 … 1). Source: IEC 61966-2-1."""
    value = np.asarray(value, np.float32)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


def build_atlas(pictures: Sequence[NDArray[np.uint8]]) -> Atlas:
    """Return the atlas of (H, W, 3) sRGB pictures, texture k being `pictures[k]`. Raises UsageError otherwise."""
    curve = srgb_to_linear(np.arange(256, dtype=np.float32) / 255.0)
    texels: list[NDArray[np.uint32]] = []
    offset, width, height, first_level, levels = [], [], [], [], []
    filled = 0
    for k, picture in enumerate(pictures):
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or 0 in picture.shape:
            raise UsageError(
                f"texture {k} has shape {picture.shape} and type {picture.dtype}: give (H, W, 3) uint8 sRGB."
            )
        first_level.append(len(offset))
        pyramid = _pyramid(curve[picture])
        levels.append(len(pyramid))
        for level in pyramid:
            offset.append(filled)
            height.append(level.shape[0])
            width.append(level.shape[1])
            code = np.rint(np.sqrt(np.clip(level, 0.0, 1.0)) * 1023.0).astype(np.uint32)
            texels.append(((code[..., 0] << 20) | (code[..., 1] << 10) | code[..., 2]).ravel())
            filled += texels[-1].size
    return Atlas(
        texels=np.concatenate(texels) if texels else np.zeros(1, np.uint32),
        offset=np.array(offset, np.int64),
        width=np.array(width, np.int32),
        height=np.array(height, np.int32),
        first_level=np.array(first_level, np.int32),
        levels=np.array(levels, np.int32),
    )


def _pyramid(linear: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Return the picture and its successive halves down to one texel, averaged by area in linear light."""
    rows, columns = linear.shape[:2]
    shrink = LARGEST_SIDE / max(rows, columns)
    if shrink < 1.0:
        size = (max(1, round(columns * shrink)), max(1, round(rows * shrink)))
        linear = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
    pyramid = [linear]
    while max(linear.shape[:2]) > 1:
        size = (max(1, linear.shape[1] // 2), max(1, linear.shape[0] // 2))
        linear = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
        pyramid.append(linear)
    return pyramid


@numba.njit(cache=True, nogil=True, inline="never")
def _add_bilinear(atlas, level, u, v, weight, r, g, b):
    """Return (r, g, b) plus `weight` times the square-root-coded colour of one level at (u, v)."""
    w = atlas.width[level]
    h = atlas.height[level]
    x = (u - math.floor(u)) * w - 0.5
    y = (v - math.floor(v)) * h - 0.5
    fx = math.floor(x)
    fy = math.floor(y)
    x0 = int(fx)
    y0 = int(fy)
    fx = x - fx
    fy = y - fy
    x1 = x0 + 1
    y1 = y0 + 1
    if x0 < 0:
        x0 += w
    if x1 >= w:
        x1 -= w
    if y0 < 0:
        y0 += h
    if y1 >= h:
        y1 -= h
    base = atlas.offset[level]
    upper = base + y0 * w
    lower = base + y1 * w
    t = atlas.texels[np.uint64(upper + x0)]
    k = weight * (1.0 - fx) * (1.0 - fy)
    r += k * np.int32(t >> 20)
    g += k * np.int32((t >> 10) & 1023)
    b += k * np.int32(t & 1023)
    t = atlas.texels[np.uint64(upper + x1)]
    k = weight * fx * (1.0 - fy)
    r += k * np.int32(t >> 20)
    g += k * np.int32((t >> 10) & 1023)
    b += k * np.int32(t & 1023)
    t = atlas.texels[np.uint64(lower + x0)]
    k = weight * (1.0 - fx) * fy
    r += k * np.int32(t >> 20)
    g += k * np.int32((t >> 10) & 1023)
    b += k * np.int32(t & 1023)
    t = atlas.texels[np.uint64(lower + x1)]
    k = weight * fx * fy
    r += k * np.int32(t >> 20)
    g += k * np.int32((t >> 10) & 1023)
    b += k * np.int32(t & 1023)
    return r, g, b


@numba.njit(cache=True, nogil=True)
def texture_color(atlas, texture, u, v, ux, vx, uy, vy):
    """Return the linear (r, g, b) of a texture over the footprint of one pixel.

    (ux, vx) and (uy, vy) are the changes of (u, v) over one pixel to the right and down. The level is chosen by the
    footprint's shorter axis and up to MOST_TAPS reads follow the longer one, so that a road seen at a grazing angle
    stays sharp across without shimmering along; between two levels the colour is interpolated.
    """
    first = atlas.first_level[texture]
    w = atlas.width[first]
    h = atlas.height[first]
    long2 = ux * ux * w * w + vx * vx * h * h
    short2 = uy * uy * w * w + vy * vy * h * h
    along_u, along_v = ux, vx
    if short2 > long2:
        long2, short2 = short2, long2
        along_u, along_v = uy, vy
    taps = 1
    if long2 > 1.0:
        long = math.sqrt(long2)
        taps = math.ceil(long / math.sqrt(max(short2, 1.0)) - 0.25)
        taps = min(max(taps, 1), MOST_TAPS)
        level = math.log2(long / taps) + SHARPEN
    else:
        level = 0.0
    last = atlas.levels[texture] - 1
    level = min(max(level, 0.0), float(last))
    lower = int(level)
    blend = level - lower
    r, g, b = 0.0, 0.0, 0.0
    share = 1.0 / taps
    for tap in range(taps):
        s = (tap + 0.5) * share - 0.5
        tu = u + s * along_u
        tv = v + s * along_v
        if blend < 0.98:
            r, g, b = _add_bilinear(atlas, first + lower, tu, tv, share * (1.0 - blend), r, g, b)
        if blend > 0.02:
            r, g, b = _add_bilinear(atlas, first + min(lower + 1, last), tu, tv, share * blend, r, g, b)
    k = 1.0 / 1023.0
    if blend >= 0.98:
        k /= blend
    elif blend <= 0.02:
        k /= 1.0 - blend
    r *= k
    g *= k
    b *= k
    return r * r, g * g, b * b
