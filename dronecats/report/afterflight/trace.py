"""estimate.jsonl: the pose trace of a flight whose truth nobody knows, smoothed after landing (docs/run-folder.md).

Derived from the logs as they are, which stay as they were: decisions.jsonl tells the instant of every frame,
truth.jsonl when the episode began and ended, and flight.tlog, or the autopilot's own ULog, what its estimator said.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.judge.distances import sentence
from dronecats.judge.episode import write_verdict
from dronecats.report.afterflight.smoothing import Estimates, SmoothedPath, smooth
from dronecats.report.afterflight.surveyed_target import SurveyedTarget, target_of
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.onboard_log import kept_ulog, ulog_topics
from dronecats.report.recorded.telemetry import DroneTelemetry
from foundation.errors import UsageError
from foundation.frames import Vec3, geodetic_to_ned, ned_to_geodetic
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, estimate, read
from foundation.run_folder.rows import EstimatedFrame, EstimatedPose, EstimateHead
from foundation.run_folder.writing import as_json, write_lines

Array = NDArray[np.float64]
VELOCITY_STD = 0.1  # m/s: MAVLink reports no accuracy of the estimated velocity; PX4's ULogs show about this outdoors
MARGIN_US = 5e6  # µs of the flight before and after the episode that help to smooth its ends


@dataclass(frozen=True, slots=True)
class EstimatorLog:
    """A flight as the first drone's estimator had it, in its local frame."""

    estimates: Estimates
    heading_us: Array  # (m,) µs, vehicle clock, rising
    heading: Array  # (m,) rad, unwrapped
    origin: Vec3 | None  # lat °, lon °, alt m above mean sea level of the local frame; None: it never told
    source: str  # name of the file

    def yaw_deg(self, at_us: float) -> float | None:
        """Return the heading at an instant, −180 to 180°, None when none was told."""
        if not len(self.heading):
            return None
        return (math.degrees(float(np.interp(at_us, self.heading_us, self.heading))) + 180.0) % 360.0 - 180.0


def derive(folder: Path, target: SurveyedTarget | None = None, ulog: Path | None = None) -> Path:
    """Write estimate.jsonl of an episode folder and return it; without `target`, the one in episode.json, if any.

    Without `ulog` it is derived from the log of the autopilot that the folder holds, else from flight.tlog.

    Raises UsageError when the logs do not tell enough, or when a target is given and the frame's origin was never told.
    """
    flight = RecordedFlight.read(folder)
    begin = flight.logs.begin
    if begin is None:
        raise UsageError(f"{folder} holds no episode that began")
    record = from_ulog(ulog) if ulog else _estimator_log(flight)
    target = target or _surveyed_target(flight)
    target_ned = None
    if target is not None:
        if record.origin is None:
            raise UsageError(
                f"{record.source} never tells where on Earth its local frame is: GPS_GLOBAL_ORIGIN is missing"
            )
        target_ned = target.ned(record.origin)
    frames = {(d.drone, d.frame_id): d.t_frame for d in flight.logs.decisions}
    poses_s = np.arange(0.0, flight.end_s + 1e-6, POSE_PERIOD_S)
    t0_us = float(begin.t0_us)
    heard = record.estimates.between(t0_us - MARGIN_US, t0_us + poses_s[-1] * 1e6 + MARGIN_US)
    if len(heard.time_us) < 2:
        raise UsageError(f"{record.source} tells no positions of the time of the episode; is it of this flight?")
    path = smooth(heard, t0_us + np.array([*poses_s, *frames.values()], float) * 1e6)
    writer = _Rows(record, path, t0_us, target, target_ned)
    head = EstimateHead(
        source=record.source,
        origin=record.origin,
        target=target.as_json() if target else None,
        target_ned=_rounded(target_ned),
    )
    poses = [writer.pose(float(t)) for t in poses_s]
    seen = [writer.frame(frame_id, drone, t) for (drone, frame_id), t in frames.items()]
    file = folder / layout.ESTIMATE
    try:
        write_lines(file, [head, *filter(None, poses), *filter(None, seen)])
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from None
    return file


