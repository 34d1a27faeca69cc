"""estimate.jsonl: the pose trace of a flight whose truth nobody knows, smoothed after landing (docs/run-folder.md).

Derived from the logs as they are, which stay as they were: decisions.jsonl tells the instant of every frame,
truth.jsonl when the episode began and ended, and flight.tlog, or the autopilot's own ULog, what its estimator said.
"""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.report.afterflight.smoothing import SmoothedPath, smooth
from dronecats.report.afterflight.sources import FlightRecord, from_tlog, from_ulog, kept_ulog
from dronecats.report.afterflight.surveyed_target import SurveyedTarget, target_of
from foundation.errors import UsageError
from foundation.frames import Vec3, geodetic_to_ned, ned_to_geodetic
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, estimate, json_object, read
from foundation.run_folder.rows import EstimatedFrame, EstimatedPose, EstimateHead
from foundation.run_folder.writing import write_lines

MARGIN_US = 5e6  # µs of the flight before and after the episode that help to smooth its ends


def derive(folder: Path, target: SurveyedTarget | None = None, ulog: Path | None = None) -> Path:
    """Write estimate.jsonl of an episode folder and return it; without `target`, the one in episode.json, if any.

    Without `ulog` it is derived from the log of the autopilot that the folder holds, else from flight.tlog.

    Raises UsageError when the logs do not tell enough, or when a target is given and the frame's origin was never told.
    """
    logs = read(folder)
    begin = logs.begin
    if begin is None:
        raise UsageError(f"{folder} holds no episode that began")
    record = from_ulog(ulog) if ulog else _heard(folder)
    target = target or _target_of_episode(folder)
    target_ned = None
    if target is not None:
        if record.origin is None:
            raise UsageError(
                f"{record.source} never tells where on Earth its local frame is: GPS_GLOBAL_ORIGIN is missing"
            )
        target_ned = target.ned(record.origin)
    frames = {(d.drone, d.frame_id): d.t_frame for d in logs.decisions}
    poses_s = np.arange(0.0, _end_s(logs) + 1e-6, POSE_PERIOD_S)
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


def _heard(folder: Path) -> FlightRecord:
    kept = kept_ulog(folder)
    if kept is not None:
        with suppress(UsageError):  # the log ends before its first estimate
            return from_ulog(kept)
    return from_tlog(folder / layout.TLOG)


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
        record: FlightRecord,
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


def _target_of_episode(folder: Path) -> SurveyedTarget | None:
    declared = (json_object(folder / layout.EPISODE) or {}).get("surveyed_target")
    return None if declared is None else target_of(declared)


def _end_s(logs: Logs) -> float:
    return logs.end.t if logs.end else max((p.t for p in logs.poses), default=0.0)


def _vector(row: NDArray[np.float64]) -> Vec3:
    return (float(row[0]), float(row[1]), float(row[2]))


def _known(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else round(value, 4)


def _rounded(place: Vec3 | None) -> Vec3 | None:
    if place is None or any(math.isnan(v) for v in place):
        return None
    return (round(place[0], 4), round(place[1], 4), round(place[2], 4))
