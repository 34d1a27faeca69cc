"""Where a drone was, as arrays: by the truth that the judge goes by, and as its autopilot thought."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.report.afterflight.sources import tlog_messages
from dronecats.report.export.conventions import level
from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler
from foundation.mavlink import dialect
from foundation.run_folder.rows import FrameTruth, Pose
from foundation.truth import TRUTH_COMPONENT, truth_sample
from hil.link.telemetry import VehicleClock

Array = NDArray[np.float64]
AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
KINDS = {
    dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    dialect.MAVLINK_MSG_ID_ATTITUDE,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
}


@dataclass(frozen=True, slots=True)
class FlownTrack:
    """Where one drone was, n samples of rising time."""

    t_s: Array  # (n,) s of vehicle time since the episode began
    position_ned: Array  # (n, 3) m, map frame
    velocity_ned: Array  # (n, 3) m/s; NaN: not told
    attitude: Array  # (n, 4) w, x, y, z, FRD → NED

    def __len__(self) -> int:
        return len(self.t_s)

    def at(self, t_s: float) -> int:
        """Return the index of the newest sample at a time, the first before there is any; microseconds are forgiven."""
        return max(0, int(np.searchsorted(self.t_s, t_s + 1e-6, side="right")) - 1)

    def between(self, from_s: float, to_s: float) -> "FlownTrack":
        """Return the samples of this time, both ends included."""
        kept = (self.t_s >= from_s) & (self.t_s <= to_s)
        return FlownTrack(self.t_s[kept], self.position_ned[kept], self.velocity_ned[kept], self.attitude[kept])


@dataclass(frozen=True, slots=True)
class FlownTracks:
    """What a tlog tells of every drone, in the order of their numbers."""

    truth: tuple[FlownTrack | None, ...]
    estimate: tuple[FlownTrack | None, ...]
    setpoints: tuple[Array | None, ...]  # (n, 9): t s, place NED m in the map's frame, velocity m/s, yaw, yaw rate
    origin: Vec3 | None  # lat °, lon °, alt m of the map's frame, or of the first autopilot's where there is no map


class _Heard:
    """What one drone has sent."""

    def __init__(self) -> None:
        self.truth: list[tuple[float, ...]] = []
        self.places: list[tuple[float, ...]] = []
        self.angles: list[tuple[float, ...]] = []
        self.setpoints: list[tuple[float, ...]] = []
        self.origin: Vec3 | None = None
        self.place_clock, self.angle_clock, self.setpoint_clock = VehicleClock(), VehicleClock(), VehicleClock()


def from_tlog(path: Path, t0_us: int, origin: Vec3 | None, drones: int) -> FlownTracks:
    """Return what a flight's tlog tells. Raises UsageError when it cannot be read.

    `t0_us`: the vehicle's clock at t = 0; `origin`: of the map's frame, None where there is no map. The estimates are
    moved from each autopilot's own local frame into that of the map.
    """
    systems: dict[int, _Heard] = {}
    for m in tlog_messages(path, KINDS):
        truth = m.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
        if m.get_srcComponent() == (TRUTH_COMPONENT if truth else AUTOPILOT):
            _hear(systems.setdefault(m.get_srcSystem(), _Heard()), m, t0_us, origin)
    heard = [systems[number] for number in sorted(systems)][:drones]
    frame = origin or next((one.origin for one in heard if one.origin), None)
    return FlownTracks(
        truth=tuple(_truth(one) for one in heard),
        estimate=tuple(_estimate(one, frame) for one in heard),
        setpoints=tuple(_setpoints(one, frame) for one in heard),
        origin=frame,
    )


def _hear(heard: _Heard, m: dialect.MAVLink_message, t0_us: int, origin: Vec3 | None) -> None:
    match m.get_msgId():
        case dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION if origin is not None:
            sample = truth_sample(m, origin)
            t_s = (sample.time_us - t0_us) / 1e6
            heard.truth.append((t_s, *sample.position_ned, *sample.velocity_ned, *sample.attitude))
        case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            heard.places.append((_t(heard.place_clock, m, t0_us), m.x, m.y, m.z, m.vx, m.vy, m.vz))
        case dialect.MAVLINK_MSG_ID_ATTITUDE:
            heard.angles.append((_t(heard.angle_clock, m, t0_us), m.roll, m.pitch, m.yaw))
        case dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED:
            t_s = _t(heard.setpoint_clock, m, t0_us)
            heard.setpoints.append((t_s, m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw, m.yaw_rate))
        case dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            heard.origin = (m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3)


def _t(clock: VehicleClock, m: dialect.MAVLink_message, t0_us: int) -> float:
    clock.see(m.time_boot_ms)
    return (clock.time_us - t0_us) / 1e6


def _truth(heard: _Heard) -> FlownTrack | None:
    rows = _rising(heard.truth)
    return FlownTrack(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:11]) if len(rows) else None


def _estimate(heard: _Heard, frame: Vec3 | None) -> FlownTrack | None:
    """Return the autopilot's own track, its attitude taken at the times of its places."""
    places, angles = _rising(heard.places), _rising(heard.angles)
    if not len(places) or not len(angles):
        return None
    t_s = places[:, 0]
    roll, pitch = (np.interp(t_s, angles[:, 0], angles[:, k]) for k in (1, 2))
    yaw = np.interp(t_s, angles[:, 0], np.unwrap(angles[:, 3]))
    attitude = np.array([quat_from_euler(*map(float, each)) for each in zip(roll, pitch, yaw, strict=True)])
    return FlownTrack(t_s, places[:, 1:4] + _moved(heard, frame), places[:, 4:7], attitude)


def _setpoints(heard: _Heard, frame: Vec3 | None) -> Array | None:
    rows = _rising(heard.setpoints)
    if not len(rows):
        return None
    rows[:, 1:4] += _moved(heard, frame)
    return rows


def _moved(heard: _Heard, frame: Vec3 | None) -> Array:
    """Return where the autopilot's local frame begins (m, NED of the map); zero where nobody tells."""
    return np.array(geodetic_to_ned(*frame, *heard.origin) if frame and heard.origin else (0.0, 0.0, 0.0))


def _rising(rows: Sequence[tuple[float, ...]]) -> Array:
    """Return rows of rising time, what comes late or twice left out."""
    if not rows:
        return np.empty((0, 0))
    table = np.array(rows, np.float64)
    newest = np.maximum.accumulate(np.concatenate([[-np.inf], table[:-1, 0]]))
    return table[table[:, 0] > newest]


def from_rows(rows: Iterable[Pose | FrameTruth]) -> FlownTrack | None:
    """Return the track that lines of truth.jsonl of one drone tell: level, and without velocity. None: they tell none.

    A line without a heading has the last one before it.
    """
    told = {row.t: row for row in rows if row.position_ned is not None}
    if not told:
        return None
    yaw_deg, attitudes = 0.0, []
    for t in sorted(told):
        yaw_deg = yaw_deg if (now := told[t].yaw_deg) is None else now
        attitudes.append(level(yaw_deg))
    places = np.array([told[t].position_ned for t in sorted(told)], np.float64)
    return FlownTrack(np.array(sorted(told)), places, np.full_like(places, np.nan), np.array(attitudes))
