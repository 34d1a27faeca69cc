"""The SETPOINT record as an immutable value, and the writer that puts it into the record."""

import math
from typing import Any, NamedTuple

from autopilot.records import KIND_IDLE, KIND_TRAJECTORY
from foundation.frames import Quat, Vec3

NAN = math.nan
FREE: Vec3 = (NAN, NAN, NAN)  # not controlled


class CascadeSetpoint(NamedTuple):
    """What the cascade shall do; fields, units and frames as in `autopilot.records.SETPOINT`."""

    kind: int = KIND_TRAJECTORY
    position_ned: Vec3 = FREE
    velocity_ned: Vec3 = FREE
    acceleration_ned: Vec3 = FREE
    yaw: float = NAN
    yaw_rate: float = NAN
    attitude: Quat = (1.0, 0.0, 0.0, 0.0)
    rates_frd: Vec3 = (0.0, 0.0, 0.0)
    thrust: float = 0.0
    speed_limit_up: float = 3.0
    speed_limit_down: float = 1.5
    speed_limit_horizontal: float = 12.0
    thrust_limit: float = 1.0


IDLE = CascadeSetpoint(kind=KIND_IDLE)


class SetpointWriter:
    """Writes a CascadeSetpoint into a SETPOINT record, and only when something has changed."""

    def __init__(self, record: Any) -> None:
        self._record = record
        self._last: tuple[CascadeSetpoint, bool] | None = None
        self.write(IDLE, armed=False)

    def write(self, setpoint: CascadeSetpoint, armed: bool) -> None:
        """Put the setpoint and the armed flag into the record."""
        if self._last == (setpoint, armed):
            return
        record = self._record
        for name, value in zip(CascadeSetpoint._fields, setpoint, strict=True):
            record[name] = value
        record["armed"] = armed
        self._last = (setpoint, armed)
