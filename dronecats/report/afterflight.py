"""Derives estimate.jsonl after landing: the smoothed poses of a flight without logged true poses (docs/run-folder.md).

The inputs are the logs, which stay unchanged: decisions.jsonl (time of every frame), truth.jsonl (only begin and end of
the episode), and flight.tlog or the autopilot's ULog (estimates). The target's position may come from a GNSS survey.

A Rauch-Tung-Striebel (RTS) smoother runs on each axis. The autopilot has already filtered the reported positions. Their
error is nearly the same in successive reports and drifts with the satellites. A reported position is therefore modelled
as the true position plus a slowly drifting error. This error is a Gauss-Markov process with the reported accuracy and
the time constant CORRELATION_S; smoothing cannot remove it. Smoothing removes short errors: noise, and jumps of the
position that contradict the velocity. State per axis: position, velocity (constant except for white noise in the
acceleration), error of the reported position.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dronecats.judge.diagnostics import distances_sentence
from dronecats.judge.episode import write_verdict
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.telemetry import DroneTelemetry
from dronecats.report.recorded.tracks import onboard_log_path, track_of_rows, ulog_topics
from foundation.conversion import convert
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.frames import Vec3, geodetic_to_ned, ned_to_geodetic, vec3
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import layout
from foundation.run_folder.reading import estimate, read
from foundation.run_folder.rows import EstimatedFrame, EstimatedPose, EstimateHead
from foundation.run_folder.writing import as_json, write_lines

HANDHELD_STD_M = 3.0  # m, accuracy of a telephone or a handheld receiver under open sky; RTK reaches 0.02


@dataclass(frozen=True, slots=True)
class SurveyedTarget:
    """The surveyed centre of the target."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None  # m above mean sea level; None: not surveyed, so distances are horizontal
    std_m: float = HANDHELD_STD_M  # m, per axis

    def __post_init__(self) -> None:
        """Raise UsageError when the position or the accuracy is out of range."""
        latitude, longitude, altitude, std_m = self.latitude_deg, self.longitude_deg, self.altitude_m, self.std_m
        is_out = altitude is not None and not -500.0 <= altitude <= 9000.0
        if is_out or not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            raise UsageError(
                f"a target at latitude {latitude:g}, longitude {longitude:g}, altitude"
                f" {altitude} is not a place on Earth"
            )
        if not 0.0 <= std_m <= 100.0:
            raise UsageError(f"--target-std must be 0 to 100 m, got {std_m:g}")

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    def ned(self, origin: Vec3) -> Vec3:
        """Return the NED position (m) from `origin` (lat °, lon °, alt m). The default altitude is that of `origin`."""
        altitude = origin[2] if self.altitude_m is None else self.altitude_m
        return geodetic_to_ned(*origin, self.latitude_deg, self.longitude_deg, altitude)

    def distance(self, target_ned: Vec3, position_ned: Vec3, std_ned: Vec3) -> tuple[float, float]:
        """Return (distance, its standard deviation) in m. The standard deviation is NaN if `std_ned` is NaN."""
        axes = range(2 if self.altitude_m is None else 3)
        apart = [position_ned[i] - target_ned[i] for i in axes]
        variances = [std_ned[i] ** 2 + self.std_m**2 for i in axes]
        distance = math.hypot(*apart)
        if distance * distance <= max(variances):  # within the uncertainty, the direction is undefined
            return distance, math.sqrt(max(variances))
        return distance, math.sqrt(sum(v * (a / distance) ** 2 for v, a in zip(variances, apart, strict=True)))


