"""Where a drone was at any time, as arrays: of the truth bus, of truth.jsonl, or as its autopilot estimated.

The truth bus has fifty poses a second with attitude; so has the log on board of a simulated PX4. truth.jsonl has two
places a second and a heading, and a drone is drawn level between them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from dronecats.report.recorded.telemetry import DroneTelemetry, rising
from episodes.world.fleet import DronePose
from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler
from foundation.run_folder.rows import EstimatedPose, FrameTruth, Pose
from foundation.truth import TruthSample

SMOOTHED_S = 0.06  # places travel in steps of 1.1 cm, which would be seen as a tremor
GAP_S = 0.2  # between two samples that are smoothed over
LEVEL_PERIOD_S = 0.1  # at which a track without attitudes is laid out

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightTrack:
    """The way of one drone, n samples of rising time, at least one."""

    t_s: Array  # (n,) s of vehicle time since the episode began
    position_ned: Array  # (n, 3) m
    velocity_ned: Array  # (n, 3) m/s; NaN: not known
    attitude: Array  # (n, 4) w, x, y, z, FRD → NED
    level: bool = False  # the attitude is not known but for its heading

    def __len__(self) -> int:
        return len(self.t_s)

    def newest(self, t_s: float) -> int:
        """Return the index of the newest sample at a time, the first before there is any; microseconds are forgiven."""
        return max(0, int(np.searchsorted(self.t_s, t_s + 1e-6, side="right")) - 1)

    def between(self, from_s: float, to_s: float) -> "FlightTrack":
        """Return the samples of this time, both ends included."""
        kept = (self.t_s >= from_s) & (self.t_s <= to_s)
        return FlightTrack(
            self.t_s[kept], self.position_ned[kept], self.velocity_ned[kept], self.attitude[kept], self.level
        )  # fmt: skip

    def at(self, t_s: float) -> DronePose:
        """Return the pose at a time: places in a straight line between two samples, attitudes on the shortest arc.

        Before the first sample and after the last it stays there.
        """
        t_s = min(max(t_s, float(self.t_s[0])), float(self.t_s[-1]))
        if len(self.t_s) == 1:
            x, y, z, w = _rotation(self.attitude)[0].as_quat()
            return DronePose(_vec3(self.position_ned[0]), (float(w), float(x), float(y), float(z)))
        after = min(max(int(np.searchsorted(self.t_s, t_s)), 1), len(self.t_s) - 1)
        pair = slice(after - 1, after + 1)
        x, y, z, w = Slerp(self.t_s[pair], _rotation(self.attitude[pair]))(t_s).as_quat()
        share = (t_s - self.t_s[after - 1]) / (self.t_s[after] - self.t_s[after - 1])
        place = (1.0 - share) * self.position_ned[after - 1] + share * self.position_ned[after]
        return DronePose(_vec3(place), (float(w), float(x), float(y), float(z)))

    def positions(self, times: Array) -> Array:
        """Return the places (len(times), 3), m NED."""
        return np.column_stack([np.interp(times, self.t_s, self.position_ned[:, k]) for k in range(3)])

    def headings(self, times: Array) -> Array:
        """Return the yaw (len(times),), rad, without jumps: it counts on beyond π."""
        forward = _rotation(self.attitude).apply((1.0, 0.0, 0.0)).reshape(-1, 3)
        return np.asarray(np.interp(times, self.t_s, np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))))

    def moves(self) -> bool:
        """Return whether it ever leaves its first place by more than a centimetre."""
        return bool((abs(self.position_ned - self.position_ned[0]) > 0.01).any())

    def drawn(self) -> "FlightTrack":
        """Return the track as it is drawn: without the tremor of the bus, of a level one smooth between its places."""
        if self.level:
            return self._laid_out()
        if len(self.t_s) < 3 or float(np.diff(self.t_s).max()) > GAP_S:
            return self
        sigma = SMOOTHED_S / float(np.median(np.diff(self.t_s)))
        return replace(self, position_ned=gaussian_filter1d(self.position_ned, sigma, axis=0, mode="nearest"))

    def _laid_out(self) -> "FlightTrack":
        t, places, yaw = self.t_s, self.position_ned, self.headings(self.t_s)
        if len(t) > 1:
            fine = np.append(np.arange(t[0], t[-1], LEVEL_PERIOD_S), t[-1])
            places, yaw, t = PchipInterpolator(t, places)(fine), PchipInterpolator(t, yaw)(fine), fine
        return FlightTrack(t, places, np.full_like(places, np.nan), _level(yaw), level=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class DroneTracks:
    """One drone from the beginning of an episode to its end: where it was, and where it was told to go."""

    number: int  # 0 is the first
    estimate: FlightTrack | None  # by its autopilot's telemetry, in the map's frame; None: there is none
    held: FlightTrack | None  # the estimate, with the sample before the episode that still held when it began
    truth: FlightTrack | None  # the judge's; None: nobody measured it
    setpoints: Array | None  # (n, 9): t s, place m in the map's frame, velocity m/s, yaw, yaw rate; NaN: open


def drone_tracks(
    number: int, truth: FlightTrack | None, telemetry: DroneTelemetry, end_s: float, origin: Vec3 | None
) -> DroneTracks:
    """Return the tracks of a drone. `origin`: lat °, lon °, alt m of the map's frame; None: nobody tells."""
    estimate, setpoints = estimated_track(telemetry), telemetry.setpoints[:, :9]
    moved = np.zeros(3)
    if origin is not None and telemetry.origin is not None:
        moved = np.array(geodetic_to_ned(*origin, *telemetry.origin))
    if estimate is not None:  # one without attitudes has no heading either, along which anything could be measured
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
    """Return what of a track is of the episode, with the sample that `held` when it began; None where nothing is."""
    if track is None:
        return None
    kept = track.between(min(0.0, float(track.t_s[track.newest(0.0)])) if held else 0.0, end_s)
    return kept if len(kept) else None


