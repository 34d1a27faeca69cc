"""Small scenes of boxes and planes for the renderer's tests."""

import math

import numpy as np

from episodes.maps.scene import Instance, Material, Mesh, Scene, Sun
from foundation.camera import CameraPose
from foundation.frames import quat_from_euler
from foundation.terrain import FLAT

GREY = Material("grey", (0.5, 0.5, 0.5))
OVERHEAD = Sun(toward_ned=(0.0, 0.0, -1.0))
EASTERN = Sun(toward_ned=(0.0, math.sqrt(0.5), -math.sqrt(0.5)))


def mesh_of(vertices, triangles, material=GREY, uv=None):
    """Return a mesh with flat normals. Triangles do not share vertices."""
    corners = np.asarray(vertices, np.float32)[np.asarray(triangles)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    count = len(corners)
    texture_at = np.zeros((3 * count, 2)) if uv is None else np.asarray(uv)[np.asarray(triangles)].reshape(-1, 2)
    return Mesh(
        vertices=corners.reshape(-1, 3),
        normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        uv=texture_at.astype(np.float32),
        triangles=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        material=np.zeros(count, np.int32),
        materials=(material,),
    )


def box_mesh(length, width, height, material=GREY):
    """Return a closed box (sizes in m) that stands on its origin. Its triangles are counter-clockwise from outside."""
    x, y = 0.5 * length, 0.5 * width
    v = [(sx * x, sy * y, z) for z in (0.0, -height) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    sides = [(0, 1, 2, 3), (7, 6, 5, 4), (4, 5, 1, 0), (5, 6, 2, 1), (6, 7, 3, 2), (7, 4, 0, 3)]
    triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    return mesh_of(v, triangles, material)


def quad_mesh(corners, material=GREY):
    """Return a quadrilateral. `corners` are the top-left, top-right, bottom-right and bottom-left of its texture."""
    return mesh_of(corners, [(0, 2, 1), (0, 3, 2)], material, uv=[(0, 0), (1, 0), (1, 1), (0, 1)])


def ground_mesh(half=500.0, material=GREY):
    """Return a level square of two triangles that faces up. `half` is half its side, in m."""
    return quad_mesh([(half, -half, 0), (half, half, 0), (-half, half, 0), (-half, -half, 0)], material)


def scene_of(instances, sun=OVERHEAD):
    return Scene("test", tuple(instances), FLAT, sun, 47.0, 8.0, 400.0)


def instance(id, mesh, position, kind="box", yaw=0.0, movable=False):
    return Instance(id, f"{kind}-{id}", kind, mesh, position, yaw, movable)


def looking(position, yaw_deg=0.0, pitch_deg=0.0, roll_deg=0.0):
    angles = (math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
    return CameraPose(position, quat_from_euler(*angles))


def random_boxes(seed, count=60):
    """Return a scene of ground and boxes with random size, yaw and position, up to 60 m north and east."""
    rng = np.random.default_rng(seed)
    things = [instance(1, ground_mesh(), (0.0, 0.0, 0.0), "ground")]
    for k in range(count):
        size = rng.uniform(0.5, 6.0, 3)
        place = (float(rng.uniform(-60, 60)), float(rng.uniform(-60, 60)), float(-rng.uniform(0.0, 6.0)))
        things.append(instance(k + 2, box_mesh(*size), place, yaw=float(rng.uniform(-3, 3))))
    return scene_of(things, EASTERN)