def _estimator_log(flight: RecordedFlight) -> EstimatorLog:
    kept = kept_ulog(flight.folder)
    if kept is not None:
        with suppress(UsageError):  # the log ends before its first estimate
            return from_ulog(kept)
    path = flight.folder / layout.TLOG
    if not path.is_file():
        raise UsageError(f"{path} cannot be read: No such file or directory")
    return from_telemetry(flight.telemetry.get(0, DroneTelemetry(0)), path)


def from_telemetry(telemetry: DroneTelemetry, path: Path) -> EstimatorLog:
    """Return what an autopilot sent; `path` is where that was logged. Raises UsageError when it sent no positions."""
    places, angles = telemetry.places, telemetry.angles
    if len(places) < 2:
        raise UsageError(f"{path} tells no positions: it holds no LOCAL_POSITION_NED of an autopilot")
    velocity_std = np.full((len(places), 3), VELOCITY_STD)
    estimates = Estimates(places[:, 0], places[:, 1:4], places[:, 4:7], places[:, 7:10], velocity_std)
    return EstimatorLog(estimates, angles[:, 0], np.unwrap(angles[:, 3]), telemetry.origin, path.name)


def from_ulog(path: Path) -> EstimatorLog:
    """Return what PX4's estimator wrote down on board. Raises UsageError when the file is no such log."""
    log = ulog_topics(path, "vehicle_local_position", "vehicle_gps_position", "sensor_gps")
    try:
        local = log["vehicle_local_position"]
        columns = [[local[name] for name in names] for names in (("x", "y", "z"), ("vx", "vy", "vz"))]
        estimated = np.column_stack([local["eph"], local["eph"], local["epv"]]).astype(float)
        velocity_std = np.column_stack([local["evh"], local["evh"], local["evv"]]).astype(float)
        time_us = local["timestamp"].astype(float)
        heading, has_origin = local["heading"].astype(float), local["xy_global"].astype(bool)
        origin = tuple(float(local[name][-1]) for name in ("ref_lat", "ref_lon", "ref_alt"))
    except (KeyError, IndexError) as missing:
        raise UsageError(f"{path} is no ULog with vehicle_local_position: {missing} is missing") from None
    receiver = log.get("vehicle_gps_position") or log.get("sensor_gps")
    if receiver is not None:
        seen_us = receiver["timestamp"].astype(float)
        told = [np.interp(time_us, seen_us, receiver[name].astype(float)) for name in ("eph", "eph", "epv")]
        estimated = np.fmax(estimated, np.column_stack(told))
    position, velocity = (np.column_stack(column).astype(float) for column in columns)
    usable = np.isfinite(position).all(1) & np.isfinite(velocity).all(1) & (np.diff(time_us, prepend=-1.0) > 0)
    if usable.sum() < 2:
        raise UsageError(f"{path} tells no positions")
    estimates = Estimates(
        time_us[usable], position[usable], velocity[usable], estimated[usable], np.fmax(velocity_std[usable], 0.02)
    )
    known = origin if has_origin.any() and len(origin) == 3 else None
    return EstimatorLog(estimates, time_us[usable], np.unwrap(heading[usable]), known, path.name)


def rejudge(result: dict[str, Any], target: SurveyedTarget | None, say: Callable[[str], None]) -> dict[str, Any]:
    """Return what `fly --json` prints, judged anew with estimate.jsonl; as it was where the logs allow no trace."""
    folder = Path(result["run_dir"])
    try:
        derive(folder, target)
    except UsageError as reason:
        say(f"no smoothed trace: {reason}")
        return result
    verdict = write_verdict(folder)
    measured = verdict.distances or None
    if measured:
        say(sentence(measured, verdict.delta_m))
    return {**result, "outcome": verdict.outcome, "success": verdict.success, "distances": as_json(measured)}


