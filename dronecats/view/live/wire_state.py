"""Decodes the state of each drone from MAVLink frames, which come from flight.tlog or a simulator's sockets."""

import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dronecats.flight.logger.logger_process import subscribe
from dronecats.flight.sitl.truth_listener import Listener
from dronecats.view.live.config import WatchedWires
from dronecats.view.live.folder import is_intact
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment
from episodes.world.world import World
from foundation import wire
from foundation.frames import Quat, Vec3, quat_from_euler
from foundation.mavlink import Parser, dialect
from foundation.truth import TRUTH_COMPONENT, Origin, truth_sample
from hil.link.telemetry import STATE_MESSAGES, StatusTexts, VehicleState, setpoint_velocity, update

AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
POSE, POSITION_TARGET = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
TEXT, LOCAL_POSITION = dialect.MAVLINK_MSG_ID_STATUSTEXT, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
HANDLED = STATE_MESSAGES | {POSITION_TARGET, TEXT}  # messages of an autopilot that change a drone's state
# MAVLink frames of the truth bus kept per drone: 60 s at 50 Hz. `pose_at` looks up the pose of a past camera image.
KEPT = 3000
KEPT_ESTIMATES = 600  # poses estimated by the autopilot, per drone
_TIME = struct.Struct("<Q")  # the first field of HIL_STATE_QUATERNION


@dataclass(frozen=True, slots=True)
class WirePose:
    """The pose of a drone: the true pose from the simulator's truth bus, or the estimate of the drone's autopilot."""

    time_us: int  # µs, vehicle clock
    position_ned: Vec3  # m, NED: in the map frame if `true`, else in the autopilot's local frame
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED
    true: bool


@dataclass(slots=True)
class DroneFrames:
    """The MAVLink frames and the decoded state of one drone. Frames are decoded when they are needed."""

    truths: deque[bytes] = field(default_factory=lambda: deque(maxlen=KEPT))  # frames of the truth bus
    estimates: deque[WirePose] = field(default_factory=lambda: deque(maxlen=KEPT_ESTIMATES))
    state: VehicleState = field(default_factory=VehicleState)
    has_state: bool = False  # whether a message of the autopilot has arrived
    setpoint_ned: Vec3 | None = None  # m/s
    texts: StatusTexts = field(default_factory=StatusTexts)
    # message id → (time of arrival in µs, newest frame of this message), not decoded yet
    new: dict[int, tuple[int, bytes]] = field(default_factory=dict)


