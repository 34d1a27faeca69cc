"""Makers of the telemetry messages about the vehicle's condition (modes, health, battery, identity, clocks).

A maker returns the fields of its message, or None if it has no data. `TelemetrySource` holds the inputs of all makers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from autopilot.commander.commander import Commander
from autopilot.commander.health import STICK_MODES, SensorCalibration, sensor_health
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.mavlink.gimbal import GimbalManager
from autopilot.parameters import ParameterTable
from foundation.airframe import Airframe
from foundation.mavlink import MODES, PX4_AUTOPILOT, dialect
from foundation.sensors import CALENDAR_START_US
from foundation.wire import Fields, clamped

Message: TypeAlias = dialect.MAVLink_message  # pymavlink's generated classes have no types for a type checker


@dataclass(frozen=True, slots=True)
class TelemetrySource:
    """The inputs of the makers."""

    airframe: Airframe
    state: EstimatedState
    commander: Commander
    parameters: ParameterTable
    actuators: Any | None  # ACTUATORS record; None: not available
    calibration: SensorCalibration
    gimbal: GimbalManager | None = None  # None: the camera is fixed


def boot_ms(v: TelemetrySource) -> int:
    """Return the vehicle's time for `time_boot_ms`."""
    return v.state.time_us // 1000 & 0xFFFFFFFF


def heading_cdeg(v: TelemetrySource) -> int:
    """Return the heading in 0.01°, 65535 while it is unknown."""
    if not v.state.attitude_valid:
        return 65535
    return round(math.degrees(v.state.yaw) * 100.0) % 36000


Maker = Callable[[TelemetrySource], Fields | None]


SENSOR_GYRO, SENSOR_ACCEL, SENSOR_MAG = 0x1, 0x2, 0x4
SENSOR_PRESSURE, SENSOR_GPS, SENSOR_RANGE = 0x8, 0x20, 0x100
CONTROL_BITS = 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000  # rate, attitude, yaw, altitude, position, motors
SENSOR_RC, SENSOR_FENCE, SENSOR_AHRS = 0x10000, 0x100000, 0x200000
SENSOR_BATTERY, PREARM_CHECK, EXTENSION_USED = 0x2000000, 0x10000000, 0x80000000

# PX4 1.15, whose measured behaviour this autopilot follows; type 255 = release
FLIGHT_SW_VERSION = 1 << 24 | 15 << 16 | 0 << 8 | 255
VENDOR_ID, PRODUCT_ID = 0x26AC, 0x10
CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | dialect.MAV_PROTOCOL_CAPABILITY_FTP
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)

_STANDARD_MODES = {"POSCTL": 1, "ORBIT": 2, "ALTCTL": 4, "RETURN": 5, "MISSION": 6, "LAND": 7, "TAKEOFF": 8}


def standard_mode(mode: str) -> int:
    """Return the MAV_STANDARD_MODE of a mode name; 0 if it has none."""
    return _STANDARD_MODES.get(mode, 0)


def system_status(v: TelemetrySource) -> int:
    """Return MAV_STATE: 0 not ready, 2 calibrating, 3 ready, 4 armed, 5 failsafe, 8 terminated (as measured on PX4)."""
    c = v.commander
    if c.armed and c.mode == "TERMINATION":
        return int(dialect.MAV_STATE_FLIGHT_TERMINATION)
    if c.armed:
        return int(dialect.MAV_STATE_CRITICAL if c.in_failsafe else dialect.MAV_STATE_ACTIVE)
    if v.calibration.running:
        return int(dialect.MAV_STATE_CALIBRATING)
    return int(dialect.MAV_STATE_UNINIT if c.arming_failures() else dialect.MAV_STATE_STANDBY)


def heartbeat(v: TelemetrySource) -> Fields:
    c = v.commander
    base = 1 | (128 if c.armed else 0)
    if c.mode in STICK_MODES:
        base |= 64 | (0 if c.mode in ("MANUAL", "ACRO") else 16)
    elif c.mode == "OFFBOARD":
        base |= 16
    else:
        base |= 4 | 8 | 16
    return (v.airframe.mav_type, PX4_AUTOPILOT, base, c.custom_mode, system_status(v), 3)