def against_truth(folder: Path, map_origin: Vec3) -> dict[str, float]:
    """Return how far estimate.jsonl is from the truth that was logged, whose frame begins at `map_origin` (°, °, m).

    `rms_m` and `max_m` are distances, `within_2_std` the share of coordinates that err by two standard deviations at
    most. Raises UsageError when the two have no time in common.
    """
    logs, told = read(folder), estimate(folder)
    if told is None:
        raise UsageError(f"{folder} has no {layout.ESTIMATE}")
    true = _TruePath(logs)
    known = [(p, p.position_std_m) for p in told.poses if p.position_std_m and true.tells(p.t)]
    origin = told.head.origin
    if not known or not origin:
        raise UsageError(f"{folder} tells no instant, or no origin, for which the estimate could be held to the truth")
    estimated = [geodetic_to_ned(*map_origin, *ned_to_geodetic(*origin, *p.position_ned)) for p, _ in known]
    apart = np.subtract(estimated, [true.at(p.t) for p, _ in known])
    std = np.array([std_m for _, std_m in known])
    distance = np.linalg.norm(apart, axis=1)
    return {
        "poses": len(known),
        "rms_m": round(float(np.sqrt((distance**2).mean())), 4),
        "max_m": round(float(distance.max()), 4),
        "within_2_std": round(float((np.abs(apart) <= 2.0 * std).mean()), 4),
    }


class _TruePath:
    """The first drone's logged way. Its poses lie up to 20 ms after the half seconds of the estimate's."""

    def __init__(self, logs: Logs) -> None:
        poses = sorted((p.t, *p.position_ned) for p in logs.poses if p.drone == 0)
        self._path = np.array(poses, float).reshape(-1, 4)

    def tells(self, t: float) -> bool:
        """Return whether there are poses on both sides of a time (s), or one at it, with no gap between them."""
        times = self._path[:, 0]
        after = int(np.searchsorted(times, t))
        if after == len(times) or (after == 0 and times[0] > t):
            return False
        return bool(times[after] == t or times[after] - times[after - 1] <= 1.5 * POSE_PERIOD_S)

    def at(self, t: float) -> list[float]:
        """Return the position at a time (s): (3,) m, NED in the map's frame."""
        return [float(np.interp(t, self._path[:, 0], self._path[:, axis])) for axis in (1, 2, 3)]


class _Rows:
    """Makes the rows of poses and frames."""

    def __init__(
        self,
        record: EstimatorLog,
        path: SmoothedPath,
        t0_us: float,
        target: SurveyedTarget | None,
        target_ned: Vec3 | None,
    ) -> None:
        self._record, self._path, self._t0_us = record, path, t0_us
        self._target, self._target_ned = target, target_ned

    def pose(self, t: float) -> EstimatedPose | None:
        """Return the row of an instant (s), None when the estimator had nothing to say then."""
        told = self._told(t)
        return EstimatedPose(t=round(t, 6), drone=0, **told) if told else None

    def frame(self, frame_id: int, drone: int, t: float) -> EstimatedFrame | None:
        """Return the row of a frame that was taken at an instant (s), None as above."""
        told = self._told(t)
        return EstimatedFrame(frame_id=frame_id, t=round(t, 6), drone=drone, **told) if told else None

    def _told(self, t: float) -> dict[str, Any] | None:
        """Return the fields that poses and frames have in common."""
        at_us = self._t0_us + t * 1e6
        index = int(np.searchsorted(self._path.time_us, at_us))
        if index >= len(self._path.time_us) or self._path.time_us[index] != at_us:
            return None
        position, std = _vector(self._path.position_ned[index]), _vector(self._path.std_m[index])
        distance: tuple[float | None, float | None] = (None, None)
        if self._target is not None and self._target_ned is not None:
            distance = self._target.distance(self._target_ned, position, std)
        return {
            "position_ned": _rounded(position),
            "position_std_m": _rounded(std),
            "yaw_deg": _known(self._record.yaw_deg(at_us)),
            "target_ned": _rounded(self._target_ned),
            "distance_m": _known(distance[0]),
            "distance_std_m": _known(distance[1]),
            "visible": None,  # nobody measured it
        }


def _surveyed_target(flight: RecordedFlight) -> SurveyedTarget | None:
    declared = flight.record.get("surveyed_target")
    return None if declared is None else target_of(declared)


def _vector(row: NDArray[np.float64]) -> Vec3:
    return (float(row[0]), float(row[1]), float(row[2]))


def _known(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else round(value, 4)


def _rounded(place: Vec3 | None) -> Vec3 | None:
    if place is None or any(math.isnan(v) for v in place):
        return None
    return (round(place[0], 4), round(place[1], 4), round(place[2], 4))