def target_from(text: str, std_m: float | None = None) -> SurveyedTarget:
    """Parse a target from the text `LAT,LON` or `LAT,LON,ALT` (°, °, m). Raises UsageError for other text."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(math.isfinite(n) for n in numbers):
        raise UsageError(f"a target must be LAT,LON or LAT,LON,ALT, for example 47.397742,8.545594,488.2, got '{text}'")
    latitude, longitude, *altitude = numbers
    std_m = HANDHELD_STD_M if std_m is None else std_m
    return SurveyedTarget(latitude, longitude, altitude[0] if altitude else None, std_m)


def target_of(value: Any) -> SurveyedTarget:
    """Return the target from the JSON of `as_json`. Raises UsageError for other values."""
    try:
        return convert(value, SurveyedTarget)
    except msgspec.ValidationError:
        wanted = "latitude_deg, longitude_deg, altitude_m (or null) and std_m, in numbers"
        raise UsageError(f"a surveyed target needs {wanted}") from None


Array = NDArray[np.float64]
CORRELATION_S = 300.0  # s, length of a flight; receiver errors correlate for less time, so `std_m` tends to be large
POSITION_NOISE_M = 0.05  # m, white noise of one report, from the small corrections of the estimator
ACCELERATION_PSD = 1.0  # (m/s²)²/Hz, noise of the acceleration of a multirotor at the speeds of these flights
UNREPORTED_M = 1.0  # m, assumed for an axis without reported accuracy; SmoothedPath.std_m is then NaN
THINNED_US = 90_000  # µs, least time between two used reports; more reports add no information
_H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # a report is (position + error, velocity)


@dataclass(frozen=True, slots=True)
class Estimates:
    """The estimates that an autopilot reported during a flight, in its local frame."""

    time_us: Array  # (n,) µs, vehicle clock, strictly rising
    position_ned: Array  # (n, 3) m
    velocity_ned: Array  # (n, 3) m/s
    position_std_m: Array  # (n, 3); NaN: not reported
    velocity_std_mps: Array  # (n, 3)

    def between(self, from_us: float, to_us: float) -> "Estimates":
        """Return the estimates from `from_us` (included) to `to_us` (excluded)."""
        part = slice(*np.searchsorted(self.time_us, (from_us, to_us)))
        return Estimates(*(getattr(self, field.name)[part] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class SmoothedPath:
    """The smoothed positions of the vehicle at the requested times."""

    time_us: Array  # (k,) µs
    position_ned: Array  # (k, 3) m
    std_m: Array  # (k, 3) standard deviations; NaN: no reported accuracy for this axis


def smooth(estimates: Estimates, at_us: Array) -> SmoothedPath:
    """Return the smoothed path at the times `at_us` (µs) that are in the time range of the estimates."""
    kept = _thinned(estimates.time_us)
    time_us = estimates.time_us[kept]
    instants = np.unique(at_us)
    instants = instants[(instants >= time_us[0]) & (instants <= time_us[-1])]
    steps = np.union1d(time_us, instants)
    rows = np.searchsorted(steps, time_us)
    wanted = np.searchsorted(steps, instants)
    position, std = np.empty((len(instants), 3)), np.empty((len(instants), 3))
    for axis in range(3):
        mean, variance = _smooth_axis(
            steps,
            rows,
            estimates.position_ned[kept, axis],
            estimates.velocity_ned[kept, axis],
            _filled(estimates.position_std_m[:, axis])[kept],
            estimates.velocity_std_mps[kept, axis],
        )
        position[:, axis], std[:, axis] = mean[wanted], np.sqrt(variance[wanted])
        if not np.isfinite(estimates.position_std_m[:, axis]).any():
            std[:, axis] = math.nan
    return SmoothedPath(instants, position, std)


def _thinned(time_us: Array) -> NDArray[np.int64]:
    kept, last = [], -math.inf
    for index, t in enumerate(time_us):
        if t >= last + THINNED_US:
            kept.append(index)
            last = t
    return np.array(kept, np.int64)


def _filled(std: Array) -> Array:
    """Fill a gap with the accuracy before it, else with the first one. If all are missing, use UNREPORTED_M."""
    reported = np.flatnonzero(np.isfinite(std))
    if not len(reported):
        return np.full_like(std, UNREPORTED_M)
    return np.asarray(std[reported[np.maximum(0, np.searchsorted(reported, np.arange(len(std)), "right") - 1)]])


def _smooth_axis(
    steps: Array, rows: NDArray[np.int64], position: Array, velocity: Array, error: Array, velocity_std: Array
) -> tuple[Array, Array]:
    """Return mean and variance of the position at every step. `rows`: indices of the steps that have a report."""
    from filterpy.kalman import KalmanFilter  # imports scipy.stats, which takes seconds

    reports = {int(row): index for index, row in enumerate(rows)}
    newest = np.maximum(0, np.searchsorted(rows, np.arange(len(steps)), "right") - 1)
    transitions, noises, measured, weights = [], [], [], []
    for step in range(len(steps)):
        dt = (steps[step] - steps[step - 1]) / 1e6 if step else 0.0
        kept = math.exp(-dt / CORRELATION_S)
        transitions.append(np.array([[1.0, dt, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, kept]]))
        noises.append(_process_noise(dt, error[newest[step]] ** 2 * (1.0 - kept**2)))
        report = reports.get(step)
        measured.append(None if report is None else np.array([position[report], velocity[report]]))
        weights.append(np.diag([POSITION_NOISE_M**2, velocity_std[newest[step]] ** 2]))
    kalman = KalmanFilter(dim_x=3, dim_z=2)
    kalman.x = np.array([position[0], velocity[0], 0.0])
    unsure = error[0] ** 2
    kalman.P = np.array(
        [[unsure + POSITION_NOISE_M**2, 0.0, -unsure], [0.0, velocity_std[0] ** 2, 0.0], [-unsure, 0.0, unsure]]
    )
    means, covariances, _, _ = kalman.batch_filter(
        measured, Fs=transitions, Qs=noises, Hs=[_H] * len(steps), Rs=weights
    )
    means, covariances, _, _ = kalman.rts_smoother(means, covariances, Fs=transitions, Qs=noises)
    return means[:, 0], covariances[:, 0, 0]


def _process_noise(dt: float, wandered: float) -> Array:
    q = ACCELERATION_PSD
    noise = np.array([[q * dt**3 / 3.0, q * dt**2 / 2.0, 0.0], [q * dt**2 / 2.0, q * dt, 0.0], [0.0, 0.0, wandered]])
    return noise + np.eye(3) * 1e-12  # the smoother inverts the predicted covariance, also for dt = 0


VELOCITY_STD = 0.1  # m/s, assumed accuracy in telemetry, because MAVLink reports none; typical of PX4's outdoor ULogs
MARGIN_US = 5e6  # µs before and after the episode; the smoother also uses the estimates in this time


@dataclass(frozen=True, slots=True)
class EstimatorLog:
    """The estimates of the first drone during a flight, in its autopilot's local frame."""

    estimates: Estimates
    heading_us: Array  # (m,) µs, vehicle clock, rising
    heading: Array  # (m,) rad, unwrapped
    origin: Vec3 | None  # of the local frame: lat °, lon °, alt m above mean sea level; None: unknown
    source: str  # file name

    def yaw_deg(self, at_us: float) -> float | None:
        """Return the heading (−180 to 180°) at a vehicle time (µs); None: unknown."""
        if not len(self.heading):
            return None
        return (math.degrees(float(np.interp(at_us, self.heading_us, self.heading))) + 180.0) % 360.0 - 180.0


