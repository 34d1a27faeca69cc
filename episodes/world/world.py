"""The world of one episode: its map with the target, and ground truth about them."""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from episodes import maps
from episodes.maps import assets
from episodes.maps.assets.multirotor import X500, Outline
from episodes.maps.conditions import in_conditions
from episodes.maps.scene import Instance, Moved, Scene, turn
from episodes.records.record import EpisodeRecord, TargetRecord
from episodes.world.fleet import DronePose, Fleet
from episodes.world.obstacles import bounding_box
from episodes.world.target import TargetMotion, Wheels, motion, on_ground
from episodes.world.visibility import Occluder, Solids, SolidsExcept, SolidsUnion, TargetView, in_camera, picture_box
from foundation.camera import CameraModel, camera_pose
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, course, quat_yaw, rotate, wrap_pi
from foundation.measurement import TargetMeasurement
from foundation.terrain import HeightField
from foundation.threads import once
from foundation.wording import did_you_mean, nearest

NATIVE_OFF_M = 0.001  # tolerance of a record's position of a native target (an object of the map)
NATIVE_TURNED_RAD = math.radians(0.1)  # tolerance of a native target's yaw


class World:
    """The map of a record with its target and look-alikes. Time is seconds since the episode began."""

    def __init__(
        self,
        record: EpisodeRecord,
        drone: Outline = X500,
        drones: int | None = None,
        conditions: SceneConditions = AS_BUILT,
    ) -> None:
        """Build the scene. All drones have the shape `drone`; `drones` is their number (None: one per start).

        `conditions` change only what a camera sees of the map. Raises UsageError for an unknown map, asset or
        paint, or a native target that the map does not have.
        """
        self.record = record
        self._motion = motion(record.target)
        built = in_conditions(maps.build(record.map, record.map_seed), conditions)
        next_id = max(i.id for i in built.instances) + 1
        native = _native(built, record)
        if native:  # use the exact pose on the map, because the pose in a record is rounded
            self._motion = TargetMotion((native.position_ned,), (0.0,), 0.0, native.yaw, 0.0)
        moves, ground = self._motion.speed_mps > 0.0, built.terrain
        target = native or _placed(next_id, "target", record.target, ground, movable=moves)
        lookalikes = tuple(
            _placed(next_id + k, f"candidate-{k}", candidate, ground)
            for k, candidate in enumerate(record.candidates, 1)
        )
        self.target = target
        self.target_id: int = target.id
        self.target_and_lookalikes = (target, *lookalikes)
        added = lookalikes if native else self.target_and_lookalikes
        self.scene: Scene = replace(built, instances=(*built.instances, *added), base=built)
        self.fleet = Fleet(record.starts, next_id + 1 + len(record.candidates), drone, drones)
        # the scene for cameras, with the drones of a fleet
        self.filmed: Scene = replace(self.scene, instances=(*self.scene.instances, *self.fleet.instances))
        self._native, self._lookalikes = native, lookalikes
        self._wheels = Wheels.if_any(record.target.asset, target.mesh) if moves else None
        box = bounding_box(target)
        self._half, self._middle = box.half_m, box.centre_frd

    @cached_property
    def solids(self) -> Solids:
        """The static things that may hide the target. Most cameras do not need them, and indexing takes a while."""
        of_map = solids(self.record.map, self.record.map_seed)
        if self._native:
            of_map = SolidsExcept(of_map, self._native)
        return SolidsUnion(of_map, Solids(self._lookalikes)) if self._lookalikes else of_map

    @cached_property
    def _view(self) -> TargetView:
        return TargetView(self.target.mesh, self.solids)

    def warm_up(self) -> None:
        """Build and compile what `measure` needs, so that the first measurement takes no longer than the next ones."""
        self._view.warm_up()

    def target_pose(self, t_s: float) -> tuple[Vec3, float | Quat]:
        """Return the target's pose: m NED of its origin, and its yaw (rad) or its attitude (FRD → NED)."""
        if not self.target.movable:
            return self.target.position_ned, self.target.turned
        return on_ground(self._wheels, self.scene.terrain, self._motion.pose(t_s))

    def target_upright(self, t_s: float) -> tuple[Vec3, float]:
        """Return the target's pose without pitch and roll (origin in m NED, yaw in rad), with the same box centre."""
        place, yaw = self._motion.pose(t_s)
        leaning, turned = self.target_pose(t_s)
        if not isinstance(turned, tuple):
            return place, yaw
        higher = self._centre(leaning, turned)[2] - self._centre(place, yaw)[2]
        return (place[0], place[1], place[2] + higher), yaw

    def target_centre(self, t_s: float) -> Vec3:
        """Return the centre (m, NED) of the target's box."""
        return self._centre(*self.target_pose(t_s))

    def _centre(self, place: Vec3, turned: float | Quat) -> Vec3:
        x, y, z = self._middle
        if isinstance(turned, tuple):
            arm = rotate(turned, (x, y, z))
            return (place[0] + arm[0], place[1] + arm[1], place[2] + arm[2])
        c, s = math.cos(turned), math.sin(turned)
        return (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] + z)

    def moved(self, t_s: float, drones: Mapping[int, DronePose] | None = None) -> Moved:
        """Return the poses of all moving instances for the renderer.

        `drones`: the drones to draw, by number: all except the one that carries the camera. With them, the poses are
        for the scene `filmed`; without, for `scene`.
        """
        moved: Moved = {self.target_id: self.target_pose(t_s)} if self._motion.speed_mps > 0.0 else {}
        return moved if drones is None else {**moved, **self.fleet.moved(drones)}

    def past(self, drones: Iterable[DronePose]) -> Occluder:
        """Return all obstacles that may hide the target: the static solids, and drones at these poses."""
        poses = tuple(drones)
        return self.fleet.among(self.solids, poses) if poses else self.solids

    def measure(
        self, t_s: float, position_ned: Vec3, attitude: Quat, camera: CameraModel, drones: Iterable[DronePose] = ()
    ) -> TargetMeasurement:
        """Return the true measurement of the target from a drone with this body origin (m) and attitude (FRD → NED).

        The other drones at the poses `drones` may hide the target.
        """
        place, turned = self.target_pose(t_s)
        centre = self._centre(place, turned)
        local = turn(turned).T @ (np.array(position_ned) - np.array(centre))
        beyond = [max(abs(float(v)) - h, 0.0) for v, h in zip(local, self._half, strict=True)]
        pose = camera_pose(position_ned, attitude, camera)
        sight = self._view.sight(place, turned, pose, camera, self.past(drones))
        toward = course(position_ned, centre)
        return TargetMeasurement(
            target_ned=centre,
            distance_m=math.dist(position_ned, centre),
            distance_box_m=math.hypot(*beyond),
            visible=sight.visible,
            visible_fraction=sight.fraction,
            bearing_deg=math.degrees(wrap_pi(toward - quat_yaw(attitude))),
            oracle_depth_m=sight.depth_m,
            target_frd=in_camera(centre, pose),
            target_box=picture_box([in_camera(corner, pose) for corner in self._corners(centre, turned)], camera),
        )

    def _corners(self, centre: Vec3, turned: float | Quat) -> list[Vec3]:
        """Return the corners (m, NED) of the target's box by its centre and its yaw or attitude."""
        x, y, z = self._half
        if isinstance(turned, tuple):
            arms = [rotate(turned, (a * x, b * y, d * z)) for a, b, d in itertools.product((-1.0, 1.0), repeat=3)]
            return [(centre[0] + n, centre[1] + e, centre[2] + down) for n, e, down in arms]
        c, s = math.cos(turned), math.sin(turned)
        return [
            (centre[0] + a * x * c - b * y * s, centre[1] + a * x * s + b * y * c, centre[2] + d * z)
            for a, b, d in itertools.product((-1.0, 1.0), repeat=3)
        ]

    def ground_down(self, north: float, east: float) -> float:
        """Return the NED z (m) of the ground."""
        return self.scene.terrain.at(north, east)

    def clearance_m(self, point_ned: Vec3) -> float:
        """Return the distance (m) from a point to the nearest solid that does not move, ground included.

        The target does not count. For its distance, see `measure(…).distance_box_m`.
        """
        return self.solids.clearance_m(point_ned)


