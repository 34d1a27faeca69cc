"""Converts the map and objects for the browser, and finds the map point under a click.

The browser uses glTF’s axes (x east, y up, z south). `episodes.maps.gltf.document` converts positions.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from dronecats.report.kit import palette
from episodes.maps import geometry as g
from episodes.maps.gltf.document import from_gltf, to_gltf
from episodes.maps.gltf.meshes import compact
from episodes.maps.gltf.writer import to_bytes
from episodes.maps.scene import Instance, Material, Mesh, Scene, Sun, turn
from episodes.world.rays import NOTHING, RayScene
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, quat_multiply, vec3
from foundation.terrain import FLAT, HeightField

SKY_TOP, SKY_BOTTOM = (150, 188, 226), (233, 240, 245)
FAR_M = 200.0  # distance of the sun's light from the origin


def light(server: viser.ViserServer, sun: Sun) -> None:
    """Set the up direction, the sky and the sunlight of a map, without shadows.

    Only the pictures of the drones' cameras have shadows.
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

DRONE_SCALE = 1.8  # drones are drawn larger than they are, to be visible on a map
DRONE_M = 0.25  # m, from the centre of the drone's mesh to the centre of a rotor


def place_of(position_ned: Vec3) -> Vec3:
    """Convert a position (m, NED) to the browser's axes."""
    return vec3(to_gltf(np.array(position_ned, np.float64)))


def ned_of(position: tuple[float, float, float] | Array) -> Vec3:
    """Convert a position in the browser's axes to NED, m."""
    return vec3(from_gltf(np.array(position, np.float64)))


def wxyz_of(rotation: float | Quat) -> Quat:
    """Convert a yaw (rad, clockwise) or an attitude (FRD → NED) to the browser's rotation of objects in glTF axes."""
    if isinstance(rotation, tuple):
        w, x, y, z = rotation
        return (w, y, -z, -x)
    return (math.cos(rotation / 2), 0.0, -math.sin(rotation / 2), 0.0)


def yaw_of(wxyz: tuple[float, ...] | Array) -> float:
    """Return the yaw (rad, clockwise) of a rotation in the browser's axes."""
    w, x, y, z = (float(v) for v in wxyz)
    return -math.atan2(2.0 * (w * y + x * z), 1.0 - 2.0 * (x * x + y * y))


def map_glb(scene: Scene) -> bytes:
    """Return a map as one glTF file with one mesh per material.

    Browsers draw few large meshes faster than many small ones. Meshes share no vertices, because viser recomputes the
    normals of each mesh and would change shared vertices.
    """
    meshes: dict[int, list[Mesh]] = {}  # key: `id` of the material
    for instance in scene.instances:
        for row in np.unique(instance.mesh.material):
            material = instance.mesh.materials[row]
            meshes.setdefault(id(material), []).append(_placed(instance, int(row)))
    instances = tuple(
        Instance(k, same[0].materials[0].name, "map", _merged(same), (0.0, 0.0, 0.0))
        for k, same in enumerate(meshes.values(), 1)
    )
    return to_bytes(replace(scene, instances=instances, terrain=FLAT))


def mesh_glb(mesh: Mesh) -> bytes:
    """Return a mesh as a glTF file in the mesh's own axes."""
    instance = Instance(1, "mesh", "mesh", mesh, (0.0, 0.0, 0.0))
    return map_glb(Scene("mesh", (instance,), FLAT, Sun((0.0, 0.0, -1.0)), 0.0, 0.0, 0.0))


def drone_mesh(color: Vec3) -> Mesh:
    """Return a small quadrotor whose front arms have a colour (linear RGB). Its origin is the vehicle's origin."""
    dark, bright = Material("drone-frame", (0.03, 0.03, 0.035)), Material("drone-mark", color)
    blade = Material("drone-rotor", (0.35, 0.36, 0.38))
    meshes = [
        g.box((-0.11, -0.06, -0.03), (0.11, 0.06, 0.05), dark),
        g.box((0.09, -0.03, -0.02), (0.15, 0.03, 0.03), bright),
    ]
    for ahead, left in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        tip = (ahead * DRONE_M * 0.71, left * DRONE_M * 0.71, 0.03)
        meshes.append(g.rod((0.0, 0.0, 0.02), tip, (0.015, 0.012), bright if ahead > 0 else dark))
        meshes.append(g.rod((*tip[:2], 0.05), (*tip[:2], 0.058), (0.13, 0.13), blade, 20))
    return g.assemble(meshes)


def add_glb(server: viser.ViserServer, node: str, glb: bytes, **options: Any) -> Any:
    """Add a glTF file to the browser's scene, without shadows."""
    return server.scene.add_glb(node, glb, cast_shadow=False, receive_shadow=False, **options)


def add_lines(server: viser.ViserServer, node: str, points: Any, color: tuple[int, int, int], width_px: float) -> Any:
    """Add line segments, (N, 2, 3) in the browser's axes, with a constant width on the screen."""
    return server.scene.add_line_segments(node, points, color, thickness=width_px, thickness_units="screen")


