"""The logger process of a flight that is not scored: it writes the autopilot's estimate into truth.jsonl."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.flight.logger.estimator_resets import ResetWatch
from dronecats.flight.logger.recorder import EpisodeRecorder, LoggerPart
from foundation.mavlink import Parser, dialect
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder.rows import Begin, Pose
from hil.link.telemetry import VehicleClock
from hil.link.transport import UdpTransport


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateLoggerConfig:
    folder: str  # folder for the episode's logs


class EstimateRecorder(EpisodeRecorder):
    """Writes poses from LOCAL_POSITION_NED and ATTITUDE into truth.jsonl, and every message into flight.tlog.

    Values that are not finite stay out of truth.jsonl.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._parser = Parser()
        self._clock = VehicleClock()
        self._resets = ResetWatch()
        self._yaw_deg: float | None = None
        self._next_pose = 0

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        self._t0_us, self._time_us = t0_us, max(t0_us, self._clock.time_us)
        resets = True if self._resets.sends_counter else UNSET
        self._rows.write(Begin(t0_us=t0_us, cap_s=cap_s, source="estimate", resets=resets))

    def telemetry(self, data: bytes) -> None:
        """Process bytes of the vehicle's MAVLink link."""
        for message in self._parser.feed(data):
            self._tlog.write(self._clock.time_us, bytes(message.get_msgbuf()))
            if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
                continue
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_ATTITUDE:
                if math.isfinite(message.yaw):
                    self._yaw_deg = math.degrees(message.yaw)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._clock.see(message.time_boot_ms)
                # when the vehicle reboots, its clock restarts at 0, but the time of the episode must not go back
                self._time_us = max(self._time_us, self._clock.time_us)
                self._pose(message)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_ODOMETRY:
                self._write_reset(self._resets.message(message), 0)
        self._tlog.flush()

    def _pose(self, message: dialect.MAVLink_message) -> None:
        t = self._t(self._time_us)
        if self._t0_us is None or t < self._next_pose * POSE_PERIOD_S:
            return
        if not all(map(math.isfinite, (message.x, message.y, message.z))):
            return
        self._next_pose = math.floor(t / POSE_PERIOD_S) + 1
        self._rows.write(
            Pose(
                t=t,
                drone=0,
                position_ned=(round(message.x, 4), round(message.y, 4), round(message.z, 4)),
                yaw_deg=None if self._yaw_deg is None else round(self._yaw_deg, 4),
                distance_m=None,
                visible=None,
            )
        )


class EstimateLogger(LoggerPart):
    """The estimate logger as a child process of a flight on a connected vehicle."""

    _recorder: EstimateRecorder

    def __init__(self, config: EstimateLoggerConfig) -> None:
        self._recorder = EstimateRecorder(Path(config.folder))
        self._socket = UdpTransport("udpin://127.0.0.1:0", "127.0.0.1", 0, listen=True)

    def ready(self) -> dict[str, Any]:
        return {"ports": [self._socket.port]}

    def turn(self) -> None:
        self._recorder.telemetry(self._socket.receive(0.02))

    def close(self) -> None:
        super().close()
        self._socket.close()
