"""True and estimated tracks of drones, as arrays.

The truth bus (the simulator's messages in flight.tlog) and the onboard log of a simulated PX4 (a ULog; needs pyulog)
have fifty true poses per second with attitudes. truth.jsonl has two positions per second with headings. A drone without
known attitudes is drawn level.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from dronecats.report.recorded.telemetry import DroneTelemetry, rising
from episodes.world.fleet import DronePose
from foundation.errors import UsageError
from foundation.extras import is_installed
from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler, vec3
from foundation.run_folder import layout
from foundation.run_folder.rows import EstimatedPose, FrameTruth, Pose
from foundation.truth import Origin, TruthSample

SMOOTHED_S = 0.06  # s, sigma of the smoothing: positions on the truth bus have steps of 1.1 cm, visible as jitter
GAP_S = 0.2  # s; a track with a longer interval between two samples is not smoothed
LEVEL_PERIOD_S = 0.1  # s between two samples of a level track for drawing

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightTrack:
    """The track of one drone or target: n ≥ 1 samples with rising times."""

    t_s: Array  # (n,) s of vehicle time since the episode began
    position_ned: Array  # (n, 3) m
    velocity_ned: Array  # (n, 3) m/s; NaN: not known
    attitude: Array  # (n, 4) w, x, y, z, FRD → NED
    level: bool = False  # only the heading of the attitude is known

    def __len__(self) -> int:
        return len(self.t_s)

    def newest(self, t_s: float) -> int:
        """Return the index of the newest sample at a time, with 1 µs tolerance; 0 before the first sample."""
        return max(0, int(np.searchsorted(self.t_s, t_s + 1e-6, side="right")) - 1)

    def between(self, from_s: float, to_s: float) -> "FlightTrack":
        """Return the samples of this interval, both ends included."""
        kept = (self.t_s >= from_s) & (self.t_s <= to_s)
        return FlightTrack(
            self.t_s[kept], self.position_ned[kept], self.velocity_ned[kept], self.attitude[kept], self.level
        )  # fmt: skip

    def at(self, t_s: float) -> DronePose:
        """Return the pose at a time: linear interpolation between two positions, slerp between two attitudes.

        Before the first sample it is the first pose, after the last sample the last pose.
        """
        t_s = min(max(t_s, float(self.t_s[0])), float(self.t_s[-1]))
        if len(self.t_s) == 1:
            x, y, z, w = _rotation(self.attitude)[0].as_quat()
            return DronePose(vec3(self.position_ned[0]), (float(w), float(x), float(y), float(z)))
        after = min(max(int(np.searchsorted(self.t_s, t_s)), 1), len(self.t_s) - 1)
        pair = slice(after - 1, after + 1)
        x, y, z, w = Slerp(self.t_s[pair], _rotation(self.attitude[pair]))(t_s).as_quat()
        share = (t_s - self.t_s[after - 1]) / (self.t_s[after] - self.t_s[after - 1])
        place = (1.0 - share) * self.position_ned[after - 1] + share * self.position_ned[after]
        return DronePose(vec3(place), (float(w), float(x), float(y), float(z)))

    def positions(self, times: Array) -> Array:
        """Return the positions (len(times), 3), m NED, interpolated linearly."""
        return np.column_stack([np.interp(times, self.t_s, self.position_ned[:, k]) for k in range(3)])

    def headings(self, times: Array) -> Array:
        """Return the yaw (len(times),), rad, unwrapped."""
        forward = _rotation(self.attitude).apply((1.0, 0.0, 0.0)).reshape(-1, 3)
        return np.asarray(np.interp(times, self.t_s, np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))))

    def moves(self) -> bool:
        """Return whether any position differs from the first by more than a centimetre on an axis."""
        return bool((abs(self.position_ned - self.position_ned[0]) > 0.01).any())

    def drawn(self) -> "FlightTrack":
        """Return the track for drawing. The truth bus's jitter is smoothed out; a level track gets more samples."""
        if self.level:
            return self._interpolated_level()
        if len(self.t_s) < 3 or float(np.diff(self.t_s).max()) > GAP_S:
            return self
        sigma = SMOOTHED_S / float(np.median(np.diff(self.t_s)))
        return replace(self, position_ned=gaussian_filter1d(self.position_ned, sigma, axis=0, mode="nearest"))

    def _interpolated_level(self) -> "FlightTrack":
        t, places, yaw = self.t_s, self.position_ned, self.headings(self.t_s)
        if len(t) > 1:
            fine = np.append(np.arange(t[0], t[-1], LEVEL_PERIOD_S), t[-1])
            places, yaw, t = PchipInterpolator(t, places)(fine), PchipInterpolator(t, yaw)(fine), fine
        return FlightTrack(t, places, np.full_like(places, np.nan), _level(yaw), level=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class DroneTracks:
    """The tracks and setpoints of one drone from the beginning of an episode to its end."""

    number: int  # 0 is the first
    estimate: FlightTrack | None  # from the autopilot's telemetry, in the map's frame
    held: FlightTrack | None  # `estimate`, preceded by the newest sample from before the episode
    truth: FlightTrack | None  # only the judge uses it; None: not measured
    setpoints: Array | None  # (n, 9): t s, position m (map's frame), velocity m/s, yaw rad, yaw rate rad/s; NaN: unset


def drone_tracks(
    number: int, truth: FlightTrack | None, telemetry: DroneTelemetry, end_s: float, origin: Vec3 | None
) -> DroneTracks:
    """Return the tracks of a drone. `origin`: lat °, lon °, alt m of the map's frame; None: unknown."""
    estimate, setpoints = estimated_track(telemetry), telemetry.setpoints[:, :9]
    moved = np.zeros(3)
    if origin is not None and telemetry.origin is not None:
        moved = np.array(geodetic_to_ned(*origin, *telemetry.origin))
    if estimate is not None:  # a level estimate is omitted: it has no attitudes and therefore no known heading
        estimate = None if estimate.level else replace(estimate, position_ned=estimate.position_ned + moved)
    if len(setpoints):
        times = (setpoints[:, 0] - telemetry.t0_us) / 1e6
        setpoints = np.column_stack([times, setpoints[:, 1:4] + moved, setpoints[:, 4:]])
        setpoints = setpoints[(times >= 0.0) & (times <= end_s)]
    return DroneTracks(
        number=number,
        estimate=_during(estimate, end_s),
        held=_during(estimate, end_s, held=True),
        truth=_during(truth, end_s),
        setpoints=setpoints if len(telemetry.setpoints) else None,
    )


def _during(track: FlightTrack | None, end_s: float, held: bool = False) -> FlightTrack | None:
    """Return the part of a track in the episode; with `held`, also the newest earlier sample; None: no samples."""
    if track is None:
        return None
    kept = track.between(min(0.0, float(track.t_s[track.newest(0.0)])) if held else 0.0, end_s)
    return kept if len(kept) else None


def true_track(samples: Iterable[TruthSample], t0_us: int) -> FlightTrack | None:
    """Return the track of one drone's samples of the truth bus; None: no samples. `t0_us`: vehicle µs at t = 0."""
    rows = rising(
        [((s.time_us - t0_us) / 1e6, *s.position_ned, *s.velocity_ned, *s.attitude) for s in samples]
    )  # fmt: skip
    return FlightTrack(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:11]) if len(rows) else None


