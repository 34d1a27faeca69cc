"""What the estimator said, read back out of a flight's tlog or out of the autopilot's own ULog."""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.report.afterflight.smoothing import Estimates
from foundation.errors import UsageError
from foundation.extras import is_installed
from foundation.frames import Vec3
from foundation.mavlink import Parser, dialect
from foundation.run_folder import layout
from hil.link.telemetry import VehicleClock

Array = NDArray[np.float64]
VELOCITY_STD = 0.1  # m/s: MAVLink reports no accuracy of the estimated velocity; PX4's ULogs show about this outdoors
READ = {
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    dialect.MAVLINK_MSG_ID_ATTITUDE,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
}
MAVLINK1, MAVLINK2 = 0xFE, 0xFD


@dataclass(frozen=True, slots=True)
class FlightRecord:
    """A flight as its autopilot knew it."""

    estimates: Estimates
    heading_us: Array  # (m,) µs, vehicle clock, rising
    heading: Array  # (m,) rad, unwrapped
    origin: Vec3 | None  # lat °, lon °, alt m above mean sea level of the local frame; None: it never said
    source: str  # name of the file

    def yaw_deg(self, at_us: float) -> float | None:
        """Return the heading at an instant, −180 to 180°, None when none was told."""
        if not len(self.heading):
            return None
        return (math.degrees(float(np.interp(at_us, self.heading_us, self.heading))) + 180.0) % 360.0 - 180.0


class Accuracy:
    """The newest accuracies that were reported: how good a position is in the world, not only within its own frame.

    The receiver's is a bound for the estimator's: an error that all of its fixes share, no filter sees.
    """

    def __init__(self) -> None:
        self._estimator = self._receiver = (math.nan, math.nan)

    def estimator(self, horizontal_m: float, vertical_m: float) -> None:
        self._estimator = (_positive(horizontal_m), _positive(vertical_m))

    def receiver(self, horizontal_m: float, vertical_m: float) -> None:
        self._receiver = (_positive(horizontal_m), _positive(vertical_m))

    @property
    def std_ned(self) -> Vec3:
        """m per axis, the whole horizontal accuracy on each of the two; NaN where neither has told."""
        horizontal, vertical = (float(np.fmax(a, b)) for a, b in zip(self._estimator, self._receiver, strict=True))
        return (horizontal, horizontal, vertical)


def _positive(value: float) -> float:
    return value if value > 0.0 and math.isfinite(value) else math.nan


def from_tlog(path: Path) -> FlightRecord:
    """Return what the first autopilot in a tlog said. Raises UsageError when the file tells no positions."""
    clock, turning, accuracy = VehicleClock(), VehicleClock(), Accuracy()
    times: list[float] = []
    rows: list[tuple[float, ...]] = []
    heading: list[tuple[float, float]] = []
    origin: Vec3 | None = None
    system: int | None = None
    for m in tlog_messages(path, READ, dialect.MAV_COMP_ID_AUTOPILOT1):
        system = m.get_srcSystem() if system is None else system
        if m.get_srcSystem() != system:
            continue
        match m.get_msgId():
            case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                clock.see(m.time_boot_ms)
                if not times or clock.time_us > times[-1]:
                    times.append(clock.time_us)
                    rows.append((m.x, m.y, m.z, m.vx, m.vy, m.vz, *accuracy.std_ned))
            case dialect.MAVLINK_MSG_ID_ATTITUDE:
                turning.see(m.time_boot_ms)
                if not heading or turning.time_us > heading[-1][0]:
                    heading.append((turning.time_us, m.yaw))
            case dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
                origin = (m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3)
            case dialect.MAVLINK_MSG_ID_GPS_RAW_INT:
                accuracy.receiver(m.h_acc / 1e3, m.v_acc / 1e3)
            case dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
                accuracy.estimator(m.pos_horiz_accuracy, m.pos_vert_accuracy)
    if len(times) < 2:
        raise UsageError(f"{path} tells no positions: it holds no LOCAL_POSITION_NED of an autopilot")
    table = np.array(rows)
    velocity_std = np.full((len(times), 3), VELOCITY_STD)
    estimates = Estimates(np.array(times), table[:, :3], table[:, 3:6], table[:, 6:], velocity_std)
    turned = np.array(heading, float).reshape(-1, 2)
    return FlightRecord(estimates, turned[:, 0], np.unwrap(turned[:, 1]), origin, path.name)


def tlog_messages(
    path: Path, kinds: Collection[int], component: int | None = None
) -> Iterator[dialect.MAVLink_message]:
    """Yield the messages of these kinds, of one component or of all, in the order of the file. Raises UsageError.

    A tlog is frames with eight bytes of time before each.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    parser, at = Parser(), 8
    while at + 12 <= len(data):
        if data[at] == MAVLINK2:
            end = at + 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
            kind, sender = int.from_bytes(data[at + 7 : at + 10], "little"), data[at + 6]
        elif data[at] == MAVLINK1:
            end, kind, sender = at + 8 + data[at + 1], data[at + 5], data[at + 4]
        else:
            at += 1  # torn by a kill and gone on with: look for the next frame
            continue
        if kind in kinds and component in (sender, None):
            yield from parser.feed(data[at:end])
        at = end + 8


def kept_ulog(folder: Path, drone: int = 0) -> Path | None:
    """Return the log that a drone's autopilot wrote on board; None where it was not kept, or pyulog is missing."""
    path = folder / layout.onboard_log_name(drone)
    return path if path.is_file() and is_installed("pyulog") else None


def ulog_topics(path: Path, *names: str) -> dict[str, dict[str, Any]]:
    """Return the columns of these topics of a ULog, those that it has. Raises UsageError when the file is none."""
    from pyulog import ULog

    try:
        return {d.name: d.data for d in reversed(ULog(str(path), list(names)).data_list)}  # instance 0 of each stays
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except Exception as error:  # a damaged file raises errors of many classes in pyulog
        raise UsageError(f"{path} is no ULog: {type(error).__name__} {error}") from None


def from_ulog(path: Path) -> FlightRecord:
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
    return FlightRecord(estimates, time_us[usable], np.unwrap(heading[usable]), known, path.name)