def true_track(samples: Iterable[TruthSample], t0_us: int) -> FlightTrack | None:
    """Return the track of one drone's samples of the truth bus; None without any. `t0_us`: the clock at t = 0."""
    rows = rising([
        ((each.time_us - t0_us) / 1e6, *each.position_ned, *each.velocity_ned, *each.attitude) for each in samples
    ])  # fmt: skip
    return FlightTrack(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:11]) if len(rows) else None


def estimated_track(telemetry: DroneTelemetry) -> FlightTrack | None:
    """Return the track that an autopilot sent, in its local frame, level where it sent no attitude; None: it sent none.

    Attitudes are those of the times of its places.
    """
    places, angles = telemetry.places, telemetry.angles
    if not len(places):
        return None
    turned = np.zeros((len(places), 3))
    if len(angles):
        columns = (angles[:, 1], angles[:, 2], np.unwrap(angles[:, 3]))
        turned = np.column_stack([np.interp(places[:, 0], angles[:, 0], column) for column in columns])
    attitude = np.array([quat_from_euler(*map(float, each)) for each in turned])
    t_s = (places[:, 0] - telemetry.t0_us) / 1e6
    return FlightTrack(t_s, places[:, 1:4], places[:, 4:7], attitude, level=not len(angles))


def track_of_rows(rows: Iterable[Pose | FrameTruth | EstimatedPose]) -> FlightTrack | None:
    """Return the track of one drone's rows of a log: level, and without velocity; None where none tells a place.

    A row without a heading has the last one before it.
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
    """Return where the target's centre was, by the rows of truth.jsonl; None where none tells it."""
    placed = {row.t: row.target_ned for row in rows if row.target_ned is not None}
    if not placed:
        return None
    times = sorted(placed)
    places = np.array([placed[t] for t in times], np.float64)
    still = np.tile((1.0, 0.0, 0.0, 0.0), (len(times), 1))
    return FlightTrack(np.array(times), places, np.full_like(places, np.nan), still, level=True)


def _level(yaw: Array) -> Array:
    return np.array([quat_from_euler(0.0, 0.0, float(each)) for each in yaw])


def _rotation(attitude: Array) -> Rotation:
    return Rotation.from_quat(attitude[:, [1, 2, 3, 0]])


def _vec3(place: Array) -> Vec3:
    return float(place[0]), float(place[1]), float(place[2])
