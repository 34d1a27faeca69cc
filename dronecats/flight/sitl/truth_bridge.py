"""Publishes the true poses of a vehicle that an external simulator moves, transformed onto an episode's map.

The poses go to a truth bus (UDP). Camera, logger and the oracle (a pilot that knows the truth) read it like the truth
bus of the project's simulator.
"""

import math
import time
from dataclasses import asdict
from typing import Any

from dronecats.flight.processes.child import Part
from dronecats.flight.sitl.config import TruthBridgeConfig
from dronecats.flight.sitl.episode_world import Placement, load_world, origin, placement_of
from dronecats.flight.sitl.simulation import TruthBus, boot_poses
from dronecats.flight.sitl.sockets import truth_port
from dronecats.flight.sitl.truth_listener import Listener
from foundation.errors import UsageError
from foundation.frames import GRAVITY
from foundation.mavlink import Packer, Parser, dialect
from foundation.truth import TRUTH_COMPONENT, truth_message


def speed(message: dialect.MAVLink_message) -> float:
    """Return the speed (m/s) in a HIL_STATE_QUATERNION."""
    return math.hypot(message.vx, message.vy, message.vz) / 100.0


SILENT_S = 10.0  # wall seconds to wait for the first truth sample
STILL_MPS = 0.2  # m/s, largest speed of a vehicle that stands still
G_PER_UNIT = GRAVITY / 1000.0  # m/s², unit of HIL_STATE_QUATERNION's accelerations (0.001 g)


class TruthSource:
    """Reads the truth stream of one vehicle from a URL.

    Times are rounded down to milliseconds, the resolution of the message that announces a frame on the truth bus
    (CAMERA_IMAGE_CAPTURED). PX4's own simulation leaves the time of HIL_STATE_QUATERNION at zero. In this case the
    sample gets the time of the last HIL_ACTUATOR_CONTROLS, which arrives on the same link at 100 Hz or more.
    """

    def __init__(self, url: str) -> None:
        """Raises UsageError, LinkError for a URL that cannot be opened."""
        self._url = url
        self._parser = Parser()
        self._actuator_us = 0  # time of the last HIL_ACTUATOR_CONTROLS
        self._samples: list[tuple[int, dialect.MAVLink_message]] = []
        self._system: int | None = None
        self._listener = Listener(url, self._feed)

    def read(self, timeout_s: float) -> list[tuple[int, dialect.MAVLink_message]]:
        """Return the samples that arrive within `timeout_s`, each with its time (µs, vehicle clock)."""
        self._listener.read(timeout_s)
        samples, self._samples = self._samples, []
        return samples

    def first(self) -> tuple[int, dialect.MAVLink_message]:
        """Wait for a sample, and return the newest one.

        Raises UsageError if none arrives within SILENT_S, or if the vehicle moves.
        """
        end_s = time.monotonic() + SILENT_S  # wall time, because no vehicle time is known yet
        while time.monotonic() < end_s:
            if samples := self.read(0.1):
                time_us, message = samples[-1]
                if speed(message) > STILL_MPS:
                    raise UsageError(
                        f"the vehicle on --truth {self._url} moves at {speed(message):.1f} m/s, but it must stand"
                        " still before the episode. Land it first"
                    )
                return time_us, message
        raise UsageError(
            f"no truth arrived on --truth {self._url} within {SILENT_S:g} s. It must be HIL_STATE_QUATERNION; PX4's"
            " internal simulation sends it to UDP port 19410 plus its instance"
        )

    def close(self) -> None:
        self._listener.close()

    def _feed(self, data: bytes) -> None:
        for message in self._parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                self._actuator_us = message.time_usec
            if message.get_msgId() != dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                continue
            time_us = (message.time_usec or self._actuator_us) // 1000 * 1000
            if time_us and message.get_srcSystem() == (self._system or message.get_srcSystem()):
                self._system = message.get_srcSystem()
                self._samples.append((time_us, message))


class TruthBridge(Part):
    """The child process that reads the vehicle's poses and publishes them on a truth bus with a UDP port of its own."""

    def __init__(self, config: TruthBridgeConfig) -> None:
        """Raises UsageError."""
        world = load_world(config.episode)
        self._origin = origin(world)
        place = boot_poses(world)[0]
        self._source = TruthSource(config.truth)
        _, message = self._source.first()
        self._placement: Placement = placement_of(message, place.position_ned, place.yaw)
        self._packer = Packer(1, TRUTH_COMPONENT)
        self._bus = TruthBus()
        self._port = truth_port(self._bus, None)

    def ready(self) -> dict[str, Any]:
        """Return the port of the bus, and the fields of the `Placement`."""
        return {"truth": self._port.port, "placement": asdict(self._placement)}

    def turn(self) -> None:
        for time_us, message in self._source.read(0.02):
            self._bus.publish(self._moved(time_us, message))
        self._port.exchange()

    def _moved(self, time_us: int, message: dialect.MAVLink_message) -> bytes:
        sample = self._placement.sample(message, time_us)
        return self._packer.pack(
            truth_message(
                time_us,
                sample.position_ned,
                sample.velocity_ned,
                sample.attitude,
                (message.rollspeed, message.pitchspeed, message.yawspeed),
                (message.xacc * G_PER_UNIT, message.yacc * G_PER_UNIT, message.zacc * G_PER_UNIT),
                self._origin,
            )
        )

    def close(self) -> None:
        self._source.close()
        self._port.close()
