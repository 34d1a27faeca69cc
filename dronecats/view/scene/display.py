"""The map and the things on it as the browser gets them, and what a click in the browser meets.

The browser has glTF’s axes (x east, y up, z south): everything passes through `episodes.maps.gltf.container`.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import viser
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from episodes.maps import geometry as g
from episodes.maps.gltf.container import from_gltf, to_gltf
from episodes.maps.gltf.meshes import compact
from episodes.maps.gltf.writer import to_bytes
from episodes.maps.scene import Instance, Material, Mesh, Scene, Sun, turn
from foundation.frames import Quat, Vec3
from foundation.terrain import FLAT, HeightField

SKY_TOP, SKY_BOTTOM = (150, 188, 226), (233, 240, 245)
FAR_M = 200.0  # from the origin to where the sun is put


def light(server: viser.ViserServer, sun: Sun) -> None:
    """Have the browser's up be up, a sky behind everything, and light as a map's sun gives it.

    Without shadows: those that count are in the cameras' pictures.
    """
    scene = server.scene
    scene.set_up_direction("+y")
    scene.set_background_image(_sky())
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/ambient", intensity=0.9)
    scene.add_light_hemisphere("/light/sky", sky_color=(205, 222, 255), ground_color=(120, 115, 105), intensity=1.3)
    n, e, d = (FAR_M * v for v in sun.toward_ned)
    place = place_of((n, e, d))
    scene.add_light_directional("/light/sun", color=(255, 244, 224), intensity=2.2, position=place)


def _sky() -> Any:
    share = np.linspace(0.0, 1.0, 64)[:, None, None]
    rows = np.array(SKY_TOP) * (1.0 - share) + np.array(SKY_BOTTOM) * share
    return np.repeat(rows.astype(np.uint8), 4, axis=1)


Array = NDArray[np.float64]

DRONE_M = 0.25  # from the middle of the drone that is shown to a rotor's


def place_of(position_ned: Vec3) -> tuple[float, float, float]:
    """Return a place (m, NED) in the browser's axes."""
    x, y, z = to_gltf(np.array(position_ned, np.float64))
    return (float(x), float(y), float(z))


def ned_of(position: tuple[float, float, float] | Array) -> Vec3:
    """Return a place of the browser in m, NED."""
    n, e, d = from_gltf(np.array(position, np.float64))
    return (float(n), float(e), float(d))


def wxyz_of(yaw: float) -> tuple[float, float, float, float]:
    """Return the browser's rotation of a yaw (rad, clockwise from above)."""
    return (math.cos(yaw / 2), 0.0, -math.sin(yaw / 2), 0.0)


def turned(attitude: Quat) -> tuple[float, float, float, float]:
    """Return the browser's rotation of an attitude (FRD → NED) for what stands in its own glTF axes."""
    w, x, y, z = attitude
    return (w, y, -z, -x)


def turned_to(turn: float | Quat) -> tuple[float, float, float, float]:
    """Return the browser's rotation of a yaw (rad) or an attitude (FRD → NED)."""
    return turned(turn) if isinstance(turn, tuple) else wxyz_of(turn)


def yaw_of(wxyz: tuple[float, ...] | Array) -> float:
    """Return the yaw (rad) of a rotation of the browser."""
    w, x, y, z = (float(v) for v in wxyz)
    return -math.atan2(2.0 * (w * y + x * z), 1.0 - 2.0 * (x * x + y * y))


def map_glb(scene: Scene) -> bytes:
    """Return a map as one glTF file with one mesh per material: browsers draw few things faster.

    No two share vertices: viser computes the normals of each primitive anew and would write over those of others.
    """
    parts: dict[int, list[Mesh]] = {}
    looks: dict[int, Material] = {}
    for one in scene.instances:
        for row in np.unique(one.mesh.material):
            look = one.mesh.materials[row]
            looks[id(look)] = look
            parts.setdefault(id(look), []).append(_standing(one, int(row)))
    merged = [_joined(parts[key], look) for key, look in looks.items()]
    things = tuple(
        Instance(k, mesh.materials[0].name, "map", mesh, (0.0, 0.0, 0.0)) for k, mesh in enumerate(merged, 1)
    )
    return to_bytes(replace(scene, instances=things, terrain=FLAT))


