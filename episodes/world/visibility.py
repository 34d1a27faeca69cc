"""Computes the visibility of a target by ray casting, distances to solids, and the target's box in a picture."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Array, Instance, Mesh, turn
from episodes.world.rays import BEFORE, NOTHING, RayScene
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Quat, Vec3, rotate_inverse
from foundation.measurement import InPicture
from foundation.protocol import DETECTION_RANGE_M, POINT_SPAN

SAMPLES = 1600  # points on the target's whole surface; about 300 … 500 of them face the camera
SPHERE_MARGIN_M = 0.01  # m, margin around the target's bounding sphere for rounding errors
NEAR_M = 0.05  # m, the renderer's near plane
VISIBLE_FRACTION = 0.05  # a target is visible if at least this share of its silhouette is in the picture and not hidden

EDGES = tuple(
    (a, b) for a, b in itertools.combinations(range(8), 2) if (a ^ b).bit_count() == 1
)  # edges of a box whose corners are numbered by the bits of (x, y, z)


@dataclass(frozen=True, slots=True)
class Visibility:
    """The part of a target that one camera sees."""

    fraction: float  # share 0 … 1 of the target's silhouette in the picture, not hidden and within DETECTION_RANGE_M
    depth_m: float | None  # median planar depth of the visible part; None if nothing is visible

    @property
    def visible(self) -> bool:
        """Whether the fraction reaches VISIBLE_FRACTION."""
        return self.fraction >= VISIBLE_FRACTION


class Occluder(Protocol):
    """Obstacles to a view."""

    def hidden(self, origin: Vec3, points: Array) -> NDArray[np.bool_]:
        """Return for each point (N, 3) whether an obstacle lies between it and the origin."""
        ...


def surface_samples(mesh: Mesh, count: int = SAMPLES) -> tuple[Array, Array]:
    """Return `count` points (N, 3) and face normals (N, 3) spread evenly over a mesh's area. Deterministic."""
    tri = mesh.vertices[mesh.triangles].astype(np.float64)
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    area = np.linalg.norm(cross, axis=1)
    reach = np.cumsum(area)
    which = np.searchsorted(reach, (np.arange(count) + 0.5) / count * reach[-1])
    which = np.minimum(which, len(tri) - 1)
    # Roberts's two-dimensional sequence R2, folded into the triangle
    plastic = 1.32471795724474602596
    k = np.arange(count) + 0.5
    u, v = np.mod(k / plastic, 1.0), np.mod(k / plastic**2, 1.0)
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    a, b, c = tri[which, 0], tri[which, 1], tri[which, 2]
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), cross[which] / area[which, None]


class HardSolids:
    """The surfaces of static solids, without leaves."""

    def __init__(self, instances: Iterable[Instance]) -> None:
        self._instances = [i for i in instances if i.solid and not i.movable]
        self._boxes = np.empty((len(self._instances), 2, 3))
        for k, instance in enumerate(self._instances):
            placed = instance.vertices_ned()
            self._boxes[k] = placed.min(axis=0), placed.max(axis=0)
        self._hard = [i.mesh.without_foliage() for i in self._instances]

    def nearest(self, point: Vec3, within_m: float = math.inf) -> tuple[float, str]:
        """Return the distance (m) to the nearest surface and its solid's name; (within_m, '') if all are farther."""
        p = np.array(point)
        outside = np.maximum(np.maximum(self._boxes[:, 0] - p, p - self._boxes[:, 1]), 0.0)
        to_box = np.linalg.norm(outside, axis=1)
        order = np.argsort(to_box)
        best, found = within_m, -1
        for k in order[to_box[order] < within_m]:
            if to_box[k] > best:
                break
            instance = self._instances[k]
            local = turn(instance.turned).T @ (p - np.array(instance.position_ned))
            best, found = min((best, found), (distance_to_mesh(self._hard[k], local), k))
        return best, self._instances[found].name if found >= 0 else ""

    def clearance_m(self, point: Vec3) -> float:
        """Return the distance (m) from a point to the nearest surface. Leaves do not count."""
        return self.nearest(point)[0]


class Solids(HardSolids):
    """Static solids, indexed for ray casting. Leaves hide things too, but do not count for distances."""

    def __init__(self, instances: Iterable[Instance]) -> None:
        super().__init__(instances)
        self._owner = np.repeat(np.arange(len(self._instances)), [len(i.mesh.triangles) for i in self._instances])
        self._scene = RayScene.of_instances(self._instances)

    def hidden(self, origin: Vec3, points: Array) -> NDArray[np.bool_]:
        """Return for each point (N, 3) whether something solid lies between it and the origin."""
        return self._scene.are_blocked(origin, points - np.array(origin), BEFORE)

    def range_m(self, origin: Vec3, direction: Vec3) -> float:
        """Return the distance (m) to the first solid along a direction; inf if there is none."""
        unit = np.array(direction) / np.linalg.norm(direction)
        hits = self._scene.first_hits(origin, unit[None])
        return float(hits.distance[0]) if hits.triangle[0] != NOTHING else math.inf