class WireState:
    def __init__(self, origin: Origin | None) -> None:
        """`origin`: geodetic origin of the map; None: the map is unknown, and only autopilots' estimates are used."""
        self._origin = origin
        self.drones: dict[int, DroneFrames] = {}
        self.time_us = 0  # µs, vehicle clock, of the newest frame

    def feed(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """Process MAVLink frames, given as pairs (vehicle time of arrival in µs, frame)."""
        for time_us, frame in frames:
            component, number = frame[6], frame[7] | frame[8] << 8 | frame[9] << 16
            if component == TRUTH_COMPONENT and number == POSE:
                self._drone_of(frame).truths.append(frame)
            elif component != AUTOPILOT or number not in HANDLED:
                continue
            elif number == TEXT:
                if (message := _decoded(frame)) is not None:
                    self._drone_of(frame).texts.take(message, time_us)
            else:
                self._drone_of(frame).new[number] = (time_us, frame)
            self.time_us = max(self.time_us, time_us)
        for drone in self.drones.values():
            self._take(drone)

    def pose(self, drone: int) -> WirePose | None:
        """Return the newest pose of a drone; None if there is none."""
        wires = self.drones.get(drone)
        if wires is None:
            return None
        if wires.truths and self._origin is not None:
            return self._truth(wires.truths[-1])
        return wires.estimates[-1] if wires.estimates else None

    def pose_at(self, drone: int, time_us: int) -> WirePose | None:
        """Return the pose of a drone in the sample nearest to a vehicle time (µs); None if there is none."""
        wires = self.drones.get(drone)
        if wires is None:
            return None
        if wires.truths and self._origin is not None:
            nearest = min(wires.truths, key=lambda frame: abs(_TIME.unpack_from(frame, wire.HEADER_BYTES)[0] - time_us))
            return self._truth(nearest)
        return min(wires.estimates, key=lambda pose: abs(pose.time_us - time_us), default=None)

    def moment(self, drone: int, ground_down: Callable[[float, float], float]) -> DroneMoment:
        """Return a drone's newest state. `ground_down` returns the ground's down coordinate (m) at (north, east)."""
        pose, wires = self.pose(drone), self.drones.get(drone)
        if wires is None:
            return DroneMoment(drone)
        moment = DroneMoment(
            drone,
            setpoint_ned=wires.setpoint_ned,
            mode=wires.state.mode,
            armed=wires.state.armed if wires.has_state else None,
            battery=wires.state.battery_remaining,
            messages=tuple(text.text for text in wires.texts.newest),
        )
        if pose is None:
            return moment
        north, east, down = pose.position_ned
        return replace(
            moment,
            position_ned=pose.position_ned,
            attitude=pose.attitude,
            velocity_ned=pose.velocity_ned,
            height_m=ground_down(north, east) - down,
            true=pose.true,
        )

    def _drone_of(self, frame: bytes) -> DroneFrames:
        """Return the drone that sent a MAVLink frame. If the map is unknown, every frame counts as from drone 0."""
        return self.drones.setdefault(0 if self._origin is None else frame[5] - 1, DroneFrames())

    def _truth(self, frame: bytes) -> WirePose | None:
        message = _decoded(frame)
        if message is None or self._origin is None:
            return None
        sample = truth_sample(message, self._origin)
        return WirePose(sample.time_us, sample.position_ned, sample.velocity_ned, sample.attitude, true=True)

    def _take(self, drone: DroneFrames) -> None:
        """Decode the newest messages from a drone's autopilot, and update the drone's state."""
        placed = LOCAL_POSITION in drone.new
        for number, (time_us, frame) in drone.new.items():
            message = _decoded(frame)
            if message is None:
                continue
            if number == POSITION_TARGET:
                drone.setpoint_ned = setpoint_velocity(message)
            else:
                drone.state, drone.has_state = update(drone.state, message, time_us), True
        drone.new.clear()
        state = drone.state
        if placed and state.position_ned is not None:
            attitude = quat_from_euler(*state.euler) if state.euler is not None else (1.0, 0.0, 0.0, 0.0)
            velocity = state.velocity_ned or (0.0, 0.0, 0.0)
            drone.estimates.append(WirePose(state.position_us, state.position_ned, velocity, attitude, true=False))


def _decoded(frame: bytes) -> Any:
    """Return the message of a frame; None if the frame is damaged."""
    if not is_intact(frame):
        return None
    if frame[2] & wire.SIGNED:
        frame = frame[: -wire.SIGNATURE_BYTES]
    return wire.BY_ID[frame[7] | frame[8] << 8 | frame[9] << 16].message(frame)


DELIVERIES = 400  # at most this many datagrams per socket and turn, so that a busy socket does not block the others


class WireFollower:
    """Follows a simulator through its sockets. `turn` does not block."""

    def __init__(self, wires: WatchedWires, world: World) -> None:
        scene = world.scene
        self._world, self._drones = world, wires.drones
        self._state = WireState((scene.latitude_deg, scene.longitude_deg, scene.altitude_m))
        self._listeners = [Listener(wires.truth, self._taker())]
        for index, url in enumerate(wires.telemetry):
            listener = Listener(url, self._taker())
            subscribe(listener.send, index + 1)
            self._listeners.append(listener)

    def turn(self) -> Moment:
        """Read the sockets, and return the current moment."""
        for listener in self._listeners:
            for _ in range(DELIVERIES):
                if not listener.read(0.0):
                    break
        drones = tuple(self._state.moment(k, self._world.ground_down) for k in range(self._drones))
        judge, moved = JudgeMoment(self._world.target_centre(0.0)), self._world.moved(0.0)
        flying = any(drone.armed for drone in drones)
        return Moment(self._state.time_us / 1e6, drones, judge, moved, "armed" if flying else "on the ground")

    def close(self) -> None:
        for listener in self._listeners:
            listener.close()

    def _taker(self) -> Callable[[bytes], None]:
        """Return a function that processes the bytes of one socket."""
        parser = Parser()

        def take(data: bytes) -> None:
            self._state.feed([(self._time(frame), frame) for frame in parser.frames(data)])

        return take

    def _time(self, frame: bytes) -> int:
        """Return the vehicle time (µs) of a frame: its time stamp for a true pose, else the newest known time."""
        number = frame[7] | frame[8] << 8 | frame[9] << 16
        if frame[6] == TRUTH_COMPONENT and number == POSE and frame[1] >= _TIME.size:
            return int(_TIME.unpack_from(frame, wire.HEADER_BYTES)[0])
        return self._state.time_us