def estimated_track(telemetry: DroneTelemetry) -> FlightTrack | None:
    """Return the estimated track in telemetry, in the autopilot's local frame; None: no positions.

    Attitudes are interpolated to the times of the positions. Without attitudes the track is level.
    """
    places, angles = telemetry.places, telemetry.angles
    if not len(places):
        return None
    turned = np.zeros((len(places), 3))
    if len(angles):
        columns = (angles[:, 1], angles[:, 2], np.unwrap(angles[:, 3]))
        turned = np.column_stack([np.interp(places[:, 0], angles[:, 0], column) for column in columns])
    attitude = np.array([quat_from_euler(*map(float, angles_rad)) for angles_rad in turned])
    t_s = (places[:, 0] - telemetry.t0_us) / 1e6
    return FlightTrack(t_s, places[:, 1:4], places[:, 4:7], attitude, level=not len(angles))


def track_of_rows(rows: Iterable[Pose | FrameTruth | EstimatedPose]) -> FlightTrack | None:
    """Return the track of one drone's rows of a log: level, without velocity; None: no row has a position.

    A row without a heading has the heading of the row before it.
    """
    placed = {row.t: row for row in rows if row.position_ned is not None}
    if not placed:
        return None
    times = sorted(placed)
    yaw_deg, headings = 0.0, []
    for t in times:
        yaw_deg = yaw_deg if (now := placed[t].yaw_deg) is None else now
        headings.append(yaw_deg)
    places = np.array([placed[t].position_ned for t in times], np.float64)
    return FlightTrack(np.array(times), places, np.full_like(places, np.nan), _level(np.radians(headings)), level=True)


