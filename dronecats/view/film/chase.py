"""The camera behind a drone: a little above it, around whatever stands in the way, and what it sees of the world.

The way of the camera is laid out over the whole flight at once, so that it knows of a wall before it is there: at each
quarter of a second it may stand in one of many places around the drone, blocked ones cost much, others the more the
farther they are from the place behind it, and of all ways through these places the cheapest is taken (dynamic
programming). What remains is smoothed, and the boom drawn in where the smoothing has led it into something.
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
from episodes.world.visibility import Solids, Together
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3, quat_from_euler

Array = NDArray[np.float64]

BOOM_M = 3.4  # from the drone to the camera
SHORTEST_M = 0.9  # at which an x500 still fills the picture and is not flown through
STEP_S = 0.25
PLACE_S, HEADING_S, SWING_S, BOOM_S = 0.35, 1.0, 0.6, 0.3  # σ of what is smoothed
AHEAD_M = 4.0  # the camera looks at a place as far ahead of the drone
ROOM_M = 0.35  # free of everything to each side of the camera
# where the camera may stand: turned away from behind the drone, raised, and with how much of its boom
AZIMUTHS_DEG = (15.0, -15.0, 38.0, -38.0, 68.0, -68.0, 100.0, -100.0)  # beside its back: it hides not what it flies to
ELEVATIONS_DEG = (20.0, 34.0, 52.0, 70.0)
LENGTHS = (1.0, 0.65, 0.4)
BLOCKED = 30.0  # what a place costs from which the drone is not seen; more than going all the way round it

HFOV_DEG, VFOV_DEG = 70.0, 50.0  # at most, of a chase view


@dataclass(frozen=True)
class ChaseWay:
    """The way of a camera behind a drone."""

    _places: PchipInterpolator  # s → north, east, down of the eye in m, yaw and pitch in rad
    first_s: float
    last_s: float

    def at(self, t: float) -> CameraPose:
        """Return where the camera is and looks; before the flight and after it, as it begins and ends."""
        north, east, down, yaw, pitch = map(float, self._places(min(max(t, self.first_s), self.last_s)))
        return CameraPose((north, east, down), quat_from_euler(0.0, pitch, yaw))


def chase(track: FlightTrack, end_s: float, standing: Solids) -> ChaseWay:
    """Return the way of a camera behind `track` from t = 0 to `end_s`, among what stands."""
    times = np.arange(0.0, max(end_s, STEP_S) + 2 * STEP_S, STEP_S)
    places = _smooth(track.positions(times), PLACE_S)
    heading = _smooth(track.headings(times), HEADING_S)
    candidates = np.array(list(itertools.product(AZIMUTHS_DEG, ELEVATIONS_DEG, LENGTHS)))
    blocked = np.array([_blocked(p, h, candidates, standing) for p, h in zip(places, heading, strict=True)])
    chosen = candidates[_cheapest(blocked, candidates)]
    azimuth = heading + np.radians(_smooth(chosen[:, 0], SWING_S))
    elevation = np.radians(_smooth(chosen[:, 1], SWING_S))
    out = _outwards(azimuth, elevation)
    free = np.array([standing.range_m(_vec3(p), _vec3(o)) for p, o in zip(places, out, strict=True)])
    boom = np.clip(np.minimum(_smooth(chosen[:, 2], SWING_S) * BOOM_M, free - ROOM_M), SHORTEST_M, BOOM_M)
    boom = _smooth(minimum_filter1d(boom, 2 * math.ceil(2.0 * BOOM_S / STEP_S) + 1), BOOM_S)
    eye = places + boom[:, None] * out
    turned = np.radians(_smooth(chosen[:, 0], SWING_S))
    ahead = AHEAD_M * (0.5 + 0.5 * np.cos(turned)) * np.cos(elevation) ** 2
    aim = places + ahead[:, None] * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(heading))])
    way = aim - eye
    yaw = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    pitch = -np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))
    return ChaseWay(PchipInterpolator(times, np.column_stack([eye, yaw, pitch])), 0.0, float(times[-1]))


def _smooth(values: Array, sigma_s: float) -> Array:
    return np.asarray(gaussian_filter1d(values, sigma_s / STEP_S, axis=0, mode="nearest"))


def _outwards(azimuth: Array, elevation: Array) -> Array:
    """Return the unit vectors (N, 3), NED, from the drone to the camera; azimuth 0: south of it."""
    flat = np.cos(elevation)
    return np.column_stack([-flat * np.cos(azimuth), -flat * np.sin(azimuth), -np.sin(elevation)])


def _blocked(place: Array, heading: float, candidates: Array, standing: Solids) -> NDArray[np.bool_]:
    """Return for each candidate whether something is between it, with room around it, and the drone."""
    azimuth, elevation = heading + np.radians(candidates[:, 0]), np.radians(candidates[:, 1])
    out = _outwards(azimuth, elevation)
    eye = place + (candidates[:, 2:] * BOOM_M + ROOM_M) * out
    side = ROOM_M * np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(len(azimuth))])
    up = ROOM_M * np.array([0.0, 0.0, -1.0])
    around = np.stack([eye, eye + side, eye - side, eye + up, eye - up])
    hidden = standing.hidden(_vec3(place), around.reshape(-1, 3)).reshape(len(around), -1)
    return np.asarray(hidden.any(axis=0))


def _cheapest(blocked: NDArray[np.bool_], candidates: Array) -> NDArray[np.intp]:
    """Return which candidate is taken at each step, (N,)."""
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
    costs, came = own + BLOCKED * blocked[0], []
    for row in blocked[1:]:
        total = costs[:, None] + between
        came.append(np.argmin(total, axis=0))
        costs = total[came[-1], np.arange(len(own))] + own + BLOCKED * row
    way = [int(np.argmin(costs))]
    for before in reversed(came):
        way.append(int(before[way[-1]]))
    return np.array(way[::-1])


def _vec3(place: Array) -> Vec3:
    return float(place[0]), float(place[1]), float(place[2])


def chase_lens(width: int, height: int) -> CameraModel:
    """Return the camera of a chase view of that size (px): as wide as its larger side allows."""
    focal = min(0.5 * width / math.tan(math.radians(HFOV_DEG / 2)), 0.5 * height / math.tan(math.radians(VFOV_DEG / 2)))
    return CameraModel(width, height, math.degrees(2.0 * math.atan(0.5 * width / focal)), (0.0, 0.0, 0.0))


class FilmStage:
    """Draws a flight. Every drone is there, seen from outside; the target is where the record says at that time."""

    def __init__(self, flight: RecordedFlight, lens: CameraModel, threads: int = 1) -> None:
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


def standing(flight: RecordedFlight) -> Solids:
    """Return what a camera has to keep clear of: all that stands, a target that does not move included."""
    world = flight.world
    return world.solids if world.target.movable else Together(world.solids, Solids((world.target,)))
