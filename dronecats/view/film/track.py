"""Where a drone really was, at any time of the episode.

flight.tlog holds the truth bus as it travelled: fifty poses a second, with attitude. So does the log that a simulated
PX4 wrote on board, where it was kept. Without both, truth.jsonl has two places a second and a heading, and the drone is
drawn level between them.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from dronecats.report.afterflight.sources import ulog_topics
from episodes.world.fleet import DronePose
from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler
from foundation.mavlink import Parser, dialect
from foundation.run_folder.rows import FrameTruth, Pose
from foundation.truth import Origin, TruthSample, truth_sample

TIME_BYTES = 8  # before each frame of a tlog
MAVLINK2 = 0xFD
SMOOTHED_S = 0.06  # places travel in steps of 1.1 cm, which would be seen as a tremor
GAP_S = 0.2  # between two samples that are smoothed over
LEVEL_PERIOD_S = 0.1  # at which a track without attitudes is laid out

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DroneTrack:
    """The way of one drone. `at` is defined at all times: before the first sample and after the last it stays there."""

    t: Array  # (N,) s since the episode began, rising, at least one
    position_ned: Array  # (N, 3) m
    attitude: Rotation  # N of them, FRD → NED
    level: bool  # nobody wrote down how it leant, and it is drawn level

    def at(self, t: float) -> DronePose:
        """Return where the drone was: places in a straight line between two samples, attitudes on the shortest arc."""
        t = min(max(t, float(self.t[0])), float(self.t[-1]))
        if len(self.t) == 1:
            x, y, z, w = self.attitude[0].as_quat()
            return DronePose(_vec3(self.position_ned[0]), (float(w), float(x), float(y), float(z)))
        after = min(max(int(np.searchsorted(self.t, t)), 1), len(self.t) - 1)
        pair = slice(after - 1, after + 1)
        x, y, z, w = Slerp(self.t[pair], self.attitude[pair])(t).as_quat()
        share = (t - self.t[after - 1]) / (self.t[after] - self.t[after - 1])
        place = (1.0 - share) * self.position_ned[after - 1] + share * self.position_ned[after]
        return DronePose(_vec3(place), (float(w), float(x), float(y), float(z)))

    def positions(self, times: Array) -> Array:
        """Return the places (len(times), 3), m NED."""
        return np.column_stack([np.interp(times, self.t, self.position_ned[:, k]) for k in range(3)])

    def headings(self, times: Array) -> Array:
        """Return the yaw (len(times),), rad, without jumps: it counts on beyond π."""
        forward = self.attitude.apply((1.0, 0.0, 0.0)).reshape(-1, 3)
        return np.asarray(np.interp(times, self.t, np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))))


def logged(path: Path, t0_us: int, origin: Origin) -> dict[int, DroneTrack]:
    """Return the tracks in a tlog by drone; {} where it is missing or holds no truth."""
    try:
        data = path.read_bytes()
    except OSError:
        return {}
    heard: dict[int, list[TruthSample]] = {}
    for message in Parser().feed(_of_truth(data)):
        sample = truth_sample(message, origin)
        own = heard.setdefault(sample.drone, [])
        if not own or sample.time_us > own[-1].time_us:
            own.append(sample)
    tracks = {}
    for drone, samples in heard.items():
        t = np.array([(one.time_us - t0_us) / 1e6 for one in samples])
        places = np.array([one.position_ned for one in samples], float)
        turned = Rotation.from_quat([(*one.attitude[1:], one.attitude[0]) for one in samples])
        tracks[drone] = DroneTrack(t, _smoothed(t, places), turned, level=False)
    return tracks


def onboard(path: Path, t0_us: int, origin: Origin) -> DroneTrack | None:
    """Return the truth that a simulated PX4 wrote into its own log; None where it wrote none, as a real one.

    Raises UsageError when the file is no ULog.
    """
    log = ulog_topics(path, "vehicle_local_position_groundtruth", "vehicle_attitude_groundtruth")
    place, turned = log.get("vehicle_local_position_groundtruth"), log.get("vehicle_attitude_groundtruth")
    if place is None or turned is None or len(place["timestamp"]) < 2 or len(turned["timestamp"]) < 2:
        return None
    first = geodetic_to_ned(*origin, *(float(place[name][-1]) for name in ("ref_lat", "ref_lon", "ref_alt")))
    at_us, attitude_us = place["timestamp"].astype(float), turned["timestamp"].astype(float)
    inside = (at_us >= attitude_us[0]) & (at_us <= attitude_us[-1])
    quaternions = np.column_stack([turned[f"q[{k}]"] for k in (1, 2, 3, 0)])
    places = np.column_stack([place[name] for name in ("x", "y", "z")]).astype(float) + first
    t = (at_us[inside] - t0_us) / 1e6
    return DroneTrack(
        t, places[inside], Slerp(attitude_us, Rotation.from_quat(quaternions))(at_us[inside]), level=False
    )


def _of_truth(data: bytes) -> bytes:
    """Return the frames of a tlog that tell poses, one after the other."""
    found, at = [], TIME_BYTES
    while at + 12 <= len(data):
        if data[at] != MAVLINK2:
            at += 1  # torn by a kill, or another version: look for the next frame
            continue
        end = at + 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        if int.from_bytes(data[at + 7 : at + 10], "little") == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
            found.append(data[at:end])
        at = end + TIME_BYTES
    return b"".join(found)


def _smoothed(t: Array, places: Array) -> Array:
    if len(t) < 3 or float(np.diff(t).max()) > GAP_S:
        return places
    return np.asarray(gaussian_filter1d(places, SMOOTHED_S / float(np.median(np.diff(t))), axis=0, mode="nearest"))


def traced(rows: Iterable[Pose | FrameTruth]) -> dict[int, DroneTrack]:
    """Return the tracks by drone that truth.jsonl tells: smooth between its places, and level."""
    found: dict[int, dict[float, tuple[Vec3, float]]] = {}
    for row in rows:
        if row.position_ned is not None:
            found.setdefault(row.drone, {})[row.t] = row.position_ned, math.radians(row.yaw_deg or 0.0)
    tracks = {}
    for drone, told in found.items():
        t = np.array(sorted(told))
        places = np.array([told[each][0] for each in t], float)
        yaw = np.unwrap([told[each][1] for each in t])
        if len(t) > 1:
            fine = np.append(np.arange(t[0], t[-1], LEVEL_PERIOD_S), t[-1])
            places, yaw, t = PchipInterpolator(t, places)(fine), PchipInterpolator(t, yaw)(fine), fine
        turned = [quat_from_euler(0.0, 0.0, float(each)) for each in yaw]
        tracks[drone] = DroneTrack(t, places, Rotation.from_quat([(*q[1:], q[0]) for q in turned]), level=True)
    return tracks


def _vec3(place: Array) -> Vec3:
    return float(place[0]), float(place[1]), float(place[2])
