"""Builds the land beyond a map: fields with hedgerows, and low wooded hills, out to where the haze hides them.

The ground of the map is a square. The land begins slightly below the edge of this square.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets.materials import noise
from episodes.maps.scene import Array, Material, Picture

HORIZON_M = 9000.0  # half extent of the land
OVERLAP_M, DROP_M = 8.0, 0.4  # the land reaches this far under the map's edge, and lies this much lower there
PER_SIDE = 48  # pieces of a ring along each side of the square
RINGS = (1.12, 1.3, 1.6, 2.0, 2.5, 3.1, 3.8, 4.7, 5.8, 7.2, 9.0, 12.0, 16.0)  # extents of rings, relative to the map
LEVEL_M = 700.0  # distance from the map's edge at which the height of the edge has faded to 0
HILLS_FROM_M, HILLS_M = (800.0, 3200.0), 170.0  # where hills begin and are full-size, from the edge; height scale
TILE_M = 2600.0  # period of the pattern of fields
FIELDS = (  # sRGB colour of a crop, and its relative frequency
    ((98, 119, 61), 6),
    ((108, 126, 66), 4),
    ((88, 112, 56), 4),
    ((122, 130, 74), 2),
    ((146, 140, 92), 2),
    ((124, 112, 78), 1),
)
WOODS, HEDGE = (58, 80, 46), (66, 88, 48)


@cache
def fields() -> Picture:
    """Return the picture (512, 512, 3) of fields seen from above; it repeats every TILE_M."""
    from scipy.spatial import cKDTree  # slow to import; a map that is kept on disk does not need it

    side, rng = 512, np.random.default_rng(271)
    count = 150
    middles = rng.uniform(0.0, side, (count, 2))
    tiled = np.concatenate([middles + side * np.array((i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    row, column = np.mgrid[0:side, 0:side].astype(np.float64)
    bend = 4.5 * noise((side, side), 2.2, 272), 4.5 * noise((side, side), 2.2, 273)
    # fields are longer in one direction, so distances are scaled differently along and across
    stretch = np.array((1.0, 1.5))
    place = np.stack([row + bend[0], column + bend[1]], axis=2) * stretch
    away, nearest = cKDTree(tiled * stretch).query(place.reshape(-1, 2), k=2)
    gap = (away[:, 1] - away[:, 0]).reshape(side, side)
    which = (nearest[:, 0] % count).reshape(side, side)
    choices = np.repeat(np.arange(len(FIELDS)), [often for _, often in FIELDS])
    colors = np.array([color for color, _ in FIELDS], np.float64)[rng.choice(choices, count)]
    colors *= rng.uniform(0.94, 1.06, (count, 1))
    image = colors[which] * (1.0 + 0.05 * noise((side, side), 0.9, 274))[..., None]
    image[gap < 2.0] = HEDGE
    wooded = (noise((side, side), 1.7, 275) > 1.15)[..., None]
    image = np.where(wooded, np.array(WOODS) * (1.0 + 0.16 * noise((side, side), 0.3, 276))[..., None], image)
    smooth = cv2.GaussianBlur(np.clip(image, 0, 255).astype(np.uint8), (3, 3), 0.6)
    return np.asarray(smooth, np.uint8)


@cache
def _look() -> Material:
    return Material("fields", (1.0, 1.0, 1.0), fields(), drift=0.10)


def beyond(half_m: float, down: Callable[[Array, Array], Array], seed: int) -> g.MeshPart:
    """Return the land around a square ground of half extent `half_m`. `down` returns the ground's NED z (m)."""
    radii = np.array((half_m - OVERLAP_M, *(half_m * times for times in RINGS), HORIZON_M))
    along = np.linspace(-1.0, 1.0, PER_SIDE + 1)[:-1]
    one = np.ones(PER_SIDE)
    # outline (north, west), counter-clockwise seen from above
    north = np.concatenate([one, -along, -one, along])
    west = np.concatenate([along, one, -along, -one])
    north, west = np.append(north, north[0]), np.append(west, west[0])
    n, w = radii[:, None] * north, radii[:, None] * west
    points = np.stack([n, w, _height(n, -w, half_m, down, seed)], axis=2)
    part = g.grid(points, _look(), 60.0)
    return replace(part, uv=part.corners[..., :2] / TILE_M)


def _height(north: Array, east: Array, half_m: float, down: Callable[[Array, Array], Array], seed: int) -> Array:
    """Return the height (m) of the land: the height of the map's edge, which fades to 0 with distance, plus hills."""
    away = np.maximum(np.abs(north), np.abs(east)) - half_m
    inside = half_m - 1.0
    edge = -down(np.clip(north, -inside, inside), np.clip(east, -inside, inside))
    up = edge * (1.0 - _rise(away, 0.0, LEVEL_M)) - DROP_M * (away < 0.0)
    rng = np.random.default_rng((seed, 281))
    waves = np.zeros_like(up)
    for length, part in ((3100.0, 0.40), (1700.0, 0.30), (900.0, 0.20), (520.0, 0.10)):
        for _ in range(2):
            turn, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            way = 2.0 * np.pi / length * (np.cos(turn) * north + np.sin(turn) * east)
            waves += 0.5 * part * np.sin(way + phase)
    hills = np.maximum(0.42 + 0.9 * waves, 0.02)
    return np.asarray(up + HILLS_M * _rise(away, *HILLS_FROM_M) * hills)


def _rise(value: Array, start: float, stop: float) -> Array:
    """Return the smoothstep of a value: 0 at `start`, 1 at `stop`."""
    share = np.clip((value - start) / (stop - start), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))
