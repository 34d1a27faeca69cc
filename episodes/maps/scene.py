"""The types of a map: its scene, and its places for targets. Lengths are in metres; the world has NED axes.

The axes of an asset point forward, right and down (FRD). The origin of most assets is on the ground under the asset's
middle, so points above the ground have z < 0.
"""

import hashlib
import math
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from foundation.frames import Quat, Vec3, rotate, vec3
from foundation.kept_values import kept
from foundation.terrain import HeightField
from foundation.threads import once

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]  # (H, W, 3) sRGB
# instance's id → its new pose: (position_ned m, yaw rad or attitude FRD → NED); None: not drawn
Moved = Mapping[int, tuple[Vec3, float | Quat] | None]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """Colour and texture of a surface."""

    name: str
    color: Vec3  # linear RGB reflectance 0 … 1; multiplies the texture
    texture: NDArray[np.uint8] | None = None  # (H, W, 3) sRGB, repeats; None = plain colour
    emission: float = 0.0  # fraction of `color` that the surface emits (lamps)
    specular: float = 0.0  # 0 matt … 1 glass and car paint
    drift: float = 0.0  # relative variation of the tone of natural ground from place to place
    cutout: NDArray[np.bool_] | None = None  # (H, W) mask of the texture's opaque texels; None = all
    foliage: bool = False  # leaves: both sides get the same light, by the corner normals; vehicles pass through leaves


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one asset. Seen from outside, their corners run counter-clockwise."""

    vertices: NDArray[np.float32]  # (V, 3) m, FRD
    normals: NDArray[np.float32]  # (V, 3) unit, FRD
    uv: NDArray[np.float32]  # (V, 2), 1 = one repeat of the texture
    triangles: NDArray[np.int32]  # (T, 3) vertex indices
    material: NDArray[np.int32]  # (T,) index into `materials`
    materials: tuple[Material, ...]

    def without_foliage(self) -> "Mesh":
        """Return the part of the mesh that a vehicle can hit; the mesh itself if it has no foliage."""
        leafy = np.array([m.foliage for m in self.materials], np.bool_)
        if not leafy.any():
            return self
        kept = ~leafy[self.material]
        return replace(self, triangles=self.triangles[kept], material=self.material[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One object of a scene."""

    id: int  # ≥ 1, unique in the scene; the value in the id image. 0 is the sky
    name: str  # 'house-3', 'target'
    kind: str  # 'ground', 'house', 'tree', 'suv' …
    mesh: Mesh
    position_ned: Vec3  # m, of the asset's origin
    yaw: float = 0.0  # rad
    movable: bool = False  # may be drawn at another pose
    solid: bool = True  # can hide other things, and can be hit
    attitude: Quat | None = None  # FRD → NED, of an instance that leans; None: it is level

    @property
    def turned(self) -> float | Quat:
        """The yaw (rad), or the attitude (FRD → NED) of an instance that leans."""
        return self.yaw if self.attitude is None else self.attitude

    @property
    def centre_ned(self) -> Vec3:
        """The centre (m) of the instance's bounding box."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        return vec3(np.array(self.position_ned) + turn(self.turned) @ ((low + high) / 2))

    def vertices_ned(self) -> NDArray[np.float64]:
        """Return the mesh's vertices (V, 3) in the world, m."""
        placed: NDArray[np.float64] = self.mesh.vertices @ turn(self.turned).T + np.array(self.position_ned)
        return placed

    def triangles_ned(self) -> NDArray[np.float64]:
        """Return the corners (T, 3, 3) of the mesh's triangles in the world, m."""
        return self.vertices_ned()[self.mesh.triangles]


def turn(turned: float | Quat) -> NDArray[np.float64]:
    """Return the (3, 3) matrix from an asset's FRD axes to NED, for its yaw (rad) or attitude (FRD → NED)."""
    if isinstance(turned, tuple):
        return np.array([rotate(turned, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]).T
    c, s = math.cos(turned), math.sin(turned)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    """A directional light and its sky."""

    toward_ned: Vec3  # unit vector from the scene towards the sun
    color: Vec3 = (1.0, 0.96, 0.88)  # linear RGB; multiplied by `strength`
    strength: float = 2.6
    sky: Vec3 = (0.36, 0.52, 0.78)  # linear RGB of the ambient light from above
    clouds: float = 0.35  # share of the sky that clouds cover, 0 … 1; does not change `color`, `strength` or `sky`
    glow: Vec3 = (0.0, 0.0, 0.0)  # linear RGB of the glow in the low sky above the position of the sun


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A built map."""

    name: str
    instances: tuple[Instance, ...]
    terrain: HeightField
    sun: Sun
    latitude_deg: float  # geodetic, of the NED origin
    longitude_deg: float  # of the NED origin
    altitude_m: float  # m above mean sea level, of the NED origin
    spawn_ned: Vec3 = (0.0, 0.0, 0.0)  # m, a free place on the ground
    spawn_yaw: float = 0.0  # rad
    notes: tuple[str, ...] = field(default=())  # sentences for users
    base: "Scene | None" = None  # the map to which this scene adds instances; None: this scene is a map


LARGE = 20_000  # triangles; with fewer, computing a value is faster than reading it from disk
T = TypeVar("T")


def kept_of_scene(name: str, sources: tuple[str, ...], scene: Scene, make: Callable[[], T]) -> T:
    """Return the value that `make` computes from the scene. For a large scene, cache it on disk.

    The arguments are as in `foundation.kept_values.kept`.
    """
    if sum(len(instance.mesh.triangles) for instance in scene.instances) < LARGE:
        return make()
    return kept(name, sources, make, _content(scene))


@once(3)  # a digest takes 0.1 s
def _content(scene: Scene) -> str:
    """Return a digest of all values of a scene."""
    return hashlib.sha256(pickle.dumps(scene, pickle.HIGHEST_PROTOCOL)).hexdigest()


def sun_at(latitude_deg: float, day: int, solar_hour: float) -> Sun:
    """Return the sun over a latitude on a day of the year (1 … 365) at a true solar hour (12 = highest).

    Declination by Cooper's formula; elevation and azimuth by spherical trigonometry.
    """
    declination = math.radians(23.45) * math.sin(2.0 * math.pi * (284 + day) / 365.0)
    latitude, hour = math.radians(latitude_deg), math.radians(15.0 * (solar_hour - 12.0))
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    return Sun((north, east, -up))


@dataclass(frozen=True, slots=True)
class Spot:
    """A free place on the ground where a target or a look-alike may stand."""

    position_ned: Vec3  # m, on the ground
    yaw: float  # rad, natural heading of an object at this place
    place: str  # what the ground is: 'kerb', 'drive', 'plaza', 'path', 'lawn' …


@dataclass(frozen=True, slots=True)
class Lane:
    """A route along which a target may move from its first waypoint to its last."""

    name: str
    waypoints_ned: tuple[Vec3, ...]  # m, on the ground; legs are so short that they follow the ground
    width_m: float  # of the strip without solids; the waypoints are its middle

    @property
    def length_m(self) -> float:
        """Return the length (m) along the waypoints."""
        return sum(math.dist(a, b) for a, b in pairwise(self.waypoints_ned))


@dataclass(frozen=True, slots=True)
class Landmark:
    """An instance that instructions name to tell other objects apart."""

    name: str  # of the instance
    phrase: str  # its name in instructions, with article if it needs one; fits no other instance of the map


@dataclass(frozen=True, slots=True)
class Places:
    """The places of a map."""

    spots: tuple[Spot, ...]
    lanes: tuple[Lane, ...]
    landmarks: tuple[Landmark, ...] = ()
