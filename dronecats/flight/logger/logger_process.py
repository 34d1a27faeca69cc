"""The logger process: it reads the truth bus (true poses) and each drone's telemetry, and writes the logs."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from dronecats.flight.logger.recorder import LoggerConfig, LoggerPart, Measure, Recorder
from dronecats.flight.sitl.config import AIRFRAME
from dronecats.flight.sitl.episode_world import load_world, origin
from dronecats.flight.sitl.truth_listener import Listener
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import CameraModel, camera_on
from foundation.mavlink import Packer, dialect
from foundation.measurement import TargetMeasurement
from foundation.truth import TruthSample
from vehicles import airframe as airframes


def measured_in(world: World) -> Measure:
    """Return the function that measures the target in an episode's world; other drones may hide the target."""

    def measure(
        t_s: float, sample: TruthSample, camera: CameraModel, fleet: Sequence[TruthSample]
    ) -> TargetMeasurement:
        around = [DronePose(drone.position_ned, drone.attitude) for drone in fleet]
        return world.measure(t_s, sample.position_ned, sample.attitude, camera.at_pitch(sample.gimbal_pitch), around)

    return measure


SYSTEM, COMPONENT = 246, 155  # MAVLink ids; 155: MAV_COMP_ID_LOG
# id of each requested message → its interval, µs
WATCHED = {
    dialect.MAVLINK_MSG_ID_ATTITUDE: 200_000,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 200_000,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1_000_000,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1_000_000,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 200_000,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1_000_000,
    dialect.MAVLINK_MSG_ID_ODOMETRY: 200_000,  # for its reset counter
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1_000_000,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 5_000_000,
}


def subscribe(send: Callable[[bytes], None], system: int) -> None:
    """Request each message of WATCHED at its interval from the autopilot with the system id `system`."""
    packer = Packer(SYSTEM, COMPONENT)
    for message_id, interval_us in WATCHED.items():
        send(
            packer.pack(
                dialect.MAVLink_command_long_message(
                    system, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, interval_us, 0, 0, 0, 0, 0
                )
            )
        )


class Logger(LoggerPart):
    """The logger as a child process of a real-time flight."""

    def __init__(self, config: LoggerConfig) -> None:
        world = load_world(config.episode, config.airframe)
        world.warm_up()
        camera = camera_on(airframes.load(config.airframe or AIRFRAME).camera)
        self._recorder = Recorder(Path(config.folder), origin(world), measured_in(world), camera)
        self._truth = Listener(config.truth, self._recorder.truth)
        self._telemetry = [
            Listener(url, partial(self._recorder.telemetry, drone=drone)) for drone, url in enumerate(config.telemetry)
        ]
        for index, listener in enumerate(self._telemetry):
            subscribe(listener.send, index + 1)

    def ready(self) -> dict[str, Any]:
        return {"ports": [listener.port for listener in self._telemetry]}

    def turn(self) -> None:
        self._truth.read(0.02)
        for listener in self._telemetry:
            listener.read(0.0)
