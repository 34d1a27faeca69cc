"""Assesses a draft of an episode: runs the episode checks, and draws the pictures of the drones' cameras."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check import rules
from episodes.authoring.check.finding import RuleFinding
from episodes.camera.renderer import Renderer
from episodes.maps.scene import Instance, Scene
from episodes.records.record import EpisodeRecord, parse
from episodes.world.fleet import Fleet, hovering
from episodes.world.target import Wheels, motion, on_ground
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, quat_from_euler
from foundation.terrain import FLAT

PREVIEW = CameraModel(width=640, height=360)
THREADS = 2  # number of threads that draw


def findings(record: EpisodeRecord) -> list[RuleFinding]:
    """Return the findings of `dronecats episodes check`. An invalid record gives one failed finding."""
    try:
        return rules.check(World(parse(record.to_json(), record.id or "the draft")))
    except UsageError as error:
        return [RuleFinding("the record", False, str(error).split(": ", 1)[-1].rstrip("."), "a readable one")]


class Previews:
    """Draws the pictures of drones' cameras.

    A new renderer is built only if the map, the appearance of the record's objects or the number of drones changes.
    """

    def __init__(self) -> None:
        self._look: object = None  # fields of the record that `_renderer` was built for
        self._renderer: Renderer | None = None
        self._ids: tuple[int, ...] = ()  # renderer ids of target and look-alikes
        self._fleet: Fleet | None = None
        self._ground = FLAT
        self._wheels: tuple[Wheels | None, ...] = ()  # wheels of the objects in _ids; None: no wheels

    def picture(self, record: EpisodeRecord, drone: int, t_s: float = 0.0) -> NDArray[np.uint8]:
        """Return a drone's (360, 640, 3) sRGB picture, with targets at the episode's time `t_s`. Raises UsageError."""
        renderer = self._ready(record)
        start = record.starts[drone]
        attitude = quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg))
        placed = [target for target in (record.target, *record.candidates) if target.native is None]
        moved: dict[int, tuple[Vec3, float | Quat] | None] = {
            number: on_ground(wheels, self._ground, motion(target).pose(t_s))
            for number, wheels, target in zip(self._ids, self._wheels, placed, strict=True)
        }
        if self._fleet:
            hovering_drones = {k: hovering(start) for k, start in enumerate(record.starts) if k != drone}
            moved |= self._fleet.moved(hovering_drones)
        return renderer.render(camera_pose(start.position_ned, attitude, PREVIEW), moved).rgb

    def _ready(self, record: EpisodeRecord) -> Renderer:
        looks = [(t.asset, t.paint, t.inscription, t.native) for t in (record.target, *record.candidates)]
        look = (record.map, record.map_seed, looks, len(record.starts))
        if self._renderer is None or look != self._look:
            self.close()
            world = World(record)
            scene, free = _movable(world)
            self._ids = tuple(instance.id for instance in free)
            self._wheels = tuple(Wheels.if_any(instance.kind, instance.mesh) for instance in free)
            self._fleet, self._ground = world.fleet, world.scene.terrain
            self._renderer, self._look = Renderer(scene, PREVIEW, THREADS, shadow_cells=2048), look
        return self._renderer

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _movable(world: World) -> tuple[Scene, tuple[Instance, ...]]:
    """Return the scene, and the objects that the record adds, target first. Only they and drones are movable."""
    placed = len(world.record.candidates) + (world.record.target.native is None)
    plan = world.scene.instances[: len(world.scene.instances) - placed]
    free = tuple(replace(instance, movable=True) for instance in world.scene.instances[len(plan) :])
    still = tuple(replace(instance, movable=False) for instance in plan)
    return replace(world.scene, instances=(*still, *free, *world.fleet.instances)), free
