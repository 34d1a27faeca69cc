"""What stands in the way of a box or a sphere: the map's things without its ground, by name."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Instance
from episodes.world.visibility import distance_to_mesh, turn
from foundation.frames import Vec3

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An upright box."""

    centre_ned: Array  # (3,) m
    half: Array  # (3,) m, along its own axes
    yaw: float  # rad


def box_of(one: Instance, place: Vec3, yaw: float, margin_m: float = 0.0, lift_m: float = 0.0) -> Box:
    """Return the box around an instance at a pose, wider by a margin all round and beginning `lift_m` over its foot."""
    low = one.mesh.vertices.min(axis=0).astype(np.float64) - margin_m
    high = one.mesh.vertices.max(axis=0).astype(np.float64) + margin_m
    high[2] = min(high[2], -lift_m)
    return Box(np.array(place) + turn(yaw) @ ((low + high) / 2), np.maximum((high - low) / 2, 0.01), yaw)


class StandingObstacles:
    """Everything solid that does not move, its ground excepted."""

    def __init__(self, instances: Iterable[Instance]) -> None:
        self._things = [i for i in instances if i.solid and not i.movable and i.kind != "ground"]
        self._bounds = np.zeros((len(self._things), 2, 3))
        for k, one in enumerate(self._things):
            # the box of a turned box: half extents are turned with the absolute values of the matrix
            low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
            middle = turn(one.turned) @ ((low + high) / 2) + np.array(one.position_ned)
            reach = np.abs(turn(one.turned)) @ ((high - low) / 2)
            self._bounds[k] = middle - reach, middle + reach
        self._placed: dict[int, Array] = {}

    def nearest(self, point: Vec3, within_m: float) -> tuple[float, str]:
        """Return the distance (m) to the nearest thing and its name; (within_m, '') when none is that near."""
        p = np.array(point)
        outside = np.maximum(np.maximum(self._bounds[:, 0] - p, p - self._bounds[:, 1]), 0.0)
        best, name = within_m, ""
        for k in np.flatnonzero(np.linalg.norm(outside, axis=1) < within_m):
            one = self._things[k]
            gap = distance_to_mesh(one.mesh, turn(one.turned).T @ (p - np.array(one.position_ned)))
            if gap < best:
                best, name = gap, one.name
        return best, name

    def met(self, box: Box, but: str = "") -> str:
        """Return the name of something whose surface reaches into the box; '' when it is free. `but` is left out."""
        reach = np.abs(turn(box.yaw)) @ box.half
        low, high = box.centre_ned - reach, box.centre_ned + reach
        near = (self._bounds[:, 0] <= high).all(axis=1) & (self._bounds[:, 1] >= low).all(axis=1)
        for k in np.flatnonzero(near):
            if self._things[k].name != but and overlaps(self._triangles(int(k)), box):
                return self._things[k].name
        return ""

    def _triangles(self, k: int) -> Array:
        if k not in self._placed:
            one = self._things[k]
            corners = one.mesh.vertices.astype(np.float64) @ turn(one.turned).T + np.array(one.position_ned)
            self._placed[k] = corners[one.mesh.triangles]
        return self._placed[k]


def overlaps(triangles: Array, box: Box) -> bool:
    """Return whether any of the triangles (T, 3, 3) in m NED reaches into a box.

    Separating axes of a box and a triangle (Akenine-Möller, Fast 3D Triangle-Box Overlap Testing): the box's own three,
    the triangle's normal and the nine products of their edges.
    """
    local = (triangles - box.centre_ned) @ turn(box.yaw)
    reach = (local.min(axis=1) <= box.half).all(axis=1) & (local.max(axis=1) >= -box.half).all(axis=1)
    local = local[reach]
    if len(local) == 0:
        return False
    edges = np.stack([local[:, 1] - local[:, 0], local[:, 2] - local[:, 1], local[:, 0] - local[:, 2]], axis=1)
    normal = np.cross(edges[:, 0], edges[:, 1])
    axes = np.concatenate([normal[:, None], *(np.cross(edges, np.eye(3)[k])[:, :] for k in range(3))], axis=1)
    along = np.einsum("tax,tcx->tac", axes, local)
    extent = np.einsum("tax,x->ta", np.abs(axes), box.half)
    apart = (along.min(axis=2) > extent) | (along.max(axis=2) < -extent)
    return bool((~apart.any(axis=1)).any())
