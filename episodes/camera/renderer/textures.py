"""Stores all textures of a scene and their smaller copies (mipmaps) in one array of texels, and reads them in kernels.

A texel packs three ten-bit channels, each the square root of a linear value. In the dark this is finer than eight bits
of linear light, and squaring is cheaper than the sRGB curve. The channels are 21 bits apart, so that one multiplication
applies a weight to all three. uv (0, 0) is the top-left corner of the picture, u to the right, v down. Beyond 0 … 1 the
picture repeats. For this, every level has a border of one texel, copied from the opposite side.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.compiled import njit
from foundation.errors import UsageError
from foundation.frames import Vec3

LARGEST_SIDE = 2048  # texels; larger pictures are reduced
MOST_DOUBLINGS = 3  # at most 2³ reads along the longer axis of a pixel's footprint
WEIGHT = 2048  # sum of a pixel's integer weights; see `_bilinear`
ONE_BITS = 0x3F800000  # bits of the float 1.0
SHARPEN = -0.35  # added to the level: a finer level keeps letters readable, and edge smoothing hides the aliasing

DRIFT_CELLS = 256  # cells per side of `drift_table`, a power of two

LANE_1, LANE_2, LANE_MASK = np.uint64(21), np.uint64(42), np.uint64((1 << 21) - 1)
NEXT = np.uint64(1)


class Atlas(NamedTuple):
    """The texels of every level of every texture. The rows of a level follow each other, each with its border."""

    texels: NDArray[np.uint64]  # (N,) r << 42 | g << 21 | b
    levels: NDArray[np.int64]  # (L, 3) of each level: first texel (of the border), width and height (without border)
    first_level: NDArray[np.int32]  # (K,) the full-size level of each texture
    depth: NDArray[np.int32]  # (K,) number of levels of each texture


def srgb_to_linear(value: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return linear light (0 … 1) of sRGB values (0 … 1). Source: IEC 61966-2-1."""
    value = np.asarray(value, np.float32)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


def build_atlas(pictures: Sequence[NDArray[np.uint8]], before: Atlas | None = None) -> Atlas:
    """Return the atlas of the textures of `before`, followed by (H, W, 3) sRGB pictures as textures.

    Raises UsageError for a picture of another shape or type.
    """
    if before is None or not len(before.first_level):
        before = Atlas(np.zeros(0, np.uint64), np.zeros((0, 3), np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32))
    elif not pictures:
        return before
    curve = srgb_to_linear(np.arange(256, dtype=np.float32) / 255.0)
    texels, filled = [before.texels], len(before.texels)
    levels = [(int(first), int(width), int(height)) for first, width, height in before.levels]
    first_level, depth = before.first_level.tolist(), before.depth.tolist()
    for k, picture in enumerate(pictures, len(first_level)):
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or 0 in picture.shape:
            raise UsageError(
                f"texture {k} has shape {picture.shape} and type {picture.dtype}: give (H, W, 3) uint8 sRGB."
            )
        pyramid = _pyramid(curve[picture])
        first_level.append(len(levels))
        depth.append(len(pyramid))
        for level in pyramid:
            levels.append((filled, level.shape[1], level.shape[0]))
            code = np.rint(np.sqrt(np.clip(level, 0.0, 1.0)) * 1023.0).astype(np.uint64)
            lanes = code[..., 0] << LANE_2 | code[..., 1] << LANE_1 | code[..., 2]
            texels.append(np.pad(lanes, 1, mode="wrap").ravel())
            filled += texels[-1].size
    return Atlas(
        texels=np.concatenate(texels) if filled else np.zeros(1, np.uint64),
        levels=np.array(levels, np.int64).reshape(-1, 3),
        first_level=np.array(first_level, np.int32),
        depth=np.array(depth, np.int32),
    )


