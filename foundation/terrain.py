"""The height of the ground, as the world tells it to the physics."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class HeightField:
    """Ground on a regular grid; outside the grid the nearest edge value holds.

    `down[i, j]` belongs to north = origin_north + i · cell_m, east = origin_east + j · cell_m; between nodes bilinear.
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
