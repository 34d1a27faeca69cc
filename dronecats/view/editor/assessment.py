"""What is true of a draft: the checks that accept an episode, and what a drone's camera sees at its start."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check import rules
from episodes.authoring.check.finding import RuleFinding
from episodes.camera.renderer import Renderer
from episodes.camera.renderer.layout import camera_pose
from episodes.maps.scene import Instance, Scene
from episodes.records.record import EpisodeRecord, TargetRecord, parse
from episodes.world.fleet import Fleet, hovering
from episodes.world.target import Wheels, motion, on_ground
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, quat_from_euler
from foundation.terrain import FLAT

PREVIEW = CameraModel(width=640, height=360)


def findings(record: EpisodeRecord) -> list[RuleFinding]:
    """Return what `dronecats episodes check` would find; a record that cannot even be read is one red finding."""
    try:
        return rules.check(World(parse(record.to_json(), record.id or "the draft")))
    except UsageError as error:
        return [RuleFinding("the record", False, str(error).split(": ", 1)[-1].rstrip("."), "one that can be read")]


@dataclass(frozen=True, slots=True)
class Appearance:
    """All of a record that a renderer must be built for; what only moves is not of it."""

    map: str
    seed: int
    target: tuple[str, str | None, str | None, str | None]  # asset, paint, inscription, native
    others: tuple[tuple[str, str | None, str | None, str | None], ...]
    drones: int


class Previews:
    """Pictures of what drones see. Dragging a thing moves it in the scene; only another look builds another one."""

    def __init__(self, threads: int = 2) -> None:
        """Take the number of threads that draw."""
        self._threads = threads
        self._look: Appearance | None = None
        self._renderer: Renderer | None = None
        self._ids: tuple[int, ...] = ()
        self._fleet: Fleet | None = None
        self._ground = FLAT
        self._wheels: tuple[Wheels | None, ...] = ()  # of each of these

    def picture(self, record: EpisodeRecord, drone: int, t_s: float = 0.0) -> NDArray[np.uint8]:
        """Return the (360, 640, 3) sRGB picture of one drone at its start. Raises UsageError."""
        renderer = self._ready(record)
        start = record.starts[drone]
        attitude = quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg))
        placed = [one for one in (record.target, *record.candidates) if one.native is None]
        moved: dict[int, tuple[Vec3, float | Quat] | None] = {
            number: on_ground(wheels, self._ground, motion(one).pose(t_s))
            for number, wheels, one in zip(self._ids, self._wheels, placed, strict=True)
        }
        if self._fleet:
            others = {k: hovering(one) for k, one in enumerate(record.starts) if k != drone}
            moved |= self._fleet.moved(others)
        return renderer.render(camera_pose(start.position_ned, attitude, PREVIEW), moved).rgb

    def _ready(self, record: EpisodeRecord) -> Renderer:
        others = tuple(_look(one) for one in record.candidates)
        look = Appearance(record.map, record.map_seed, _look(record.target), others, len(record.starts))
        if self._renderer is None or look != self._look:
            if self._renderer is not None:
                self._renderer.close()
            world = World(record)
            scene, free = _movable(world)
            self._ids = tuple(one.id for one in free)
            self._wheels = tuple(Wheels.if_any(one.kind, one.mesh) for one in free)
            self._fleet, self._ground = world.fleet, world.scene.terrain
            self._renderer, self._look = Renderer(scene, PREVIEW, self._threads, shadow_cells=2048), look
        return self._renderer

    def close(self) -> None:
        """Let the renderer's threads go."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _look(one: TargetRecord) -> tuple[str, str | None, str | None, str | None]:
    return (one.asset, one.paint, one.inscription, one.native)


def _movable(world: World) -> tuple[Scene, tuple[Instance, ...]]:
    """Return what cameras see, free to move what the record placed, and these things, target first."""
    placed = len(world.record.candidates) + (world.record.target.native is None)
    plan = world.scene.instances[: len(world.scene.instances) - placed]
    free = tuple(replace(one, movable=True) for one in world.scene.instances[len(plan) :])
    still = tuple(replace(one, movable=False) for one in plan)
    return replace(world.scene, instances=(*still, *free, *world.fleet.instances)), free