def derive(folder: Path, target: SurveyedTarget | None = None, ulog: Path | None = None) -> Path:
    """Write estimate.jsonl of an episode folder, and return its path.

    `target`: default is the surveyed target in episode.json, if any. `ulog`: default is the autopilot's onboard log in
    the folder, else flight.tlog.

    Raises UsageError if the logs are not sufficient, or if there is a target but no origin of the local frame.
    """
    flight = RecordedFlight.read(folder)
    begin = flight.logs.begin
    if begin is None:
        raise UsageError(f"{folder} has no episode that began")
    record = from_ulog(ulog) if ulog else _estimator_log(flight)
    declared = flight.record.get("surveyed_target")
    target = target or (None if declared is None else target_of(declared))
    target_ned = None
    if target is not None:
        if record.origin is None:
            raise UsageError(
                f"{record.source} does not say where on Earth its local frame is: GPS_GLOBAL_ORIGIN is missing"
            )
        target_ned = target.ned(record.origin)
    frames = {(d.drone, d.frame_id): d.t_frame for d in flight.logs.decisions}
    poses_s = np.arange(0.0, flight.end_s + 1e-6, POSE_PERIOD_S)
    t0_us = float(begin.t0_us)
    estimates = record.estimates.between(t0_us - MARGIN_US, t0_us + poses_s[-1] * 1e6 + MARGIN_US)
    if len(estimates.time_us) < 2:
        raise UsageError(f"{record.source} has no positions during the episode. Is it a log of this flight?")
    path = smooth(estimates, t0_us + np.array([*poses_s, *frames.values()], float) * 1e6)
    head = EstimateHead(
        source=record.source,
        origin=record.origin,
        target=target.as_json() if target else None,
        target_ned=_rounded_place(target_ned),
    )

    def common_fields(t: float) -> dict[str, Any] | None:
        """Return the fields that poses and frames share, at a time (s); None: no estimate."""
        at_us = t0_us + t * 1e6
        index = int(np.searchsorted(path.time_us, at_us))
        if index >= len(path.time_us) or path.time_us[index] != at_us:
            return None
        position, std = vec3(path.position_ned[index]), vec3(path.std_m[index])
        distance: tuple[float | None, float | None] = (None, None)
        if target is not None and target_ned is not None:
            distance = target.distance(target_ned, position, std)
        return {
            "t": round(t, 6),
            "position_ned": _rounded_place(position),
            "position_std_m": _rounded_place(std),
            "yaw_deg": _rounded_number(record.yaw_deg(at_us)),
            "target_ned": _rounded_place(target_ned),
            "distance_m": _rounded_number(distance[0]),
            "distance_std_m": _rounded_number(distance[1]),
            "visible": None,  # not measured
        }

    poses = [EstimatedPose(drone=0, **common) for t in poses_s if (common := common_fields(float(t)))]
    seen = [
        EstimatedFrame(frame_id=frame_id, drone=drone, **common)
        for (drone, frame_id), t in frames.items()
        if (common := common_fields(t))
    ]
    file = folder / layout.ESTIMATE
    with file_errors_as(UsageError, f"{file} cannot be written"):
        write_lines(file, [head, *poses, *seen])
    return file


