"""An asset alone on a wide level ground, for pictures of it."""

from episodes.maps import geometry as g
from episodes.maps.assets.materials import surface
from episodes.maps.scene import Instance, Mesh, Scene, Sun
from foundation.terrain import FLAT

GROUND_M = 160.0  # half the ground's width


def alone(name: str, mesh: Mesh, sun: Sun, height_m: float = 0.0) -> Scene:
    """Return the scene: the asset in the middle, its origin `height_m` above asphalt, facing north under the sun."""
    corner = [(GROUND_M * x, GROUND_M * y, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    flat = g.soup([[corner[i] for i in (0, 1, 2)], [corner[i] for i in (0, 2, 3)]], surface("asphalt"), tile_m=4.0)
    ground = Instance(1, "ground", "ground", g.assemble([flat]), (0.0, 0.0, 0.0))
    return Scene("studio", (ground, Instance(2, name, name, mesh, (0.0, 0.0, -height_m))), FLAT, sun, 47.0, 8.0, 400.0)
