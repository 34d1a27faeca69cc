"""The places of a map's things, in plan."""

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Instance, turn

Array = NDArray[np.float64]
TRUNK_M = 0.6  # the part of a tree below this height is its trunk


def foot(one: Instance) -> Array:
    """Return the four corners (4, 2) in plan of the box around a thing without its leaves; of a tree, of its trunk."""
    mesh = one.mesh.without_foliage()
    v = mesh.vertices[np.unique(mesh.triangles)]
    if one.kind in ("tree", "conifer"):
        v = v[v[:, 2] > -TRUNK_M]
    low, high = v[:, :2].min(axis=0), v[:, :2].max(axis=0)
    box = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
    plan: np.ndarray = box @ turn(one.yaw)[:2, :2].T + np.array(one.position_ned[:2])
    return plan


def apart(a: Array, b: Array) -> bool:
    """Return whether a line separates two rectangles."""
    for box in (a, b):
        for k in range(2):
            axis = box[k + 1] - box[k]
            if (a @ axis).max() <= (b @ axis).min() or (b @ axis).max() <= (a @ axis).min():
                return True
    return False
