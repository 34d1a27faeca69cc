"""The state of each drone, decoded from MAVLink frames of flight.tlog or of a simulator's sockets."""

import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dronecats.flight.logger.logger_process import subscribe
from dronecats.flight.sitl.bus import Listener
from dronecats.view.live.config import WatchedWires
from dronecats.view.live.folder import intact
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment
from episodes.world.world import World
from foundation import wire
from foundation.frames import Quat, Vec3, quat_from_euler
from foundation.mavlink import Parser, dialect, mode_name
from foundation.truth import TRUTH_COMPONENT, Origin, truth_sample
from hil.link.telemetry import STATE_MESSAGES, StatusTexts, VehicleState, setpoint_velocity, update

AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
POSE, TARGET = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
TEXT, PLACE = dialect.MAVLINK_MSG_ID_STATUSTEXT, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
KEPT = 3000  # truths of a drone: a minute at 50 Hz, in which a decision's picture was taken
KEPT_ESTIMATES = 600
_TIME = struct.Struct("<Q")  # the first field of HIL_STATE_QUATERNION


@dataclass(frozen=True, slots=True)
class HeardPose:
    """Where a drone is, by the truth bus or by its own autopilot."""

    time_us: int  # µs, vehicle clock
    position_ned: Vec3  # m, map frame; of an autopilot, its own
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED
    true: bool


@dataclass(slots=True)
class HeardDrone:
    """One drone's wire, decoded when it is asked for."""

    truths: deque[bytes] = field(default_factory=lambda: deque(maxlen=KEPT))  # frames
    estimates: deque[HeardPose] = field(default_factory=lambda: deque(maxlen=KEPT_ESTIMATES))
    state: VehicleState = field(default_factory=VehicleState)
    told: bool = False  # whether the autopilot has been heard
    setpoint_ned: Vec3 | None = None  # m/s
    texts: StatusTexts = field(default_factory=StatusTexts)
    new: dict[int, tuple[int, bytes]] = field(default_factory=dict)  # the newest of each message, not decoded yet


