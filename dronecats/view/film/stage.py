"""The world of a flight with everybody in it, seen from any place."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dronecats.view.film.flown import FilmedFlight
from episodes.camera.renderer.renderer import Renderer, View
from episodes.maps.assets.multirotor import multirotor
from episodes.maps.scene import Instance, Moved
from episodes.world.visibility import Solids, Together
from foundation.camera import CameraModel, CameraPose

HFOV_DEG, VFOV_DEG = 70.0, 50.0  # at most, of a chase view


def chase_lens(width: int, height: int) -> CameraModel:
    """Return the camera of a chase view of that size (px): as wide as its larger side allows."""
    focal = min(0.5 * width / math.tan(math.radians(HFOV_DEG / 2)), 0.5 * height / math.tan(math.radians(VFOV_DEG / 2)))
    return CameraModel(width, height, math.degrees(2.0 * math.atan(0.5 * width / focal)), (0.0, 0.0, 0.0))


class FilmStage:
    """Draws a flight. Every drone is there, seen from outside; the target is where the record says at that time."""

    def __init__(self, flight: FilmedFlight, lens: CameraModel, threads: int = 1) -> None:
        self._flight = flight
        world = flight.world
        mesh = multirotor(flight.outline)
        first = max(one.id for one in world.scene.instances) + 1
        self.ids = {drone: first + k for k, drone in enumerate(flight.drones)}  # drone → id in a view
        drones = tuple(
            Instance(number, f"drone-{drone}", "drone", mesh, flight.tracks[drone].at(0.0).position_ned, 0.0, True)
            for drone, number in self.ids.items()
        )
        scene = replace(world.scene, instances=(*world.scene.instances, *drones))
        self._renderer = Renderer(scene, lens, threads)

    def moved(self, t: float) -> Moved:
        """Return where everything that moves is at a time of the episode."""
        poses = {drone: self._flight.tracks[drone].at(t) for drone in self.ids}
        drones = {self.ids[drone]: (pose.position_ned, pose.attitude) for drone, pose in poses.items()}
        return {**self._flight.world.moved(max(0.0, t)), **drones}

    def picture(self, pose: CameraPose, t: float) -> NDArray[np.uint8]:
        """Return what a camera sees at a time, (H, W, 3) RGB."""
        return self._renderer.picture(pose, self.moved(t))

    def view(self, pose: CameraPose, t: float) -> View:
        """Return the same picture with depths and the ids of what is seen."""
        return self._renderer.render(pose, self.moved(t))

    def close(self) -> None:
        """Let the renderer's threads go."""
        self._renderer.close()


def standing(flight: FilmedFlight) -> Solids:
    """Return what a camera has to keep clear of: all that stands, a target that does not move included."""
    world = flight.world
    return world.solids if world.target.movable else Together(world.solids, Solids((world.target,)))