class SolidsUnion(Solids):
    """Several groups of solids: the solids of a map, which are indexed once, and the solids that a record adds."""

    def __init__(self, *groups: Solids) -> None:
        self._groups = groups

    def hidden(self, origin: Vec3, points: Array) -> NDArray[np.bool_]:
        hidden: NDArray[np.bool_] = np.any([group.hidden(origin, points) for group in self._groups], axis=0)
        return hidden

    def range_m(self, origin: Vec3, direction: Vec3) -> float:
        return min(group.range_m(origin, direction) for group in self._groups)

    def nearest(self, point: Vec3, within_m: float = math.inf) -> tuple[float, str]:
        return min(group.nearest(point, within_m) for group in self._groups)


class SolidsExcept(Solids):
    """A map's solids without one instance, the target, so that the target does not hide itself."""

    def __init__(self, everything: Solids, left_out: Instance) -> None:
        """Share the ray scene of `everything`. Raises ValueError if `left_out` is not part of it."""
        self._instances, self._boxes = everything._instances, everything._boxes.copy()
        self._hard = everything._hard
        self._owner, self._scene = everything._owner, everything._scene
        self._out = next((k for k, instance in enumerate(self._instances) if instance.id == left_out.id), -1)
        if self._out < 0:
            raise ValueError(f"{left_out.name} is not among the solids")
        self._boxes[self._out] = np.inf  # infinitely far from any point

    def hidden(self, origin: Vec3, points: Array) -> NDArray[np.bool_]:
        """Return for each point (N, 3) whether something solid lies between it and the origin.

        The points must be on the surface of `left_out`, and `left_out` itself must not hide them. So if a ray hits
        `left_out` first, nothing hides the point of this ray.
        """
        hits = self._scene.first_hits(origin, points - np.array(origin), BEFORE)
        hidden = (hits.triangle != NOTHING) & (hits.distance < BEFORE)
        hidden[hidden] = self._owner[hits.triangle[hidden]] != self._out
        return np.asarray(hidden)

    def range_m(self, origin: Vec3, direction: Vec3) -> float:
        unit = (np.array(direction) / np.linalg.norm(direction)).astype(np.float32)[None]
        gone = 0.0
        while True:
            hits = self._scene.first_hits(np.array(origin) + gone * unit[0], unit)
            if hits.triangle[0] == NOTHING:
                return math.inf
            gone += float(hits.distance[0])
            if self._owner[hits.triangle[0]] != self._out:
                return gone
            gone += 1e-3  # past the surface of the instance left out


def distance_to_mesh(mesh: Mesh, point: Array) -> float:
    """Return the distance (m) from a point, in the mesh's axes, to the mesh's nearest triangle; inf if it has none.

    If the point's projection onto a triangle's plane is inside the triangle, the projection is the nearest point.
    Otherwise the nearest point is on an edge (Ericson, Real-Time Collision Detection, section 5.1.5).
    """
    tri = mesh.vertices[mesh.triangles].astype(np.float64)
    a, b, c = tri[:, 0], tri[:, 1], tri[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-18)
    above = np.einsum("ij,ij->i", point - a, normal)
    inside = np.ones(len(tri), dtype=bool)
    nearest = np.full(len(tri), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge, to = q - p, point - p
        inside &= np.einsum("ij,ij->i", np.cross(edge, to), normal) >= 0.0
        share = np.clip(
            np.einsum("ij,ij->i", to, edge) / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-18), 0.0, 1.0
        )
        gap = to - share[:, None] * edge
        nearest = np.minimum(nearest, np.einsum("ij,ij->i", gap, gap))
    nearest = np.where(inside, above**2 / square, nearest)
    return math.sqrt(float(nearest.min(initial=np.inf)))


