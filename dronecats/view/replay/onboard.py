"""What a flight's tlog tells beside the true poses: modes, battery, words, setpoints, and an autopilot's places."""

from bisect import bisect_right
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from dronecats.report.afterflight.sources import kept_ulog, tlog_messages, ulog_topics
from dronecats.view.film.track import DroneTrack
from dronecats.view.live.heard import asked_velocity
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.mavlink import dialect
from foundation.px4 import mode_name
from foundation.truth import TRUTH_COMPONENT
from hil.link.telemetry import WARNING, StatusTexts, VehicleClock, VehicleState, update

AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
POSE, TEXT = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, dialect.MAVLINK_MSG_ID_STATUSTEXT
PLACE, ANGLES = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE
SETPOINT = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
STATES = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT,
    dialect.MAVLINK_MSG_ID_CURRENT_MODE,
    dialect.MAVLINK_MSG_ID_SYS_STATUS,
}
KINDS = {POSE, TEXT, PLACE, ANGLES, SETPOINT, *STATES}

Array = NDArray[np.float64]
V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class Timeline(Generic[V]):
    """Values of rising time, of which the newest counts."""

    t_s: tuple[float, ...] = ()  # s since the episode began
    values: tuple[V, ...] = ()

    def at(self, t_s: float) -> V | None:
        """Return the newest value at a time, None before the first."""
        index = bisect_right(self.t_s, t_s + 1e-6)
        return self.values[index - 1] if index else None

    def until(self, t_s: float) -> tuple[V, ...]:
        """Return all values that were there by then, the newest last."""
        return self.values[: bisect_right(self.t_s, t_s + 1e-6)]


@dataclass(frozen=True, slots=True)
class OnboardState:
    """What an autopilot told of itself."""

    mode: str  # as PX4 names it; "": not told
    armed: bool
    battery: float | None  # 0 … 1


@dataclass(frozen=True, slots=True)
class VehicleLog:
    """What one drone's wires carried."""

    drone: int  # 0 is the first
    states: Timeline[OnboardState] = Timeline()  # one at each change
    warnings: Timeline[str] = Timeline()  # of severity warning or worse, collisions among them
    setpoints: Timeline[Vec3] = Timeline()  # m/s, NED, the velocity that it was told
    true_velocity: Timeline[Vec3] = Timeline()  # m/s, NED
    own_velocity: Timeline[Vec3] = Timeline()  # m/s, NED, as its autopilot thought
    own_track: DroneTrack | None = None  # as its autopilot thought, in its local frame; None: never told


@dataclass
class _Wires:
    """What one system has said so far. Each kind of stamped message has a clock: they overtake one another."""

    clocks: dict[int, VehicleClock] = field(default_factory=dict)
    newest_us: int = 0
    state: VehicleState = field(default_factory=VehicleState)
    states: list[tuple[float, OnboardState]] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)
    said: dict[int, StatusTexts] = field(default_factory=dict)  # by component
    setpoints: list[tuple[float, Vec3]] = field(default_factory=list)
    true: list[tuple[float, Vec3]] = field(default_factory=list)
    places: list[tuple[float, ...]] = field(default_factory=list)
    angles: list[tuple[float, ...]] = field(default_factory=list)

    def stamped(self, message: dialect.MAVLink_message) -> int:
        clock = self.clocks.setdefault(message.get_msgId(), VehicleClock())
        clock.see(message.time_boot_ms)
        self.newest_us = max(self.newest_us, clock.time_us)
        return clock.time_us


def vehicle_logs(path: Path, t0_us: int) -> dict[int, VehicleLog]:
    """Return what a tlog tells of each drone; {} where there is none. Raises UsageError when it cannot be read.

    `t0_us`: the vehicle's clock at t = 0. Drones count from 0 in the order of their systems' numbers.
    A file that a kill has torn is read as far as it goes.
    """
    if not path.is_file():
        return {}
    systems: dict[int, _Wires] = {}
    for message in tlog_messages(path, KINDS):
        if message.get_srcComponent() in (AUTOPILOT, TRUTH_COMPONENT):
            _hear(systems.setdefault(message.get_srcSystem(), _Wires()), message, t0_us)
    flying = [number for number in sorted(systems) if systems[number].true or systems[number].places]
    return {drone: _told(drone, systems[number], t0_us) for drone, number in enumerate(flying)}


def with_onboard_logs(vehicles: dict[int, VehicleLog], folder: Path, t0_us: int) -> dict[int, VehicleLog]:
    """Return them with the estimates of the logs that PX4 wrote on board, where they were kept."""
    found = dict(vehicles)
    for drone in range(max(vehicles, default=0) + 1):
        kept = kept_ulog(folder, drone)
        with suppress(UsageError):  # a torn log: what the wires told stands
            if kept is not None:
                found[drone] = _with_log(vehicles.get(drone, VehicleLog(drone)), kept, t0_us)
    return found


