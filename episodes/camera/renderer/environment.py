"""Draws the surroundings that paint, glass and water reflect: a small picture of all directions.

The picture shows the sky with its clouds, the ground, and the map's objects. Objects are drawn as the vertical columns
of `occlusion.Columns`, each with one colour. The picture has an upper and a lower half, in the stereographic projection
of `sky.read_half`. It is coarse, because paint and panes blur it.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import Surfaces
from episodes.camera.renderer.occlusion import EMPTY, Columns, Occlusion
from episodes.camera.renderer.sky import HAZE_LENGTH_M, Daylight, read_half
from episodes.camera.renderer.textures import Atlas, mean_colors
from foundation.compiled import njit
from foundation.frames import Vec3

CELLS = 64  # cells per side of each half of the picture
EYE_M = 2.5  # height of the eye above the ground
NEAREST_M, FARTHEST_M = 5.0, 260.0  # m from the eye; rays are followed between these distances
GROUND: Vec3 = (0.15, 0.15, 0.13)  # linear reflectance of all ground


def mean_reflectance(surfaces: Surfaces, atlas: Atlas) -> NDArray[np.float32]:
    """Return the (M, 3) mean reflectance of every material."""
    return np.where(
        surfaces.texture[:, None] >= 0, surfaces.color * mean_colors(atlas, surfaces.texture), surfaces.color
    ).astype(np.float32)


def reflection_map(
    columns: Columns, shade: Occlusion, day: Daylight, sky: NDArray[np.float32], north: float, east: float
) -> NDArray[np.float32]:
    """Return the (2, CELLS, CELLS, 3) linear RGB seen from (north, east), m: the upper half, then the lower half."""
    blurred = np.ascontiguousarray(cv2.resize(sky, (CELLS, CELLS), interpolation=cv2.INTER_AREA))
    made = np.zeros((2, CELLS, CELLS, 3), np.float32)
    _look_around(columns, shade.ground, day, blurred, north, east, np.array(GROUND), made)
    return np.stack([cv2.GaussianBlur(half, (3, 3), 0.6) for half in made])


@njit(cache=True, nogil=True)
def _look_around(
    columns: Columns,
    ground: NDArray[np.float32],
    day: Daylight,
    sky: NDArray[np.float32],
    north: float,
    east: float,
    ground_color: NDArray[np.float64],
    made: NDArray[np.float32],
) -> None:
    cells, per = columns.low.shape[0], columns.per_cell
    i0 = min(max(int((north - columns.low_north) * per), 0), cells - 1)
    j0 = min(max(int((east - columns.low_east) * per), 0), cells - 1)
    eye = ground[i0, j0] + EYE_M
    side = made.shape[1]
    sunny = 0.8 * max(-day.toward[2], 0.0)
    for half in range(2):
        for p in range(side):
            for q in range(side):
                x, y = 2.0 * p / (side - 1) - 1.0, 2.0 * q / (side - 1) - 1.0
                square = x * x + y * y
                if square > 1.0:
                    x, y, square = x / math.sqrt(square), y / math.sqrt(square), 1.0
                up = (1.0 - square) / (1.0 + square)
                n, e = x * (1.0 + up), y * (1.0 + up)
                up = up if half == 0 else -up
                far, i, j = NEAREST_M, 0, 0
                is_hit = False
                while far < FARTHEST_M and not is_hit:
                    z = eye + up * far
                    i, j = (
                        int((north + n * far - columns.low_north) * per + 0.5),
                        int((east + e * far - columns.low_east) * per + 0.5),
                    )
                    if i < 0 or j < 0 or i >= cells or j >= cells or z < ground[i, j]:
                        break
                    is_hit = columns.low[i, j] < EMPTY and columns.low[i, j] <= z <= columns.high[i, j]
                    far += 0.4 + 0.01 * far
                clear = math.exp(-far / HAZE_LENGTH_M)
                r, g, b = read_half(sky, x, y)
                for c in range(3):
                    value = r if c == 0 else (g if c == 1 else b)
                    if is_hit:
                        lit = day.ambient[c] * 0.55 + day.bounce[c] * 0.45 + day.sun[c] * 0.30
                        value = day.horizon[c] + (columns.color[i, j, c] * lit - day.horizon[c]) * clear
                    elif half == 1:
                        value = ground_color[c] * (day.ambient[c] + sunny * day.sun[c])
                    made[half, p, q, c] = value


@njit(cache=True, nogil=True, inline="always")
def mirror_color(mirrored: NDArray[np.float32], n: float, e: float, d: float) -> Vec3:
    """Return the linear (r, g, b) that a reflection map `mirrored` shows in the unit direction (n, e, d), NED."""
    per = 1.0 / (1.0 + abs(d))
    return read_half(mirrored[0 if d <= 0.0 else 1], n * per, e * per)
