"""The shapes that vehicles collide with: height of the ground, solid triangles, and a moving box."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class HeightField:
    """Ground on a regular grid; outside the grid, the nearest edge value is used.

    `down[i, j]` belongs to north = origin_north + i · cell_m, east = origin_east + j · cell_m.
    Heights between nodes are interpolated bilinearly.
    """

    origin_north: float  # m, NED
    origin_east: float  # m, NED
    cell_m: float
    down: NDArray[np.float64]  # (N, M) m, NED z of the surface: negative above the origin's level

    def at(self, north: float, east: float) -> float:
        """Return the NED z (m) of the ground at a point."""
        rows, columns = self.down.shape
        i = min(max((north - self.origin_north) / self.cell_m, 0.0), rows - 1.0)
        j = min(max((east - self.origin_east) / self.cell_m, 0.0), columns - 1.0)
        i0, j0 = min(int(i), max(rows - 2, 0)), min(int(j), max(columns - 2, 0))
        i1, j1 = min(i0 + 1, rows - 1), min(j0 + 1, columns - 1)
        u, v = i - i0, j - j0
        low = self.down[i0, j0] * (1 - v) + self.down[i0, j1] * v
        high = self.down[i1, j0] * (1 - v) + self.down[i1, j1] * v
        return float(low * (1 - u) + high * u)


FLAT = HeightField(0.0, 0.0, 1.0, np.zeros((1, 1)))


@dataclass(frozen=True, slots=True)
class MovingBox:
    """An upright box that follows a pose: the solid shape of a moving car."""

    name: str
    half_m: Vec3  # m, half its length, width and height
    centre_frd: Vec3  # m, from the asset's origin to the middle of the box, in the asset's axes (forward, right, down)


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Solid triangles without the ground, sorted into the cells of a regular grid.

    Cell (i, j, k) has the number n = (i · columns + j) · layers + k and begins at `origin_ned` + `cell_m` · (i, j, k).
    `index[start[n] : start[n + 1]]` are the numbers of all triangles within `reach_m` of any point of the cell. A
    vehicle that extends at most `reach_m` from its origin needs only the cell that contains this origin.
    """

    corners: NDArray[np.float32]  # (T, 9) m, NED, three points, counter-clockwise seen from outside
    bounds: NDArray[np.float32]  # (T, 4) m, NED, centre and radius of a ball around each triangle
    owner: NDArray[np.int32]  # (T,) index in `names` of the solid to which a triangle belongs
    names: tuple[str, ...]
    origin_ned: Vec3  # m
    cell_m: float
    cells: tuple[int, int, int]  # rows north, columns east, layers down
    start: NDArray[np.int32]  # (number of cells + 1,), places in `index`
    index: NDArray[np.int32]  # numbers of triangles, cell by cell
    reach_m: float
    moving: MovingBox | None = None


OPEN = Obstacles(
    corners=np.zeros((0, 9), np.float32),
    bounds=np.zeros((0, 4), np.float32),
    owner=np.zeros(0, np.int32),
    names=(),
    origin_ned=(0.0, 0.0, 0.0),
    cell_m=1.0,
    cells=(0, 0, 0),
    start=np.zeros(1, np.int32),
    index=np.zeros(0, np.int32),
    reach_m=0.0,
)