def mean_colors(atlas: Atlas, texture: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the (K, 3) linear mean colours of textures by number; 1 for a negative number, which is no texture."""
    means = np.ones((len(texture), 3), np.float32)
    for k, number in enumerate(texture):
        if number >= 0:
            first = int(atlas.levels[atlas.first_level[number] + atlas.depth[number] - 1, 0])
            code = atlas.texels[first]
            means[k] = [float(code >> lane & LANE_MASK) / 1023.0 for lane in (LANE_2, LANE_1, np.uint64(0))]
    return means * means


def drift_table() -> NDArray[np.float32]:
    """Return the table for `drift`: (DRIFT_CELLS, DRIFT_CELLS) random values within -1 … 1 that repeat."""
    rng = np.random.default_rng(17)
    frequency = np.fft.fftfreq(DRIFT_CELLS) * DRIFT_CELLS
    radius = np.hypot(frequency[:, None], frequency[None, :])
    spectrum = np.fft.fft2(rng.normal(size=(DRIFT_CELLS, DRIFT_CELLS))) / np.maximum(radius, 4.0) ** 1.3
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.asarray(np.tanh(0.6 * field / field.std()), np.float32)


@njit(cache=True, nogil=True, inline="always")
def drift(table: NDArray[np.float32], n: float, e: float, z: float) -> float:
    """Return the change of natural ground's tone at (n, e), m, within -1.2 … 1.2: the sum of small and large patches.

    Patches fade where they are smaller than a pixel: small ones at depths `z` of about 60 m, large ones at 800 m.
    """
    fine = 1.0 / (1.0 + z * z * (1.0 / 3600.0))
    coarse = 1.0 / (1.0 + z * z * (1.0 / 640000.0))
    turned_n, turned_e = 0.8 * n + 0.6 * e, 0.8 * e - 0.6 * n
    return 0.45 * fine * _smooth(table, n * 1.3, e * 1.3) + 0.75 * coarse * _smooth(
        table, turned_n * 0.11, turned_e * 0.11
    )


@njit(cache=True, nogil=True, inline="always")
def _smooth(table: NDArray[np.float32], x: float, y: float) -> float:
    """Return the bilinear value of a repeating table at (x, y) cells."""
    low_x, low_y = math.floor(x), math.floor(y)
    i, j = int(low_x) & (DRIFT_CELLS - 1), int(low_y) & (DRIFT_CELLS - 1)
    p, q = (i + 1) & (DRIFT_CELLS - 1), (j + 1) & (DRIFT_CELLS - 1)
    fx, fy = x - low_x, y - low_y
    a = table[i, j] + (table[i, q] - table[i, j]) * fy
    b = table[p, j] + (table[p, q] - table[p, j]) * fy
    value: float = a + (b - a) * fx
    return value


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


@njit(cache=True, nogil=True, inline="always")
def footprint(
    atlas: Atlas, texture: int, ux: float, vx: float, uy: float, vy: float
) -> tuple[np.int64, int, int, float, float]:
    """Return the parameters of `texture_color` for one texture: (level, mix, doublings, step_u, step_v).

    (ux, vx) and (uy, vy) are the changes of (u, v) from one place of `texture_color` to the next, right and down: the
    axes of a footprint. 2^doublings reads follow the longer axis in steps of (step_u, step_v). The level fits the
    shorter axis, or one read's part of the longer axis if that is larger. `mix` / WEIGHT is the weight of the next
    coarser level. So a road at a grazing angle is sharp across its direction and does not shimmer along it.
    """
    first = atlas.first_level[texture]
    w = float(atlas.levels[first, 1])
    h = float(atlas.levels[first, 2])
    long2 = ux * ux * (w * w) + vx * vx * (h * h)
    short2 = uy * uy * (w * w) + vy * vy * (h * h)
    along_u, along_v = ux, vx
    if short2 > long2:
        long2, short2 = short2, long2
        along_u, along_v = uy, vy
    lower, mix, doublings = np.int64(first), 0, 0
    if long2 > 1.0:
        log_long = 0.5 * _log2(long2)
        doublings = min(int(log_long - 0.5 * _log2(max(short2, 1.0)) + 0.6), MOST_DOUBLINGS)
        level = min(max(log_long - doublings + SHARPEN, 0.0), atlas.depth[texture] - 1.0)
        full = int(level)
        mix = int((level - full) * WEIGHT)
        lower += full
    share = 0.5 if doublings == 1 else (0.25 if doublings == 2 else 0.125)
    return lower, mix, doublings, along_u * share, along_v * share


@njit(cache=True, nogil=True, inline="always")
def texture_color(
    atlas: Atlas,
    u: float,
    v: float,
    level: np.int64,
    mix: int,
    doublings: int,
    step_u: float,
    step_v: float,
    ux: float,
    vx: float,
    uy: float,
    vy: float,
    reads: int,
) -> Vec3:
    """Return the linear (r, g, b) around (u, v) for a `footprint`: the mean of `reads` × `reads` places.

    The places are (ux, vx) and (uy, vy) apart. `reads` is a power of two. Without doublings, both levels are read once
    at each place. With doublings, the two levels are read in turn along the step.
    """
    texels, levels = atlas.texels, atlas.levels
    first, w, h = levels[level, 0], levels[level, 1], levels[level, 2]
    upper = level + 1 if mix > 0 else level
    first1, w1, h1 = levels[upper, 0], levels[upper, 1], levels[upper, 2]
    pairs = 1 << max(doublings - 1, 0)
    part = mix // (pairs * reads * reads)
    rest = WEIGHT // (pairs * reads * reads) - part
    # the second read of a pair is from the second level; without doublings, at the same place
    if doublings == 0:
        step_u, step_v = 0.0, 0.0
    back, start = 0.5 * (reads - 1), pairs - 0.5
    ku, kv = u - back * (ux + uy) - start * step_u, v - back * (vx + vy) - start * step_v
    lanes = np.uint64(0)
    for _ in range(reads):
        for _ in range(reads):
            tu, tv = ku, kv
            for _ in range(pairs):
                lanes += _bilinear(texels, first, w, h, tu, tv, rest)
                tu += step_u
                tv += step_v
                if part > 0:
                    lanes += _bilinear(texels, first1, w1, h1, tu, tv, part)
                tu += step_u
                tv += step_v
            ku += ux
            kv += vx
        ku += uy - reads * ux
        kv += vy - reads * vx
    k = 1.0 / (1023.0 * WEIGHT)
    r = k * np.int64(lanes >> LANE_2)
    g = k * np.int64((lanes >> LANE_1) & LANE_MASK)
    b = k * np.int64(lanes & LANE_MASK)
    return r * r, g * g, b * b


@njit(cache=True, nogil=True, inline="always")
def _bilinear(
    texels: NDArray[np.uint64], offset: np.int64, w: np.int64, h: np.int64, u: float, v: float, weight: int
) -> np.uint64:
    """Return one level's interpolated code at (u, v), times `weight`.

    Positions have eight binary places and weights are whole numbers, so that one multiplication or addition applies to
    all channels. A channel has 21 bits, enough for 1023 · WEIGHT.
    """
    x = np.int64((u - np.floor(u)) * (w * 256.0)) + 128  # + 128: half a texel back, and one forward for the border
    y = np.int64((v - np.floor(v)) * (h * 256.0)) + 128
    right = x & 255
    lower = (y & 255) * weight
    w11 = (lower * right) >> 16
    w10 = (lower >> 8) - w11
    w01 = (weight * right >> 8) - w11
    w00 = weight - w11 - w10 - w01
    row = np.uint64(w + 2)
    at = np.uint64(offset + (y >> 8) * (w + 2) + (x >> 8))
    lanes: np.uint64 = texels[at] * np.uint64(w00)
    lanes += texels[at + NEXT] * np.uint64(w01)
    lanes += texels[at + row] * np.uint64(w10)
    lanes += texels[at + row + NEXT] * np.uint64(w11)
    return lanes


@njit(cache=True, nogil=True)
def _log2(x: float) -> float:
    """Return log₂ x within 0.05, from the bits of a float: its exponent plus its mantissa."""
    return (np.float32(x).view(np.int32) - ONE_BITS) * (1.0 / (1 << 23)) + 0.043