class HeardFlight:
    """Everybody's wires."""

    def __init__(self, origin: Origin | None) -> None:
        """`origin`: geodetic place of the map; None: no map is known, and only autopilots are listened to."""
        self._origin = origin
        self.drones: dict[int, HeardDrone] = {}
        self.time_us = 0  # µs, vehicle clock, of the newest that has come

    def feed(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """Take frames with the times at which they were heard."""
        for time_us, frame in frames:
            component, number = frame[6], frame[7] | frame[8] << 8 | frame[9] << 16
            if component == TRUTH_COMPONENT and number == POSE:
                self._of(frame).truths.append(frame)
            elif component != AUTOPILOT or (number not in STATE_MESSAGES and number != TARGET):
                continue
            elif number == TEXT:
                if (message := _decoded(frame)) is not None:
                    self._of(frame).texts.take(message, time_us)
            else:
                self._of(frame).new[number] = (time_us, frame)
            self.time_us = max(self.time_us, time_us)
        for drone in self.drones.values():
            self._take(drone)

    def pose(self, drone: int) -> HeardPose | None:
        """Return where a drone is now, None where nobody has said so."""
        heard = self.drones.get(drone)
        if heard is None:
            return None
        if heard.truths and self._origin is not None:
            return self._truth(heard.truths[-1])
        return heard.estimates[-1] if heard.estimates else None

    def pose_at(self, drone: int, time_us: int) -> HeardPose | None:
        """Return where a drone was at a time of the vehicle's clock, of the sample nearest to it."""
        heard = self.drones.get(drone)
        if heard is None:
            return None
        if heard.truths and self._origin is not None:
            nearest = min(heard.truths, key=lambda frame: abs(_TIME.unpack_from(frame, wire.HEADER_BYTES)[0] - time_us))
            return self._truth(nearest)
        return min(heard.estimates, key=lambda pose: abs(pose.time_us - time_us), default=None)

    def moment(self, drone: int, ground_down: Callable[[float, float], float]) -> DroneMoment:
        """Return a drone as far as its wires tell of it; `ground_down`: m NED of the ground at a place."""
        pose, heard = self.pose(drone), self.drones.get(drone)
        if heard is None:
            return DroneMoment(drone)
        shown = DroneMoment(
            drone,
            setpoint_ned=heard.setpoint_ned,
            mode=heard.state.mode,
            armed=heard.state.armed if heard.told else None,
            battery=heard.state.battery_remaining,
            said=tuple(said.text for said in heard.texts.newest),
        )
        if pose is None:
            return shown
        north, east, down = pose.position_ned
        return replace(
            shown,
            position_ned=pose.position_ned,
            attitude=pose.attitude,
            velocity_ned=pose.velocity_ned,
            height_m=ground_down(north, east) - down,
            true=pose.true,
        )

    def _of(self, frame: bytes) -> HeardDrone:
        """Return the drone of a frame; where there is no truth, there is one vehicle, whatever its number."""
        return self.drones.setdefault(0 if self._origin is None else frame[5] - 1, HeardDrone())

    def _truth(self, frame: bytes) -> HeardPose | None:
        message = _decoded(frame)
        if message is None or self._origin is None:
            return None
        sample = truth_sample(message, self._origin)
        return HeardPose(sample.time_us, sample.position_ned, sample.velocity_ned, sample.attitude, true=True)

    def _take(self, drone: HeardDrone) -> None:
        """Decode the newest that an autopilot has said."""
        placed = PLACE in drone.new
        for number, (time_us, frame) in drone.new.items():
            message = _decoded(frame)
            if message is None:
                continue
            if number == TARGET:
                drone.setpoint_ned = setpoint_velocity(message)
            else:
                drone.state, drone.told = update(drone.state, message, mode_name, time_us), True
        drone.new.clear()
        state = drone.state
        if placed and state.position_ned is not None:
            attitude = quat_from_euler(*state.euler) if state.euler is not None else (1.0, 0.0, 0.0, 0.0)
            velocity = state.velocity_ned or (0.0, 0.0, 0.0)
            drone.estimates.append(HeardPose(state.position_us, state.position_ned, velocity, attitude, true=False))


def _decoded(frame: bytes) -> Any:
    """Return the message of a frame, None where it is damaged."""
    if not intact(frame):
        return None
    if frame[2] & wire.SIGNED:
        frame = frame[: -wire.SIGNATURE_BYTES]
    return wire.BY_ID[frame[7] | frame[8] << 8 | frame[9] << 16].message(frame)


_TIME = struct.Struct("<Q")  # the first field of HIL_STATE_QUATERNION
DELIVERIES = 400  # of each wire that are taken at a time, so that one that never falls silent holds nobody up


class WireFollower:
    """Follows a simulator; `turn` never waits."""

    def __init__(self, wires: WatchedWires, world: World) -> None:
        scene = world.scene
        self._world, self._drones = world, wires.drones
        self._heard = HeardFlight((scene.latitude_deg, scene.longitude_deg, scene.altitude_m))
        self._listeners = [Listener(wires.truth, self._taker())]
        for index, url in enumerate(wires.telemetry):
            listener = Listener(url, self._taker())
            subscribe(listener.send, index + 1)
            self._listeners.append(listener)

    def turn(self) -> Moment:
        """Take in what has come, and return the moment that it makes."""
        for listener in self._listeners:
            for _ in range(DELIVERIES):
                if not listener.read(0.0):
                    break
        drones = tuple(self._heard.moment(k, self._world.ground_down) for k in range(self._drones))
        judge, moved = JudgeMoment(self._world.target_centre(0.0)), self._world.moved(0.0)
        flying = any(drone.armed for drone in drones)
        return Moment(self._heard.time_us / 1e6, drones, judge, moved, "armed" if flying else "on the ground")

    def close(self) -> None:
        for listener in self._listeners:
            listener.close()

    def _taker(self) -> Callable[[bytes], None]:
        """Return what takes the bytes of one wire."""
        parser = Parser()

        def take(data: bytes) -> None:
            self._heard.feed([(self._time(frame), frame) for frame in parser.frames(data)])

        return take

    def _time(self, frame: bytes) -> int:
        """Return the vehicle's time (µs) of a frame: a true pose tells it, and all else is as late as the newest."""
        number = frame[7] | frame[8] << 8 | frame[9] << 16
        if frame[6] == TRUTH_COMPONENT and number == POSE and frame[1] >= _TIME.size:
            return int(_TIME.unpack_from(frame, wire.HEADER_BYTES)[0])
        return self._heard.time_us