def solids(name: str, seed: int) -> Solids:
    """Return the static solids of a map. The last four shipped maps stay indexed in this process."""
    return _solids(name, seed) if name in maps.shipped() else Solids(maps.build(name, seed).instances)


@once(4)
def _solids(name: str, seed: int) -> Solids:
    return Solids(maps.build(name, seed).instances)


def _placed(number: int, name: str, target: TargetRecord, ground: HeightField, *, movable: bool = False) -> Instance:
    """Return a record's target or look-alike as an instance at its start pose, on its wheels if it has wheels."""
    if target.paint is None:
        raise UsageError(f"field '{name}.paint' is missing. Only a target of the map may lack it.")
    mesh = assets.build(target.asset, target.paint, target.inscription)
    level = motion(target).pose(0.0)
    place, turned = on_ground(Wheels.if_any(target.asset, mesh), ground, level)
    attitude = turned if isinstance(turned, tuple) else None
    return Instance(number, name, target.asset, mesh, place, level[1], movable=movable, attitude=attitude)


def _native(built: Scene, record: EpisodeRecord) -> Instance | None:
    """Return the map's own instance that a record names as its target; None if it names none.

    Raises UsageError if the map's instance does not fit the record.
    """
    name = record.target.native
    if name is None:
        return None
    instance = next((i for i in built.instances if i.name == name and i.kind != "ground"), None)
    if instance is None:
        near = nearest(name, [i.name for i in built.instances if i.kind != "ground"], cutoff=0.4)
        hint = f": {did_you_mean(near)}" if near else "."
        raise UsageError(
            f"{record.id}: field 'target.native' is '{name}', which map '{record.map}' does not have{hint}"
        )
    if instance.movable or not instance.solid:
        raise UsageError(
            f"{record.id}: field 'target.native' is '{name}', which cannot be a target, because it is not solid or can"
            " move."
        )
    if instance.kind != record.target.asset:
        raise UsageError(
            f"{record.id}: field 'target.asset' is '{record.target.asset}', but '{name}' is a '{instance.kind}'."
        )
    place, yaw = motion(record.target).pose(0.0)
    off, turned = math.dist(place, instance.position_ned), wrap_pi(yaw - instance.yaw)
    if off > NATIVE_OFF_M or abs(turned) > NATIVE_TURNED_RAD:
        raise UsageError(
            f"{record.id}: field 'target.position_ned' or 'target.yaw_deg' differs by {off:.3f} m and"
            f" {math.degrees(turned):.2f}° from the place of '{name}'."
        )
    return instance