def add_drone(server: viser.ViserServer, node: str, color: Vec3, camera: CameraModel, label: str) -> tuple[Any, Any]:
    """Add a drone with its camera and a label ("": no label) under a node. Return its body and the camera's frustum."""
    half = math.radians(camera.pitch_deg) / 2.0
    body = add_glb(server, f"{node}/body", mesh_glb(drone_mesh(color)), scale=DRONE_SCALE)
    frustum = server.scene.add_camera_frustum(
        f"{node}/camera",
        fov=2.0 * math.atan(camera.height / 2.0 / camera.focal_px),
        aspect=camera.width / camera.height,
        scale=1.1,
        color=palette.shade(color),
        # the frustum's axes are right, down, forward
        wxyz=quat_multiply((math.cos(half), math.sin(half), 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)),
        position=(camera.offset_frd[1], -camera.offset_frd[2], -camera.offset_frd[0]),
        format="jpeg",
        cast_shadow=False,
    )
    if label:
        server.scene.add_label(f"{node}/name", label, position=(0.0, 0.55, 0.0), anchor="bottom-center")
    return body, frustum


class SceneNodes:
    """Nodes below a root node of the browser's scene. viser sends only changed properties."""

    def __init__(self, server: viser.ViserServer, root: str) -> None:
        self._server, self._root = server, root
        self._nodes: dict[str, Any] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the nodes, in the order in which they were added."""
        return tuple(self._nodes)

    def put(self, name: str, add: Callable[[str], Any], **properties: Any) -> None:
        """Set properties of a node. `add(path)` adds the node if it does not exist."""
        if name not in self._nodes:
            self._nodes[name] = add(f"{self._root}/{name}")
        for key, value in properties.items():
            setattr(self._nodes[name], key, value)

    def lines(self, name: str, points: Any, color: tuple[int, int, int], width_px: float) -> None:
        """Show line segments as in `add_lines`; without segments, remove the node."""
        if not len(points):
            self.drop(name)
            return
        self.put(name, lambda path: add_lines(self._server, path, points, color, width_px), points=points)

    def label(self, name: str, text: str, position: Vec3) -> None:
        """Show a text above a position (m, browser's axes)."""
        add = partial(self._server.scene.add_label, text=text, anchor="bottom-center")
        self.put(name, add, text=text, position=position)

    def drop(self, *names: str) -> None:
        """Remove those of the nodes that exist."""
        for name in names:
            if (node := self._nodes.pop(name, None)) is not None:
                node.remove()


def ring(terrain: HeightField, centre: tuple[float, float], radius_m: float, count: int = 96) -> Array:
    """Return a circle (count, 2, 3) on the ground around (north, east) as line segments in the browser's axes."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    places = [(centre[0] + radius_m * math.cos(a), centre[1] + radius_m * math.sin(a)) for a in angle]
    points = np.array([place_of((n, e, terrain.at(n, e) - 0.08)) for n, e in places])
    return np.stack([points[:-1], points[1:]], axis=1)


class Picker:
    def __init__(self, scene: Scene) -> None:
        """`scene`: the map without targets."""
        self._instances = [i for i in scene.instances if len(i.mesh.triangles)]
        self._owner = np.repeat(np.arange(len(self._instances)), [len(i.mesh.triangles) for i in self._instances])
        self._scene = RayScene.of_instances(self._instances)

    def pick(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, Instance] | None:
        """Return the first point (m, NED) that a ray hits, and the hit instance; None if it hits nothing."""
        way = np.array(direction) / np.linalg.norm(direction)
        hits = self._scene.first_hits(np.array([origin], np.float32), way[None].astype(np.float32))
        if hits.triangle[0] == NOTHING:
            return None
        place = vec3(np.array(origin) + way * float(hits.distance[0]))
        return place, self._instances[self._owner[hits.triangle[0]]]


def _placed(instance: Instance, row: int) -> Mesh:
    """Return the triangles of one material of an instance, in the map's frame."""
    triangles = instance.mesh.triangles[instance.mesh.material == row]
    mesh = compact(replace(instance.mesh, triangles=triangles))
    matrix = turn(instance.turned).T
    return replace(
        mesh,
        material=np.zeros(len(triangles), np.int32),
        materials=(mesh.materials[row],),
        vertices=(mesh.vertices @ matrix + np.array(instance.position_ned)).astype(np.float32),
        normals=(mesh.normals @ matrix).astype(np.float32),
    )


def _merged(meshes: list[Mesh]) -> Mesh:
    """Return meshes of one material as one mesh."""
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    return Mesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        normals=np.concatenate([m.normals for m in meshes]),
        uv=np.concatenate([m.uv for m in meshes]),
        triangles=np.concatenate([m.triangles + k for m, k in zip(meshes, first, strict=False)]).astype(np.int32),
        material=np.concatenate([m.material for m in meshes]),
        materials=meshes[0].materials,
    )