def thing_glb(mesh: Mesh) -> bytes:
    """Return one thing as a glTF file, its origin at the origin."""
    thing = Instance(1, "thing", "thing", mesh, (0.0, 0.0, 0.0))
    return map_glb(Scene("thing", (thing,), FLAT, Sun((0.0, 0.0, -1.0)), 0.0, 0.0, 0.0))


def drone_mesh(color: Vec3) -> Mesh:
    """Return a small quadrotor to look at, its front arms in a colour; the origin is the vehicle's."""
    dark, bright = Material("drone-frame", (0.03, 0.03, 0.035)), Material("drone-mark", color)
    blade = Material("drone-rotor", (0.35, 0.36, 0.38))
    parts = [
        g.box((-0.11, -0.06, -0.03), (0.11, 0.06, 0.05), dark),
        g.box((0.09, -0.03, -0.02), (0.15, 0.03, 0.03), bright),
    ]
    for ahead, left in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        tip = (ahead * DRONE_M * 0.71, left * DRONE_M * 0.71, 0.03)
        parts.append(g.rod((0.0, 0.0, 0.02), tip, (0.015, 0.012), bright if ahead > 0 else dark))
        parts.append(g.rod((*tip[:2], 0.05), (*tip[:2], 0.058), (0.13, 0.13), blade, 20))
    return g.assemble(parts)


def ring(terrain: HeightField, centre: tuple[float, float], radius_m: float, count: int = 96) -> Array:
    """Return a circle (count, 2, 3) on the ground around (north, east) as line segments in the browser's axes."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    places = [(centre[0] + radius_m * math.cos(a), centre[1] + radius_m * math.sin(a)) for a in angle]
    points = np.array([place_of((n, e, terrain.at(n, e) - 0.08)) for n, e in places])
    return np.stack([points[:-1], points[1:]], axis=1)


class Picker:
    """Finds what lies under a click."""

    def __init__(self, scene: Scene) -> None:
        """Take the map, without any target in it."""
        solid = [one for one in scene.instances if len(one.mesh.triangles)]
        corners = [
            (one.mesh.vertices @ turn(one.turned).T + np.array(one.position_ned))[one.mesh.triangles] for one in solid
        ]
        self._instances = solid
        self._owner = np.repeat(np.arange(len(solid)), [len(c) for c in corners])
        points = np.ascontiguousarray(np.concatenate(corners).reshape(-1, 3), dtype=np.float32)
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, points, np.arange(len(points), dtype=np.int32).reshape(-1, 3))

    def pick(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, Instance] | None:
        """Return the first place (m, NED) that a ray meets and what it belongs to; None when it goes to the sky."""
        way = np.array(direction) / np.linalg.norm(direction)
        hit = self._scene.run(np.array([origin], np.float32), way[None].astype(np.float32), output=1)
        if hit["primID"][0] < 0:
            return None
        n, e, d = np.array(origin) + way * float(hit["tfar"][0])
        return (float(n), float(e), float(d)), self._instances[self._owner[int(hit["primID"][0])]]


def _standing(one: Instance, row: int) -> Mesh:
    """Return the triangles of one material of an instance where they stand on the map."""
    part = compact(replace(one.mesh, triangles=one.mesh.triangles[one.mesh.material == row]))
    matrix = turn(one.turned).T
    return replace(
        part,
        vertices=(part.vertices @ matrix + np.array(one.position_ned)).astype(np.float32),
        normals=(part.normals @ matrix).astype(np.float32),
    )


def _joined(meshes: list[Mesh], look: Material) -> Mesh:
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    triangles = np.concatenate([m.triangles + k for m, k in zip(meshes, first, strict=False)]).astype(np.int32)
    return Mesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        normals=np.concatenate([m.normals for m in meshes]),
        uv=np.concatenate([m.uv for m in meshes]),
        triangles=triangles,
        material=np.zeros(len(triangles), np.int32),
        materials=(look,),
    )