class TargetView:
    """Measures the part of one target that a camera sees past the solids."""

    def __init__(self, mesh: Mesh, solids: Occluder) -> None:
        self._points, self._normals = surface_samples(mesh)
        self._own = RayScene.of_mesh(mesh)
        self._solids = solids
        self._radius = float(np.linalg.norm(mesh.vertices, axis=1).max())

    def warm_up(self) -> None:
        """Cast one ray, so that the first call of `sight` takes no longer than the next ones."""
        self._solids.hidden((0.0, 0.0, 0.0), self._points[:1])

    def sight(
        self,
        position_ned: Vec3,
        turned: float | Quat,
        pose: CameraPose,
        camera: CameraModel,
        past: Occluder | None = None,
    ) -> Visibility:
        """Return the visibility of the target at a pose. `past` replaces the solids as obstacles.

        Each sample that the target itself does not hide is weighted with the solid angle of the surface around it.
        """
        matrix, eye = turn(turned), np.array(pose.position_ned)
        origin = np.array(position_ned)
        if np.linalg.norm(origin - eye) > DETECTION_RANGE_M + self._radius or self._beside(position_ned, pose, camera):
            return Visibility(0.0, None)
        local_eye = matrix.T @ (eye - origin)
        way = self._points - local_eye
        square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
        weight = -np.einsum("ij,ij->i", way, self._normals) / square**1.5
        front = np.flatnonzero(weight > 0.0)
        if len(front) == 0:
            return Visibility(0.0, None)
        hits = self._own.first_hits(local_eye, way[front])
        shown = front[hits.distance > 0.9998]  # samples that are the first hit of their ray on the target
        total = float(weight[shown].sum())
        if total <= 0.0:
            return Visibility(0.0, None)
        points = self._points[shown] @ matrix.T + origin
        seen = self._in_frame(points, pose, camera)
        if seen.any():
            seen[seen] = ~(past or self._solids).hidden(pose.position_ned, points[seen])
        seen &= square[shown] <= DETECTION_RANGE_M**2
        if not seen.any():
            return Visibility(0.0, None)
        forward = np.array(_axes(pose)[0])
        depth, share = (points[seen] - eye) @ forward, weight[shown][seen]
        order = np.argsort(depth)
        middle = order[np.searchsorted(np.cumsum(share[order]), share.sum() / 2)]
        return Visibility(float(share.sum()) / total, float(depth[middle]))

    def _beside(self, position_ned: Vec3, pose: CameraPose, camera: CameraModel) -> bool:
        """Return whether the target's bounding sphere is outside the picture, so that no ray is needed."""
        x, y, z = in_camera(position_ned, pose)
        reach = self._radius + SPHERE_MARGIN_M
        across, under = camera.width / 2 / camera.focal_px, camera.height / 2 / camera.focal_px
        return (
            x < -reach
            or abs(y) - across * x > reach * math.hypot(1.0, across)
            or abs(z) - under * x > reach * math.hypot(1.0, under)
        )

    @staticmethod
    def _in_frame(points: Array, pose: CameraPose, camera: CameraModel) -> NDArray[np.bool_]:
        forward, right, down = (np.array(axis) for axis in _axes(pose))
        way = points - np.array(pose.position_ned)
        x = way @ forward
        across, under = camera.width / 2 / camera.focal_px, camera.height / 2 / camera.focal_px
        inside = (x > NEAR_M) & (np.abs(way @ right) <= across * x) & (np.abs(way @ down) <= under * x)
        return np.asarray(inside)


def _axes(pose: CameraPose) -> tuple[Vec3, Vec3, Vec3]:
    """Return the camera's forward, right and down axes in NED."""
    n, e, d = (rotate_inverse(pose.attitude, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    return (n[0], e[0], d[0]), (n[1], e[1], d[1]), (n[2], e[2], d[2])


def in_camera(point_ned: Vec3, pose: CameraPose) -> Vec3:
    """Return a point (m, NED) in camera axes: forward, right, down, m from the optical centre."""
    x, y, z = pose.position_ned
    return rotate_inverse(pose.attitude, (point_ned[0] - x, point_ned[1] - y, point_ned[2] - z))


def picture_box(corners: Sequence[Vec3], camera: CameraModel) -> InPicture | None:
    """Return the smallest rectangle x0, y0, x1, y1 (0 … 1000) of the picture that contains a box in space.

    `corners` (m, camera axes) are numbered as in EDGES. The result is cut at the picture's edges and includes hidden
    parts. None if no part of the box is in the picture.
    """
    across, under = 2.0 * camera.focal_px / camera.width, 2.0 * camera.focal_px / camera.height
    shown = [(across * y / x, under * z / x) for x, y, z in _ahead(corners)]  # -1 … 1 within the picture
    if not shown:
        return None
    x0, x1 = _cut(x for x, _ in shown)
    y0, y1 = _cut(y for _, y in shown)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def _ahead(corners: Sequence[Vec3]) -> Iterator[Vec3]:
    """Yield the corners of the part of a box beyond the near plane."""
    yield from (corner for corner in corners if corner[0] >= NEAR_M)
    for a, b in ((corners[a], corners[b]) for a, b in EDGES):
        if (a[0] < NEAR_M) != (b[0] < NEAR_M):
            part = (NEAR_M - a[0]) / (b[0] - a[0])
            yield (NEAR_M, a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2]))


def _cut(values: Iterable[float]) -> tuple[float, float]:
    """Return the least and the greatest value, cut to -1 … 1 and scaled to 0 … 1000."""
    numbers = list(values)
    low, high = max(min(numbers), -1.0), min(max(numbers), 1.0)
    return 0.5 * POINT_SPAN * (low + 1.0), 0.5 * POINT_SPAN * (high + 1.0)
