"""What the message makers read, and how a number is put into an integer field."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from autopilot.commander.calibration import SensorCalibration
from autopilot.commander.commander import Commander
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.estimator.vibration import Vibration
from autopilot.parameters import ParameterTable
from foundation.airframe import Airframe
from foundation.mavlink import dialect

Message: TypeAlias = dialect.MAVLink_message  # pymavlink's generated classes carry no types a checker can use


@dataclass(frozen=True, slots=True)
class TelemetrySource:
    """What the makers read."""

    airframe: Airframe
    state: EstimatedState
    commander: Commander
    parameters: ParameterTable
    actuators: Any | None  # ACTUATORS record, None when nobody shares it
    calibration: SensorCalibration
    vibration: Vibration


def whole(value: float, low: int, high: int, unknown: int = 0) -> int:
    """Return the value rounded and clamped into an integer field; `unknown` when it is not finite."""
    if not math.isfinite(value):
        return unknown
    return min(max(round(value), low), high)


def int16(value: float) -> int:
    """Return the value rounded and clamped into an int16 field."""
    return whole(value, -32768, 32767)


def int32(value: float) -> int:
    """Return the value rounded and clamped into an int32 field."""
    return whole(value, -(1 << 31), (1 << 31) - 1)


def boot_ms(v: TelemetrySource) -> int:
    """Return time_boot_ms: the vehicle's time."""
    return v.state.time_us // 1000 & 0xFFFFFFFF


def heading_cdeg(v: TelemetrySource) -> int:
    """Return the heading in 0.01°, 65535 while it is unknown."""
    if not v.state.attitude_valid:
        return 65535
    return round(math.degrees(v.state.yaw) * 100.0) % 36000


Maker = Callable[[TelemetrySource], Message | None]
