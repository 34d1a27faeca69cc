"""Represents the drones of an episode in camera images, and as obstacles to the view of the target."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.multirotor import X500, Outline, multirotor
from episodes.maps.scene import Array, Instance, Moved, turn
from episodes.records.record import StartPose
from episodes.world.rays import BEFORE, RayScene
from episodes.world.visibility import Occluder
from foundation.frames import Quat, Vec3, quat_from_euler


@dataclass(frozen=True, slots=True)
class DronePose:
    """The pose of a drone."""

    position_ned: Vec3  # m, body origin
    attitude: Quat  # FRD → NED


class Fleet:
    """The drones of a record, each visible to all others. A single drone is not drawn."""

    def __init__(
        self, starts: tuple[StartPose, ...], first_id: int, shape: Outline = X500, count: int | None = None
    ) -> None:
        """Drone k has the id `first_id` + k in the id image. `count`: number of drones to draw; None: one per start.

        If `count` exceeds the number of starts, the additional drones have the last start. If it is smaller, only the
        first `count` starts are drawn.
        """
        self.starts = tuple(hovering(start) for start in starts)
        all_starts = (*starts, *[starts[-1]] * ((count or 0) - len(starts)))[:count]
        self.instances: tuple[Instance, ...] = ()
        self._shape = _Shape(shape) if len(all_starts) > 1 else None
        if self._shape:
            mesh = multirotor(shape)
            self.instances = tuple(
                Instance(
                    first_id + k, f"drone-{k}", "drone", mesh, start.position_ned, math.radians(start.yaw_deg), True
                )
                for k, start in enumerate(all_starts)
            )

    def moved(self, poses: Mapping[int, DronePose]) -> Moved:
        """Return the drones' poses for the renderer; a drone without an entry in `poses` (by number) is not drawn."""
        return {
            instance.id: (poses[k].position_ned, poses[k].attitude) if k in poses else None
            for k, instance in enumerate(self.instances)
        }

    def other_starts(self, drone: int) -> dict[int, DronePose]:
        """Return the start poses of all drones except `drone`, by number."""
        return {k: pose for k, pose in enumerate(self.starts) if k != drone}

    def among(self, solids: Occluder, poses: Iterable[DronePose]) -> Occluder:
        """Return solids and drones at `poses` as one occluder; in an episode with one drone, only the solids."""
        return _OccluderWithDrones(solids, self._shape, tuple(poses)) if self._shape else solids


@dataclass(frozen=True, slots=True)
class _OccluderWithDrones:
    solids: Occluder
    shape: "_Shape"
    poses: tuple[DronePose, ...]

    def hidden(self, origin: Vec3, points: Array) -> NDArray[np.bool_]:
        """Return for each point (N, 3) whether a solid or a drone lies between it and the origin."""
        hidden = self.solids.hidden(origin, points)
        for pose in self.poses:
            hidden = hidden | self.shape.between(origin, points, pose)
        return hidden


class _Shape:
    """The triangles of one drone for ray casts, in its FRD axes."""

    def __init__(self, shape: Outline) -> None:
        mesh = multirotor(shape)
        self._radius = float(np.linalg.norm(mesh.vertices, axis=1).max())
        self._scene = RayScene.of_mesh(mesh)

    def between(self, origin: Vec3, points: Array, pose: DronePose) -> NDArray[np.bool_]:
        """Return for each point (N, 3) whether the ray from the origin to it hits the drone first."""
        axes = turn(pose.attitude).T
        way = points - np.array(origin)
        toward = np.array(pose.position_ned) - np.array(origin)
        along = np.clip(way @ toward / np.maximum(np.einsum("ij,ij->i", way, way), 1e-12), 0.0, 1.0)
        near = np.flatnonzero(np.linalg.norm(along[:, None] * way - toward, axis=1) <= self._radius)
        hidden = np.zeros(len(points), dtype=np.bool_)
        if len(near):
            hidden[near] = self._scene.are_blocked(-(axes @ toward), way[near] @ axes.T, BEFORE)
        return hidden


def hovering(start: StartPose) -> DronePose:
    """Return the pose of a drone that hovers level at its start."""
    return DronePose(start.position_ned, quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg)))