def sys_status(v: TelemetrySource) -> Fields:
    health, s = sensor_health(v.state), v.state.sensors
    present = SENSOR_GYRO | SENSOR_ACCEL | SENSOR_MAG | SENSOR_PRESSURE | SENSOR_GPS | CONTROL_BITS | SENSOR_AHRS
    present |= SENSOR_BATTERY | PREARM_CHECK | EXTENSION_USED | SENSOR_FENCE
    if int(s["range_time_us"]):
        present |= SENSOR_RANGE
    if v.commander.flight.sticks.time_us >= 0:
        present |= SENSOR_RC
    is_good = {
        EXTENSION_USED | CONTROL_BITS: True,
        SENSOR_FENCE: not v.commander.supervision.breach,
        SENSOR_GYRO | SENSOR_ACCEL: health.imu,
        SENSOR_MAG: health.mag,
        SENSOR_PRESSURE: health.baro,
        SENSOR_GPS: health.gps and v.state.global_valid,
        SENSOR_RANGE: health.range,
        SENSOR_AHRS: v.state.attitude_valid,
        SENSOR_BATTERY: health.battery and float(s["battery_remaining"]) > v.parameters["BAT_CRIT_THR"],
        SENSOR_RC: v.commander.flight.sticks.fresh(v.state.time_us, v.parameters["COM_RC_LOSS_T"]),
        PREARM_CHECK: v.commander.armed or not v.commander.arming_failures(),
    }
    good = sum(bits for bits, is_set in is_good.items() if is_set) & present
    has_battery = health.battery
    return (
        present, present, good, 200,
        clamped(float(s["battery_voltage"]) * 1000.0, 0, 65534, 65535) if has_battery else 65535,
        clamped(float(s["battery_current"]) * 100.0, 0, 32767, -1) if has_battery else -1,
        clamped(math.ceil(float(s["battery_remaining"]) * 100.0), 0, 100, -1) if has_battery else -1,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def landed_state(v: TelemetrySource) -> int:
    """Return MAV_LANDED_STATE."""
    if v.commander.landed:
        return int(dialect.MAV_LANDED_STATE_ON_GROUND)
    shown = {"TAKEOFF": dialect.MAV_LANDED_STATE_TAKEOFF, "LAND": dialect.MAV_LANDED_STATE_LANDING}
    return int(shown.get(v.commander.mode, dialect.MAV_LANDED_STATE_IN_AIR))


def extended_sys_state(v: TelemetrySource) -> Fields:
    return (0, landed_state(v))


def battery_status(v: TelemetrySource) -> Fields | None:
    b = v.state.sensors
    if not int(b["battery_time_us"]):
        return None
    pack, remaining, p = v.airframe.battery, float(b["battery_remaining"]), v.parameters
    cells = min(pack.cells, 10)
    per_cell = clamped(float(b["battery_voltage"]) * 1000.0 / cells, 0, 65534, 65535)
    if remaining < p["BAT_EMERGEN_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY
    elif remaining < p["BAT_CRIT_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL
    elif remaining < p["BAT_LOW_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_LOW
    else:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_OK
    return (
        0, dialect.MAV_BATTERY_FUNCTION_ALL, dialect.MAV_BATTERY_TYPE_LIPO, 32767,
        [per_cell] * cells + [65535] * (10 - cells), clamped(float(b["battery_current"]) * 100.0, 0, 32767, -1),
        clamped((1.0 - remaining) * pack.capacity_ah * 1000.0, 0, 1 << 30, -1), -1,
        clamped(remaining * 100.0, 0, 100, -1), 0, charge,
    )  # fmt: skip


def current_mode(v: TelemetrySource) -> Fields:
    c = v.commander
    return (standard_mode(c.mode), c.custom_mode, MODES[c.intended].custom_mode)


def mission_state(v: TelemetrySource) -> int:
    """Return MISSION_STATE."""
    c = v.commander
    if not c.flight.plans.mission:
        return int(dialect.MISSION_STATE_NO_MISSION)
    if c.mission.complete:
        return int(dialect.MISSION_STATE_COMPLETE)
    if not c.mission.begun:
        return int(dialect.MISSION_STATE_NOT_STARTED)
    return int(dialect.MISSION_STATE_ACTIVE if c.armed and c.mode == "MISSION" else dialect.MISSION_STATE_PAUSED)


def mission_current(v: TelemetrySource) -> Fields:
    total, current = len(v.commander.flight.plans.mission), v.commander.mission.current
    mode = 1 if v.commander.mode == "MISSION" else 2
    return (min(current, max(total - 1, 0)), total or 65535, mission_state(v), mode)


def autopilot_version(v: TelemetrySource) -> Fields:
    uid = int(v.parameters["MAV_SYS_ID"])
    return (
        CAPABILITIES, FLIGHT_SW_VERSION, FLIGHT_SW_VERSION, 0, 0, [0] * 8, [0] * 8, [0] * 8, VENDOR_ID, PRODUCT_ID,
        uid, [uid & 0xFF] + [0] * 17,
    )  # fmt: skip


def flight_information(v: TelemetrySource) -> Fields:
    return (boot_ms(v), 0, v.commander.takeoff_us, 0)


def rc_channels(v: TelemetrySource) -> Fields | None:
    """Return the sticks as RC channels: roll, pitch, throttle, yaw. None before the first MANUAL_CONTROL."""
    sticks = v.commander.flight.sticks
    if sticks.time_us < 0:
        return None
    axes = (sticks.right, sticks.forward, 2.0 * sticks.throttle - 1.0, sticks.yaw)
    pulses = [clamped(1500.0 + 500.0 * axis, 1000, 2000) for axis in axes]
    fresh = sticks.fresh(v.state.time_us, v.parameters["COM_RC_LOSS_T"])
    return (boot_ms(v), 4, *pulses, *[65535] * 14, 100 if fresh else 0)


def available_modes_monitor(v: TelemetrySource) -> Fields:
    return (0,)  # the list of modes never changes


def system_time(v: TelemetrySource) -> Fields:
    """Return SYSTEM_TIME: the time of the GPS receiver, 0 before the first 3-D fix."""
    is_set = v.state.origin_set or int(v.state.sensors["gps_fix_type"]) >= 3
    return (CALENDAR_START_US + v.state.time_us if is_set else 0, boot_ms(v))


def ping(v: TelemetrySource) -> Fields:
    return (v.state.time_us, v.state.time_us // 1_000_000 & 0xFFFFFFFF, 0, 0)


def timesync(v: TelemetrySource) -> Fields:
    return (0, v.state.time_us * 1000)


def of_gimbal(make: Callable[[GimbalManager, int], Fields]) -> Maker:
    """Return a maker of a gimbal's message, which has no data if the camera is fixed."""
    return lambda v: make(v.gimbal, boot_ms(v)) if v.gimbal else None
