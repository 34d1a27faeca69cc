"""Reads each drone's true poses, estimates, setpoints, modes, battery and warnings from flight.tlog."""

import itertools
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from foundation import wire
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.frames import Vec3
from foundation.mavlink import Parser, dialect
from foundation.truth import TRUTH_COMPONENT, Origin, TruthSample, truth_sample
from hil.link.telemetry import WARNING, StatusTexts, VehicleClock, VehicleState, setpoint_velocity, update

Array = NDArray[np.float64]
V = TypeVar("V")

AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
POSE, TEXT = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, dialect.MAVLINK_MSG_ID_STATUSTEXT
LOCAL_POSITION, ATTITUDE = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE
SETPOINT, ORIGIN = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
GPS_RAW, ESTIMATOR = dialect.MAVLINK_MSG_ID_GPS_RAW_INT, dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS
STATES = {dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_CURRENT_MODE, dialect.MAVLINK_MSG_ID_SYS_STATUS}
KINDS = {POSE, TEXT, LOCAL_POSITION, ATTITUDE, SETPOINT, ORIGIN, GPS_RAW, ESTIMATOR, *STATES}


@dataclass(frozen=True, slots=True)
class Timeline(Generic[V]):
    """Values with rising times; each is valid until the next."""

    t_s: tuple[float, ...] = ()  # s since the episode began
    values: tuple[V, ...] = ()

    def at(self, t_s: float) -> V | None:
        """Return the newest value at a time; None before the first."""
        index = bisect_right(self.t_s, t_s + 1e-6)
        return self.values[index - 1] if index else None


@dataclass(frozen=True, slots=True)
class AutopilotState:
    """The state that an autopilot reports."""

    mode: str  # as PX4 names it; "": not known
    armed: bool
    battery: float | None  # 0 … 1


class DroneTelemetry:
    """The messages of one drone, decoded on first use. Times of arrays are µs of the vehicle's clock."""

    def __init__(self, drone: int, frames: Sequence[bytes] = (), t0_us: int = 0) -> None:
        """`frames`: MAVLink frames of truth bus and autopilot, in order; `t0_us`: the vehicle's clock at t = 0, µs."""
        self.drone, self.t0_us, self._frames = drone, t0_us, frames

    @cached_property
    def _poses(self) -> list[dialect.MAVLink_message]:
        parser = Parser()
        truth = (frame for frame in self._frames if _header(frame)[1:] == (TRUTH_COMPONENT, POSE))
        return [message for frame in truth for message in parser.feed(frame)]

    def truth(self, map_origin: Origin) -> list[TruthSample]:
        """Return the true poses, in the frame of the map."""
        return [truth_sample(message, map_origin) for message in self._poses]

    @cached_property
    def true_velocity(self) -> Timeline[Vec3]:
        """The true velocity, m/s, NED."""
        return _timeline([(self._t_s(m.time_usec), (m.vx / 100.0, m.vy / 100.0, m.vz / 100.0)) for m in self._poses])

    @cached_property
    def _autopilot(self) -> "_Autopilot":
        autopilot, parser = _Autopilot(), Parser()
        for frame in self._frames:
            for message in parser.feed(frame):
                autopilot.take(message)
        return autopilot

    @cached_property
    def places(self) -> Array:
        """(n, 10): time µs; position m, velocity m/s, in the autopilot's frame; std of position m (NaN: unknown)."""
        return rising(self._autopilot.places, 7)

    @cached_property
    def angles(self) -> Array:
        """(n, 4): µs, roll, pitch, yaw in rad."""
        return rising(self._autopilot.angles, 4)

    @cached_property
    def setpoints(self) -> Array:
        """(n, 12): µs; position m, velocity m/s, yaw rad, yaw rate rad/s (NaN: unset); velocity again (0: unset)."""
        return rising(self._autopilot.setpoints)

    @cached_property
    def setpoint_velocity(self) -> Timeline[Vec3]:
        """The velocity of the setpoint, m/s, NED."""
        rows = [(self._t_s(row[0]), (float(row[9]), float(row[10]), float(row[11]))) for row in self.setpoints]
        return _timeline(rows)

    @property
    def origin(self) -> Vec3 | None:
        """The origin of the autopilot's local frame: lat °, lon °, alt m above mean sea level; None: not received."""
        return self._autopilot.origin

    @cached_property
    def states(self) -> Timeline[AutopilotState]:
        """The autopilot's state at each change."""
        return _timeline([(self._t_s(us), state) for us, state in self._autopilot.states])

    @cached_property
    def warnings(self) -> Timeline[str]:
        """Texts of severity warning or worse, including collisions."""
        return _timeline([(self._t_s(us), text) for us, text in self._autopilot.warnings])

    def _t_s(self, time_us: float) -> float:
        return float(time_us - self.t0_us) / 1e6


def telemetry(path: Path, t0_us: int) -> dict[int, DroneTelemetry]:
    """Return the telemetry in a tlog by drone; {}: there is no file. Raises UsageError when it cannot be read.

    A drone with true poses in the file has the number system id − 1. The other systems that send positions get the free
    numbers from 0, in the order of their ids. A truncated file is read to its last complete message.
    """
    if not path.is_file():
        return {}
    frames: list[tuple[int, bytes]] = []  # (system, frame)
    kinds: dict[int, set[tuple[int, int]]] = {}  # by system, (component, message)
    for frame in _frames(path):
        system, component, kind = _header(frame)
        if kind in KINDS and component in (AUTOPILOT, TRUTH_COMPONENT) and wire.scan(frame)[0] == [frame]:
            frames.append((system, frame))
            kinds.setdefault(system, set()).add((component, kind))
    with_truth = [system for system in kinds if (TRUTH_COMPONENT, POSE) in kinds[system]]
    untracked = [
        system for system in sorted(kinds) if system not in with_truth and (AUTOPILOT, LOCAL_POSITION) in kinds[system]
    ]
    number = {system: system - 1 for system in with_truth}
    number |= zip(untracked, (drone for drone in itertools.count() if drone + 1 not in with_truth), strict=False)
    drones: dict[int, list[bytes]] = {}
    for system, frame in frames:
        if system in number:
            drones.setdefault(number[system], []).append(frame)
    return {drone: DroneTelemetry(drone, drones[drone], t0_us) for drone in sorted(drones)}


