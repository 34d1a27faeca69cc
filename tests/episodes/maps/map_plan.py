"""Footprints of a map's objects in the horizontal plane."""

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Instance, turn

Array = NDArray[np.float64]
TRUNK_M = 0.6  # the part of a tree below this height is its trunk


def foot(one: Instance) -> Array:
    """Return the corners (4, 2), north and east in m, of an object's footprint.

    The footprint is the box around the object without its foliage. For a tree, it is the box around the trunk.
    """
    mesh = one.mesh.without_foliage()
    v = mesh.vertices[np.unique(mesh.triangles)]
    if one.kind in ("tree", "conifer"):
        v = v[v[:, 2] > -TRUNK_M]
    low, high = v[:, :2].min(axis=0), v[:, :2].max(axis=0)
    box = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
    plan: np.ndarray = box @ turn(one.yaw)[:2, :2].T + np.array(one.position_ned[:2])
    return plan


def apart(a: Array, b: Array) -> bool:
    """Return whether two rectangles are apart: a line separates them."""
    for box in (a, b):
        for k in range(2):
            axis = box[k + 1] - box[k]
            if (a @ axis).max() <= (b @ axis).min() or (b @ axis).max() <= (a @ axis).min():
                return True
    return False