def target_track(rows: Iterable[Pose | FrameTruth]) -> FlightTrack | None:
    """Return the track of the target's centre from rows of truth.jsonl; None: no row has it."""
    placed = {row.t: row.target_ned for row in rows if row.target_ned is not None}
    if not placed:
        return None
    times = sorted(placed)
    places = np.array([placed[t] for t in times], np.float64)
    still = np.tile((1.0, 0.0, 0.0, 0.0), (len(times), 1))
    return FlightTrack(np.array(times), places, np.full_like(places, np.nan), still, level=True)


def _level(yaw: Array) -> Array:
    return np.array([quat_from_euler(0.0, 0.0, float(heading)) for heading in yaw])


def _rotation(attitude: Array) -> Rotation:
    return Rotation.from_quat(attitude[:, [1, 2, 3, 0]])


def onboard_log_path(folder: Path, drone: int = 0) -> Path | None:
    """Return the path of the onboard log of a drone's autopilot; None: the log was not kept, or pyulog is missing."""
    path = folder / layout.onboard_log_name(drone)
    return path if path.is_file() and is_installed("pyulog") else None


def ulog_topics(path: Path, *names: str) -> dict[str, dict[str, Any]]:
    """Return the columns of the topics `names` that a ULog has. Raises UsageError when the file is not a ULog."""
    from pyulog import ULog

    try:
        return {d.name: d.data for d in reversed(ULog(str(path), list(names)).data_list)}  # reversed: instance 0 wins
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except Exception as error:  # a damaged file raises errors of many classes in pyulog
        raise UsageError(f"{path} is not a ULog: {type(error).__name__} {error}") from None


def onboard_estimated_track(path: Path, t0_us: int) -> FlightTrack | None:
    """Return the estimated track in a ULog, in the autopilot's local frame; None: it has none. Raises UsageError."""
    return _track(ulog_topics(path, "vehicle_local_position", "vehicle_attitude"), "", t0_us)


def onboard_true_track(path: Path, t0_us: int, map_origin: Origin) -> FlightTrack | None:
    """Return the true track in the ULog of a simulated PX4, in the map's frame; None: it has none.

    Raises UsageError when the file is not a ULog.
    """
    topics = ulog_topics(path, "vehicle_local_position_groundtruth", "vehicle_attitude_groundtruth")
    track, place = _track(topics, "_groundtruth", t0_us), topics.get("vehicle_local_position_groundtruth")
    if track is None or place is None:
        return None
    first = geodetic_to_ned(*map_origin, *(float(place[name][-1]) for name in ("ref_lat", "ref_lon", "ref_alt")))
    return FlightTrack(track.t_s, track.position_ned + np.array(first), track.velocity_ned, track.attitude)


def _track(topics: dict[str, dict[str, Any]], suffix: str, t0_us: int) -> FlightTrack | None:
    place, turned = topics.get(f"vehicle_local_position{suffix}"), topics.get(f"vehicle_attitude{suffix}")
    if place is None or turned is None or len(turned["timestamp"]) < 2:
        return None
    names = ("x", "y", "z", "vx", "vy", "vz")
    rows = np.column_stack([place["timestamp"].astype(float), *(place[name] for name in names)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    at_us = turned["timestamp"].astype(float)
    rows = rows[(rows[:, 0] >= at_us[0]) & (rows[:, 0] <= at_us[-1])]
    if not len(rows):
        return None
    turns = Rotation.from_quat(np.column_stack([turned[f"q[{k}]"] for k in (1, 2, 3, 0)]))
    attitude = Slerp(at_us, turns)(rows[:, 0]).as_quat()[:, [3, 0, 1, 2]]
    return FlightTrack((rows[:, 0] - t0_us) / 1e6, rows[:, 1:4], rows[:, 4:], attitude)
