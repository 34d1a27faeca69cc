"""A simulator's wires, followed: where everybody truly is, and what the autopilots say."""

import struct
from collections.abc import Callable

from dronecats.flight.logger.telemetry import subscribe
from dronecats.flight.processes.bus_listener import Listener
from dronecats.view.live.config import WatchedWires
from dronecats.view.live.heard import POSE, HeardFlight
from dronecats.view.live.moment import JudgeMoment, Moment
from episodes.world.world import World
from foundation import wire
from foundation.mavlink import Parser
from foundation.truth import TRUTH_COMPONENT

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
