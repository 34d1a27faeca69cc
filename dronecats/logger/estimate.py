"""truth.jsonl of a flight whose truth nobody knows: the autopilot's own estimate, `null` for all that is unknown."""

import json
import math
import struct
from pathlib import Path
from typing import Any

from dronecats.logger.recorder import POSE_S
from foundation.mavlink import Parser, dialect
from hil.link.telemetry import VehicleClock


class EstimateRecorder:
    """Writes the pose trace from LOCAL_POSITION_NED and ATTITUDE, and every message into flight.tlog."""

    def __init__(self, folder: Path) -> None:
        self._lines = (folder / "truth.jsonl").open("a", encoding="utf-8")
        self._tlog = (folder / "flight.tlog").open("ab")
        self._parser = Parser()
        self._clock = VehicleClock()
        self._yaw_deg: float | None = None
        self._t0_us: int | None = None
        self._next_pose = 0

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        self._t0_us = t0_us
        self._write({"kind": "begin", "t": 0.0, "t0_us": t0_us, "cap_s": cap_s, "source": "estimate"})

    def end(self, reason: str, error: str | None = None) -> None:
        if self._t0_us is not None:
            self._write({"kind": "end", "t": self._t(), "reason": reason, "error": error})
            self._t0_us = None

    def close(self) -> None:
        self._lines.close()
        self._tlog.close()

    def telemetry(self, data: bytes) -> None:
        """Take bytes of the link."""
        for message in self._parser.feed(data):
            self._tlog.write(struct.pack(">Q", self._clock.time_us) + bytes(message.get_msgbuf()))
            if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
                continue
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_ATTITUDE:
                self._yaw_deg = math.degrees(message.yaw)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._clock.see(message.time_boot_ms)
                self._pose(message)

    def _pose(self, message: dialect.MAVLink_message) -> None:
        if self._t0_us is None or self._t() < self._next_pose * POSE_S:
            return
        self._next_pose = math.floor(self._t() / POSE_S) + 1
        self._write(
            {
                "kind": "pose",
                "t": self._t(),
                "drone": 0,
                "position_ned": [round(v, 4) for v in (message.x, message.y, message.z)],
                "yaw_deg": None if self._yaw_deg is None else round(self._yaw_deg, 4),
                "target_ned": None,
                "distance_m": None,
                "visible": None,
            }
        )

    def _t(self) -> float:
        return round((self._clock.time_us - (self._t0_us or 0)) / 1e6, 6)

    def _write(self, record: dict[str, Any]) -> None:
        self._lines.write(json.dumps(record) + "\n")
        self._lines.flush()