def _frames(path: Path) -> Iterator[bytes]:
    with file_errors_as(UsageError, f"{path} cannot be read"):
        data = path.read_bytes()
    yield from (frame for _, frame in wire.logged_frames(data)[0])


def _header(frame: bytes) -> tuple[int, int, int]:
    """Return the system, the component and the message id of a frame."""
    if frame[0] == wire.MARKER_V1:
        return frame[3], frame[4], frame[5]
    return frame[5], frame[6], frame[7] | frame[8] << 8 | frame[9] << 16


@dataclass
class _Autopilot:
    """Collects the messages of one autopilot. A separate clock object follows the time stamps of each message type."""

    places: list[tuple[float, ...]] = field(default_factory=list)
    angles: list[tuple[float, ...]] = field(default_factory=list)
    setpoints: list[tuple[float, ...]] = field(default_factory=list)
    states: list[tuple[int, AutopilotState]] = field(default_factory=list)
    warnings: list[tuple[int, str]] = field(default_factory=list)
    origin: Vec3 | None = None
    _newest_us: int = 0
    _state: VehicleState = field(default_factory=VehicleState)
    _clocks: dict[int, VehicleClock] = field(default_factory=dict)
    _texts: dict[int, StatusTexts] = field(default_factory=dict)  # by component
    # m, newest horizontal and vertical accuracy of the global position; NaN: not reported
    _estimator: tuple[float, float] = (math.nan, math.nan)
    _receiver: tuple[float, float] = (math.nan, math.nan)

    def take(self, m: dialect.MAVLink_message) -> None:
        """Store the values of the next message."""
        kind, own = m.get_msgId(), m.get_srcComponent() == AUTOPILOT
        if kind == TEXT:
            self._text(m)
        elif kind == POSE and not own:
            self._newest_us = max(self._newest_us, int(m.time_usec))
        elif not own:
            return
        elif kind == LOCAL_POSITION:
            self.places.append((self._stamped(m), m.x, m.y, m.z, m.vx, m.vy, m.vz, *self._std_ned()))
        elif kind == ATTITUDE:
            self.angles.append((self._stamped(m), m.roll, m.pitch, m.yaw))
        elif kind == SETPOINT:
            sent = (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw, m.yaw_rate)
            self.setpoints.append((self._stamped(m), *sent, *setpoint_velocity(m)))
        elif kind == ORIGIN:
            self.origin = (m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3)
        elif kind == GPS_RAW:
            self._receiver = (_positive(m.h_acc / 1e3), _positive(m.v_acc / 1e3))
        elif kind == ESTIMATOR:
            self._estimator = (_positive(m.pos_horiz_accuracy), _positive(m.pos_vert_accuracy))
        else:
            self._take_state(m)

    def _std_ned(self) -> Vec3:
        """Return the larger of the estimator's and the receiver's accuracy (m), for north, east and down.

        The receiver's accuracy is a lower limit, because the estimator cannot detect an error of all fixes.
        """
        horizontal, vertical = (float(np.fmax(a, b)) for a, b in zip(self._estimator, self._receiver, strict=True))
        return (horizontal, horizontal, vertical)

    def _take_state(self, m: dialect.MAVLink_message) -> None:
        self._state = update(self._state, m)
        now = AutopilotState(self._state.mode, self._state.armed, self._state.battery_remaining)
        if now.mode and (not self.states or self.states[-1][1] != now):
            self.states.append((self._newest_us, now))

    def _text(self, m: dialect.MAVLink_message) -> None:
        texts = self._texts.setdefault(m.get_srcComponent(), StatusTexts())
        texts.take(m, self._newest_us)
        texts.since(self._newest_us)  # completes a text of several messages, also if its last message is full
        while texts.newest:
            text = texts.newest.popleft()
            if text.severity <= WARNING:
                self.warnings.append((text.time_us, text.text))

    def _stamped(self, m: dialect.MAVLink_message) -> int:
        clock = self._clocks.setdefault(m.get_msgId(), VehicleClock())
        clock.see(m.time_boot_ms)
        self._newest_us = max(self._newest_us, clock.time_us)
        return clock.time_us


def _positive(value: float) -> float:
    return value if value > 0.0 and math.isfinite(value) else math.nan


def _timeline(rows: Sequence[tuple[float, V]]) -> Timeline[V]:
    ordered = sorted(rows, key=lambda row: row[0])
    return Timeline(tuple(t for t, _ in ordered), tuple(value for _, value in ordered))


def rising(rows: Sequence[tuple[float, ...]], finite: int = 1) -> Array:
    """Return the rows that are later than all rows before them (column 0); (0, 12) without rows.

    Rows with a value that is not finite in the first `finite` columns are left out.
    """
    if not rows:
        return np.empty((0, 12))
    table = np.array(rows, np.float64)
    table = table[np.isfinite(table[:, :finite]).all(axis=1)]
    newest = np.maximum.accumulate(np.concatenate([[-np.inf], table[:-1, 0]]))
    return table[table[:, 0] > newest]