def _estimator_log(flight: RecordedFlight) -> EstimatorLog:
    kept = onboard_log_path(flight.folder)
    if kept is not None:
        with suppress(UsageError):  # use flight.tlog if the ULog has no estimates
            return from_ulog(kept)
    path = flight.folder / layout.TLOG
    if not path.is_file():
        raise UsageError(f"{path} does not exist")
    return from_telemetry(flight.telemetry.get(0, DroneTelemetry(0)), path)


def from_telemetry(telemetry: DroneTelemetry, path: Path) -> EstimatorLog:
    """Return the estimates in the telemetry from `path`. Raises UsageError when the telemetry has no positions."""
    places, angles = telemetry.places, telemetry.angles
    if len(places) < 2:
        raise UsageError(f"{path} has no positions: there is no LOCAL_POSITION_NED of an autopilot in it")
    velocity_std = np.full((len(places), 3), VELOCITY_STD)
    estimates = Estimates(places[:, 0], places[:, 1:4], places[:, 4:7], places[:, 7:10], velocity_std)
    return EstimatorLog(estimates, angles[:, 0], np.unwrap(angles[:, 3]), telemetry.origin, path.name)


def from_ulog(path: Path) -> EstimatorLog:
    """Return the estimates in PX4's onboard log. Raises UsageError for other files or without positions."""
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
        raise UsageError(f"{path} is not a ULog with vehicle_local_position: {missing} is missing") from None
    receiver = log.get("vehicle_gps_position") or log.get("sensor_gps")
    if receiver is not None:
        seen_us = receiver["timestamp"].astype(float)
        reported = [np.interp(time_us, seen_us, receiver[name].astype(float)) for name in ("eph", "eph", "epv")]
        estimated = np.fmax(estimated, np.column_stack(reported))
    position, velocity = (np.column_stack(column).astype(float) for column in columns)
    usable = np.isfinite(position).all(1) & np.isfinite(velocity).all(1) & (np.diff(time_us, prepend=-1.0) > 0)
    if usable.sum() < 2:
        raise UsageError(f"{path} has no positions")
    estimates = Estimates(
        time_us[usable], position[usable], velocity[usable], estimated[usable], np.fmax(velocity_std[usable], 0.02)
    )
    local_origin = origin if has_origin.any() and len(origin) == 3 else None
    return EstimatorLog(estimates, time_us[usable], np.unwrap(heading[usable]), local_origin, path.name)


