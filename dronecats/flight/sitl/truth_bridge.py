"""The truth of a vehicle that simulates itself, as a process: moved onto our map, and put on a bus of our own.

Camera, logger and oracle listen on that bus as they do on our simulator's.
"""

import time
from dataclasses import asdict
from typing import Any

from dronecats.flight.processes.bus_listener import Listener
from dronecats.flight.sitl.bus import TruthBus
from dronecats.flight.sitl.config import TruthBridgeConfig
from dronecats.flight.sitl.placement import Placement, TruthClock, speed, standing
from dronecats.flight.sitl.scenario import boot_poses, load_world, origin
from dronecats.flight.sitl.sockets import UdpPort
from foundation.errors import UsageError
from foundation.mavlink import Packer, Parser, dialect
from foundation.truth import TRUTH_COMPONENT, truth_message

HEARD_S = 10.0  # wall seconds in which a truth stream has to speak
STILL_MPS = 0.2  # m/s, below which a vehicle stands
G_PER_UNIT = 9.80665 / 1000.0  # m/s² of HIL_STATE_QUATERNION's thousandths of g


class TruthSource:
    """The truth stream of one vehicle, by URL."""

    def __init__(self, url: str) -> None:
        """Raises UsageError, LinkError for a URL that cannot be opened."""
        self._url = url
        self._parser, self._clock = Parser(), TruthClock()
        self._samples: list[tuple[int, dialect.MAVLink_message]] = []
        self._system: int | None = None
        self._listener = Listener(url, self._feed)

    def read(self, timeout_s: float) -> list[tuple[int, dialect.MAVLink_message]]:
        """Return the samples that came within `timeout_s`, each with its time in µs of the vehicle's clock."""
        self._listener.read(timeout_s)
        samples, self._samples = self._samples, []
        return samples

    def first(self) -> tuple[int, dialect.MAVLink_message]:
        """Return the first sample of a vehicle that stands. Raises UsageError when there is none in time."""
        end_s = time.monotonic() + HEARD_S  # how long a wire is silent is a matter of the wall's clock
        while time.monotonic() < end_s:
            if samples := self.read(0.1):
                time_us, message = samples[-1]
                if speed(message) > STILL_MPS:
                    raise UsageError(
                        f"the vehicle on --truth {self._url} moves at {speed(message):.1f} m/s: it has to stand where "
                        "the episode begins, so land it first"
                    )
                return time_us, message
        raise UsageError(
            f"no truth comes on --truth {self._url} within {HEARD_S:g} s: HIL_STATE_QUATERNION is wanted there, which "
            "PX4's internal simulation sends to UDP port 19410 plus its instance"
        )

    def close(self) -> None:
        self._listener.close()

    def _feed(self, data: bytes) -> None:
        for message in self._parser.feed(data):
            time_us = self._clock.see(message)
            if time_us is not None and message.get_srcSystem() == (self._system or message.get_srcSystem()):
                self._system = message.get_srcSystem()
                self._samples.append((time_us, message))


class TruthBridge:
    """Part of a flight of somebody else's vehicle in our world."""

    def __init__(self, config: TruthBridgeConfig) -> None:
        world = load_world(config.episode)
        self._origin = origin(world)
        place = boot_poses(world)[0]
        self._source = TruthSource(config.truth)
        _, message = self._source.first()
        self._placement: Placement = standing(message, place.position_ned, place.yaw)
        self._packer = Packer(1, TRUTH_COMPONENT)
        self._bus = TruthBus()
        tap = self._bus.tap()
        self._port = UdpPort(("127.0.0.1", 0), None, tap.take, tap.receive, shared=True)

    def ready(self) -> dict[str, Any]:
        """Return the bus's port, and how the vehicle is moved onto the map, as the fields of a `Placement`."""
        return {"truth": self._port.port, "placement": asdict(self._placement)}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        return None

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


def create(config: TruthBridgeConfig) -> TruthBridge:
    """Return the bridge from a truth URL to an episode. Raises UsageError."""
    return TruthBridge(config)
