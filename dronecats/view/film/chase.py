"""The chase camera behind a drone: plans the camera's path around obstacles, and renders pictures.

The path is planned over the complete flight, so that the camera moves away from a wall in time. For every quarter of a
second, many places around the drone are candidates. The cost of a place grows with the distance from the place behind
the drone, and is much higher if an obstacle blocks the view. Dynamic programming finds the cheapest path. The path is
then smoothed. Where the smoothed path would enter an obstacle, the boom (the line from drone to camera) is shortened.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import FlightTrack
from episodes.camera.renderer.renderer import Renderer, View
from episodes.maps.assets.multirotor import multirotor
from episodes.maps.scene import Instance, Moved
from episodes.world.visibility import Solids, SolidsUnion
from foundation.camera import CameraModel, CameraPose
from foundation.frames import quat_from_euler, vec3

Array = NDArray[np.float64]

BOOM_M = 3.4  # m from the drone to the camera
SHORTEST_M = 0.9  # m, shortest boom: a drone like the x500 (0.5 m) fills the picture but is not clipped
STEP_S = 0.25  # s between planned places
PLACE_S, HEADING_S, ANGLE_SIGMA_S, BOOM_S = 0.35, 1.0, 0.6, 0.3  # s, σ of the smoothing over time
AHEAD_M = 4.0  # m; the camera looks at a point at most this far ahead of the drone
CAMERA_MARGIN_M = 0.35  # m, free space on each side of the camera
# candidate places of the camera: azimuth (0 is behind the drone), elevation, share of the boom length
AZIMUTHS_DEG = (15.0, -15.0, 38.0, -38.0, 68.0, -68.0, 100.0, -100.0)  # not 0, where the drone would hide its goal
ELEVATIONS_DEG = (20.0, 34.0, 52.0, 70.0)
LENGTHS = (1.0, 0.65, 0.4)
BLOCKED = 30.0  # cost of a place with a blocked view; higher than the cost of moving around the drone

HFOV_DEG, VFOV_DEG = 70.0, 50.0  # largest horizontal and vertical field of view of a chase view


@dataclass(frozen=True)
class ChasePath:
    _places: PchipInterpolator  # s → north, east, down of the camera (m), yaw, pitch (rad)
    last_s: float

    def at(self, t: float) -> CameraPose:
        """Return the pose of the camera at a time (s). Times outside of the flight give its first or last pose."""
        north, east, down, yaw, pitch = map(float, self._places(min(max(t, 0.0), self.last_s)))
        return CameraPose((north, east, down), quat_from_euler(0.0, pitch, yaw))


def chase(track: FlightTrack, end_s: float, obstacles: Solids) -> ChasePath:
    """Return the path of a camera that follows `track` from t = 0 to `end_s` and avoids the obstacles."""
    times = np.arange(0.0, max(end_s, STEP_S) + 2 * STEP_S, STEP_S)
    places = _smooth(track.positions(times), PLACE_S)
    heading = _smooth(track.headings(times), HEADING_S)
    candidates = np.array(list(itertools.product(AZIMUTHS_DEG, ELEVATIONS_DEG, LENGTHS)))
    blocked = np.array([_blocked(p, h, candidates, obstacles) for p, h in zip(places, heading, strict=True)])
    chosen = candidates[_cheapest(blocked, candidates)]
    azimuth = heading + np.radians(_smooth(chosen[:, 0], ANGLE_SIGMA_S))
    elevation = np.radians(_smooth(chosen[:, 1], ANGLE_SIGMA_S))
    out = _outwards(azimuth, elevation)
    free = np.array([obstacles.range_m(vec3(p), vec3(o)) for p, o in zip(places, out, strict=True)])
    boom = np.clip(
        np.minimum(_smooth(chosen[:, 2], ANGLE_SIGMA_S) * BOOM_M, free - CAMERA_MARGIN_M), SHORTEST_M, BOOM_M
    )
    boom = _smooth(minimum_filter1d(boom, 2 * math.ceil(2.0 * BOOM_S / STEP_S) + 1), BOOM_S)
    eye = places + boom[:, None] * out
    turned = np.radians(_smooth(chosen[:, 0], ANGLE_SIGMA_S))
    ahead = AHEAD_M * (0.5 + 0.5 * np.cos(turned)) * np.cos(elevation) ** 2
    aim = places + ahead[:, None] * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(heading))])
    way = aim - eye
    yaw = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    pitch = -np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))
    return ChasePath(PchipInterpolator(times, np.column_stack([eye, yaw, pitch])), float(times[-1]))


def _smooth(values: Array, sigma_s: float) -> Array:
    return np.asarray(gaussian_filter1d(values, sigma_s / STEP_S, axis=0, mode="nearest"))


def _outwards(azimuth: Array, elevation: Array) -> Array:
    """Return the unit vectors (N, 3), NED, from the drone to the camera. Azimuth 0: the camera is in the south."""
    flat = np.cos(elevation)
    return np.column_stack([-flat * np.cos(azimuth), -flat * np.sin(azimuth), -np.sin(elevation)])


def _blocked(place: Array, heading: float, candidates: Array, obstacles: Solids) -> NDArray[np.bool_]:
    """Return (N,): whether an obstacle hides the drone at `place` from the candidate place or from a point near it."""
    azimuth, elevation = heading + np.radians(candidates[:, 0]), np.radians(candidates[:, 1])
    out = _outwards(azimuth, elevation)
    eye = place + (candidates[:, 2:] * BOOM_M + CAMERA_MARGIN_M) * out
    side = CAMERA_MARGIN_M * np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(len(azimuth))])
    up = CAMERA_MARGIN_M * np.array([0.0, 0.0, -1.0])
    around = np.stack([eye, eye + side, eye - side, eye + up, eye - up])
    hidden = obstacles.hidden(vec3(place), around.reshape(-1, 3)).reshape(len(around), -1)
    return np.asarray(hidden.any(axis=0))


def _cheapest(blocked: NDArray[np.bool_], candidates: Array) -> NDArray[np.intp]:
    """Return the index of the candidate at each step of the cheapest path, (steps,)."""
    azimuth, elevation, length = candidates.T
    own = (
        ((abs(azimuth) - AZIMUTHS_DEG[0]) / 50.0) ** 2
        + ((elevation - ELEVATIONS_DEG[0]) / 35.0) ** 2
        + 1.5 * (1.0 - length)
    )
    between = (
        2.0 * ((azimuth[:, None] - azimuth) / 30.0) ** 2
        + 2.0 * ((elevation[:, None] - elevation) / 20.0) ** 2
        + 4.0 * (length[:, None] - length) ** 2
    )
    costs, previous = own + BLOCKED * blocked[0], []
    for row in blocked[1:]:
        total = costs[:, None] + between
        previous.append(np.argmin(total, axis=0))
        costs = total[previous[-1], np.arange(len(own))] + own + BLOCKED * row
    way = [int(np.argmin(costs))]
    for before in reversed(previous):
        way.append(int(before[way[-1]]))
    return np.array(way[::-1])


def chase_lens(width: int, height: int) -> CameraModel:
    """Return the camera of a chase view with this size (px)."""
    focal = min(0.5 * width / math.tan(math.radians(HFOV_DEG / 2)), 0.5 * height / math.tan(math.radians(VFOV_DEG / 2)))
    return CameraModel(width, height, math.degrees(2.0 * math.atan(0.5 * width / focal)), (0.0, 0.0, 0.0))


class FilmStage:
    """Renders a flight at any time, with all its drones and the target."""

    def __init__(self, flight: RecordedFlight, lens: CameraModel) -> None:
        self._flight = flight
        world = flight.world
        mesh = multirotor(flight.outline)
        first = max(instance.id for instance in world.scene.instances) + 1
        self.ids = {drone: first + k for k, drone in enumerate(flight.drones)}  # drone → instance id in `View`
        drones = tuple(
            Instance(number, f"drone-{drone}", "drone", mesh, flight.tracks[drone].at(0.0).position_ned, 0.0, True)
            for drone, number in self.ids.items()
        )
        scene = replace(world.scene, instances=(*world.scene.instances, *drones))
        self._renderer = Renderer(scene, lens, 1)

    def moved(self, t: float) -> Moved:
        """Return the poses of everything that moves at a time of the episode."""
        poses = {drone: self._flight.tracks[drone].at(t) for drone in self.ids}
        drones = {self.ids[drone]: (pose.position_ned, pose.attitude) for drone, pose in poses.items()}
        return {**self._flight.world.moved(max(0.0, t)), **drones}

    def picture(self, pose: CameraPose, t: float) -> NDArray[np.uint8]:
        """Return the picture of a camera at a time, (H, W, 3) RGB."""
        return self._renderer.picture(pose, self.moved(t))

    def view(self, pose: CameraPose, t: float) -> View:
        """Return the picture with depths and instance ids."""
        return self._renderer.render(pose, self.moved(t))

    def close(self) -> None:
        self._renderer.close()


def obstacles_of(flight: RecordedFlight) -> Solids:
    """Return the obstacles for a camera: all static objects, including a static target."""
    world = flight.world
    return world.solids if world.target.movable else SolidsUnion(world.solids, Solids((world.target,)))