def rejudge(result: dict[str, Any], target: SurveyedTarget | None, report: Callable[[str], None]) -> dict[str, Any]:
    """Derive estimate.jsonl, judge the episode again, and return the updated result of `fly --json`.

    Without an estimate, return `result` unchanged. `report` receives messages for the user.
    """
    folder = Path(result["run_dir"])
    try:
        derive(folder, target)
    except UsageError as reason:
        report(f"no smoothed trace: {reason}")
        return result
    verdict = write_verdict(folder)
    measured = verdict.distances or None
    if measured:
        report(distances_sentence(measured, verdict.delta_m))
    return {**result, "outcome": verdict.outcome, "success": verdict.success, "distances": as_json(measured)}


def against_truth(folder: Path, map_origin: Vec3) -> dict[str, float]:
    """Return the errors of estimate.jsonl against the logged truth, whose origin is `map_origin` (lat °, lon °, alt m).

    `rms_m` and `max_m` are distances. `within_2_std` is the share of coordinates with an error of at most two standard
    deviations. Raises UsageError if estimate.jsonl, its origin or common times are missing.
    """
    logs, estimated_log = read(folder), estimate(folder)
    if estimated_log is None:
        raise UsageError(f"{folder} has no {layout.ESTIMATE}")
    true = track_of_rows(pose for pose in logs.poses if pose.drone == 0)
    common = [
        (p, p.position_std_m) for p in estimated_log.poses if p.position_std_m and true and _covers(true.t_s, p.t)
    ]
    origin = estimated_log.head.origin
    if not true or not common or not origin:
        raise UsageError(
            f"{folder} has no truth at the times of the estimate, or no origin, so the two cannot be compared"
        )
    estimated = [geodetic_to_ned(*map_origin, *ned_to_geodetic(*origin, *p.position_ned)) for p, _ in common]
    apart = np.subtract(estimated, true.positions(np.array([p.t for p, _ in common])))
    std = np.array([std_m for _, std_m in common])
    distance = np.linalg.norm(apart, axis=1)
    return {
        "poses": len(common),
        "rms_m": round(float(np.sqrt((distance**2).mean())), 4),
        "max_m": round(float(distance.max()), 4),
        "within_2_std": round(float((np.abs(apart) <= 2.0 * std).mean()), 4),
    }


def _covers(times: Array, t: float) -> bool:
    """Return whether a time (s) is at a true pose, or between two that are at most 1.5 periods apart.

    The period is 0.5 s. A true pose is logged up to 20 ms after the estimated pose, so their times differ.
    """
    after = int(np.searchsorted(times, t))
    if after == len(times) or (after == 0 and times[0] > t):
        return False
    return bool(times[after] == t or times[after] - times[after - 1] <= 1.5 * POSE_PERIOD_S)


def _rounded_number(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else round(value, 4)


def _rounded_place(place: Vec3 | None) -> Vec3 | None:
    if place is None or any(math.isnan(v) for v in place):
        return None
    return (round(place[0], 4), round(place[1], 4), round(place[2], 4))