def _with_log(told: VehicleLog, path: Path, t0_us: int) -> VehicleLog:
    log = ulog_topics(path, "vehicle_local_position", "vehicle_attitude")
    place, turned = log.get("vehicle_local_position"), log.get("vehicle_attitude")
    if place is None or turned is None or len(turned["timestamp"]) < 2:
        return told
    names = ("x", "y", "z", "vx", "vy", "vz")
    rows = np.column_stack([place["timestamp"].astype(float), *(place[name] for name in names)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    at_us = turned["timestamp"].astype(float)
    rows = rows[(rows[:, 0] >= at_us[0]) & (rows[:, 0] <= at_us[-1])]
    if not len(rows):
        return told
    attitude = Rotation.from_quat(np.column_stack([turned[f"q[{k}]"] for k in (1, 2, 3, 0)]))
    t_s = (rows[:, 0] - t0_us) / 1e6
    return replace(
        told,
        own_velocity=Timeline(tuple(map(float, t_s)), tuple((float(n), float(e), float(d)) for n, e, d in rows[:, 4:])),
        own_track=DroneTrack(t_s, rows[:, 1:4], Slerp(at_us, attitude)(rows[:, 0]), level=False),
    )


def _hear(wires: _Wires, m: dialect.MAVLink_message, t0_us: int) -> None:
    kind, own = m.get_msgId(), m.get_srcComponent() == AUTOPILOT
    if kind == TEXT:
        _text(wires, m, t0_us)
    elif kind == POSE and not own:
        wires.newest_us = max(wires.newest_us, int(m.time_usec))
        wires.true.append(((m.time_usec - t0_us) / 1e6, (m.vx / 100.0, m.vy / 100.0, m.vz / 100.0)))
    elif kind == PLACE and own:
        wires.places.append(((wires.stamped(m) - t0_us) / 1e6, m.x, m.y, m.z, m.vx, m.vy, m.vz))
    elif kind == ANGLES and own:
        wires.angles.append(((wires.stamped(m) - t0_us) / 1e6, m.roll, m.pitch, m.yaw))
    elif kind == SETPOINT and own:
        wires.setpoints.append(((wires.stamped(m) - t0_us) / 1e6, asked_velocity(m)))
    elif kind in STATES and own:
        wires.state = update(wires.state, m, mode_name)
        told_now = OnboardState(wires.state.mode, wires.state.armed, wires.state.battery_remaining)
        if wires.state.mode and (not wires.states or wires.states[-1][1] != told_now):
            wires.states.append(((wires.newest_us - t0_us) / 1e6, told_now))


def _text(wires: _Wires, m: dialect.MAVLink_message, t0_us: int) -> None:
    texts = wires.said.setdefault(m.get_srcComponent(), StatusTexts())
    texts.take(m, wires.newest_us)
    texts.since(wires.newest_us)  # a last piece that is full waits for no other
    while texts.newest:
        said = texts.newest.popleft()
        if said.severity <= WARNING:
            wires.texts.append(((said.time_us - t0_us) / 1e6, said.text))


def _told(drone: int, wires: _Wires, t0_us: int) -> VehicleLog:
    return VehicleLog(
        drone=drone,
        states=_heard(wires.states),
        warnings=_heard(wires.texts),
        setpoints=_heard(wires.setpoints),
        true_velocity=_heard(wires.true),
        own_velocity=_heard([(row[0], (row[4], row[5], row[6])) for row in wires.places]),
        own_track=_own_track(wires),
    )


def _heard(rows: Sequence[tuple[float, V]]) -> Timeline[V]:
    told = sorted(rows, key=lambda row: row[0])
    return Timeline(tuple(t for t, _ in told), tuple(value for _, value in told))


def _own_track(wires: _Wires) -> DroneTrack | None:
    places, angles = _rising(wires.places), _rising(wires.angles)
    if not len(places):
        return None
    t_s = places[:, 0]
    told = len(angles) > 0
    turned = np.zeros((len(t_s), 3))
    if told:
        columns = (angles[:, 1], angles[:, 2], np.unwrap(angles[:, 3]))
        turned = np.column_stack([np.interp(t_s, angles[:, 0], column) for column in columns])
    attitude = Rotation.from_euler("ZYX", turned[:, ::-1])
    return DroneTrack(t_s, places[:, 1:4], attitude, level=not told)


def _rising(rows: Sequence[tuple[float, ...]]) -> Array:
    """Return finite rows of rising time, what comes late or twice left out."""
    if not rows:
        return np.zeros((0, 0))
    table = np.array(rows, np.float64)
    table = table[np.isfinite(table).all(axis=1)]
    newest = np.maximum.accumulate(np.concatenate([[-np.inf], table[:-1, 0]]))
    return table[table[:, 0] > newest]
