"""One function per telemetry message: reads the vehicle, returns the message, or None while there is nothing to tell.

Units and frames are those of the MAVLink message definitions; times are the vehicle's.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from autopilot.arming import sensor_health
from autopilot.commander import Commander
from autopilot.parameters import Parameters
from autopilot.records import KIND_TRAJECTORY
from autopilot.vehicle_state import VehicleState
from dronecats.border.airframe import Airframe
from dronecats.border.frames import rotate_inverse
from dronecats.border.mavlink import MODES, PX4_AUTOPILOT, dialect

Message = dialect.MAVLink_message
NAN = math.nan
UNKNOWN_COVARIANCE = [NAN] + [0.0] * 20
ONE_COVARIANCE_ROW = (0, 6, 11, 15, 18, 20)  # diagonal of the upper triangle of a 6x6 matrix

SENSOR_GYRO, SENSOR_ACCEL, SENSOR_MAG = 0x1, 0x2, 0x4
SENSOR_PRESSURE, SENSOR_GPS, SENSOR_RANGE = 0x8, 0x20, 0x100
CONTROL_BITS = 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000  # rate, attitude, yaw, altitude, position, motors
SENSOR_RC, SENSOR_FENCE, SENSOR_AHRS = 0x10000, 0x100000, 0x200000
SENSOR_BATTERY, PREARM_CHECK, EXTENSION_USED = 0x2000000, 0x10000000, 0x80000000

# PX4 1.15: the version whose behaviour was measured and is followed here, type 255 = release
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

_MANUAL_MODES = frozenset({"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED"})
_STANDARD_MODES = {"POSCTL": 1, "ORBIT": 2, "ALTCTL": 4, "RETURN": 5, "MISSION": 6, "LAND": 7, "TAKEOFF": 8}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What the makers read."""

    airframe: Airframe
    state: VehicleState
    commander: Commander
    parameters: Parameters
    actuators: Any | None  # ACTUATORS record, None when nobody shares it


def standard_mode(mode: str) -> int:
    """Return the MAV_STANDARD_MODE of a mode name, 0 when it has none."""
    return _STANDARD_MODES.get(mode, 0)


def whole(value: float, low: int, high: int, unknown: int = 0) -> int:
    """Return the value rounded and clamped into an integer field; `unknown` when it is not finite."""
    if not math.isfinite(value):
        return unknown
    return min(max(round(value), low), high)


def _i16(value: float) -> int:
    return whole(value, -32768, 32767)


def _i32(value: float) -> int:
    return whole(value, -(1 << 31), (1 << 31) - 1)


def _ms(v: Vehicle) -> int:
    return v.state.time_us // 1000 & 0xFFFFFFFF


def _heading_cdeg(v: Vehicle) -> int:
    if not v.state.attitude_valid:
        return 65535
    return round(math.degrees(v.state.yaw) * 100.0) % 36000


def system_status(v: Vehicle) -> int:
    """Return MAV_STATE: 0 not ready, 3 ready, 4 armed, 5 failsafe, 8 terminated (as measured on PX4)."""
    c = v.commander
    if c.armed and c.mode == "TERMINATION":
        return int(dialect.MAV_STATE_FLIGHT_TERMINATION)
    if c.armed:
        return int(dialect.MAV_STATE_CRITICAL if c.in_failsafe else dialect.MAV_STATE_ACTIVE)
    return int(dialect.MAV_STATE_UNINIT if c.arming_failures() else dialect.MAV_STATE_STANDBY)


def heartbeat(v: Vehicle) -> Message:
    c = v.commander
    base = 1 | (128 if c.armed else 0)
    if c.mode in _MANUAL_MODES:
        base |= 64 | (0 if c.mode in ("MANUAL", "ACRO") else 16)
    elif c.mode == "OFFBOARD":
        base |= 16
    else:
        base |= 4 | 8 | 16
    return dialect.MAVLink_heartbeat_message(
        v.airframe.mav_type, PX4_AUTOPILOT, base, c.custom_mode, system_status(v), 3
    )


def sys_status(v: Vehicle) -> Message:
    health, s = sensor_health(v.state), v.state.sensors
    present = SENSOR_GYRO | SENSOR_ACCEL | SENSOR_MAG | SENSOR_PRESSURE | SENSOR_GPS | CONTROL_BITS | SENSOR_AHRS
    present |= SENSOR_BATTERY | PREARM_CHECK | EXTENSION_USED | SENSOR_FENCE
    if int(s["range_time_us"]):
        present |= SENSOR_RANGE
    if v.commander.flight.sticks.time_us >= 0:
        present |= SENSOR_RC
    good = EXTENSION_USED | CONTROL_BITS
    if v.commander.failsafe.cause != "geofence breached":
        good |= SENSOR_FENCE
    if health.imu:
        good |= SENSOR_GYRO | SENSOR_ACCEL
    if health.mag:
        good |= SENSOR_MAG
    if health.baro:
        good |= SENSOR_PRESSURE
    if health.gps and v.state.global_valid:
        good |= SENSOR_GPS
    if health.range:
        good |= SENSOR_RANGE
    if v.state.attitude_valid:
        good |= SENSOR_AHRS
    if health.battery and float(s["battery_remaining"]) > v.parameters["BAT_CRIT_THR"]:
        good |= SENSOR_BATTERY
    if v.commander.flight.sticks.fresh(v.state.time_us, v.parameters["COM_RC_LOSS_T"]):
        good |= SENSOR_RC
    if v.commander.armed or not v.commander.arming_failures():
        good |= PREARM_CHECK
    good &= present
    known = health.battery
    return dialect.MAVLink_sys_status_message(
        present, present, good, 200,
        whole(float(s["battery_voltage"]) * 1000.0, 0, 65534, 65535) if known else 65535,
        whole(float(s["battery_current"]) * 100.0, 0, 32767, -1) if known else -1,
        whole(math.ceil(float(s["battery_remaining"]) * 100.0), 0, 100, -1) if known else -1,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def attitude(v: Vehicle) -> Message | None:
    s = v.state
    return dialect.MAVLink_attitude_message(_ms(v), *s.euler, *s.rates_frd) if s.attitude_valid else None


def attitude_quaternion(v: Vehicle) -> Message | None:
    s = v.state
    if not s.attitude_valid:
        return None
    return dialect.MAVLink_attitude_quaternion_message(_ms(v), *s.attitude, *s.rates_frd)


def local_position_ned(v: Vehicle) -> Message | None:
    s = v.state
    if not (s.position_valid or s.altitude_valid):
        return None
    return dialect.MAVLink_local_position_ned_message(_ms(v), *s.position_ned, *s.velocity_ned)


def global_position_int(v: Vehicle) -> Message | None:
    s = v.state
    if not s.global_valid:
        return None
    lat, lon, alt = s.geodetic(s.position_ned)
    home = v.commander.flight.home
    relative = alt - home.alt_m if home is not None else -s.position_ned[2]
    vn, ve, vd = s.velocity_ned
    return dialect.MAVLink_global_position_int_message(
        _ms(v), _i32(lat * 1e7), _i32(lon * 1e7), _i32(alt * 1e3), _i32(relative * 1e3),
        _i16(vn * 100.0), _i16(ve * 100.0), _i16(vd * 100.0), _heading_cdeg(v),
    )  # fmt: skip


def gps_global_origin(v: Vehicle) -> Message | None:
    s = v.state
    if not s.origin_set:
        return None
    return dialect.MAVLink_gps_global_origin_message(
        _i32(s.origin_lat_deg * 1e7), _i32(s.origin_lon_deg * 1e7), _i32(s.origin_alt_m * 1e3), s.time_us
    )


def gps_raw_int(v: Vehicle) -> Message | None:
    g = v.state.sensors
    if not int(g["gps_time_us"]):
        return None
    vn, ve, _ = (float(x) for x in g["gps_velocity_ned"])
    eph, epv, alt = float(g["gps_eph_m"]), float(g["gps_epv_m"]), _i32(float(g["gps_alt_m"]) * 1e3)
    return dialect.MAVLink_gps_raw_int_message(
        int(g["gps_time_us"]), int(g["gps_fix_type"]),
        _i32(float(g["gps_lat_deg"]) * 1e7), _i32(float(g["gps_lon_deg"]) * 1e7), alt,
        whole(eph * 100.0, 0, 65534, 65535), whole(epv * 100.0, 0, 65534, 65535),
        whole(math.hypot(vn, ve) * 100.0, 0, 65534, 65535),
        round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000, whole(float(g["gps_satellites"]), 0, 254, 255),
        alt, whole(eph * 1e3, 0, 1 << 31), whole(epv * 1e3, 0, 1 << 31),
        whole(float(g["gps_speed_accuracy"]) * 1e3, 0, 1 << 31),
    )  # fmt: skip


def home_position(v: Vehicle) -> Message | None:
    home = v.commander.flight.home
    if home is None:
        return None
    q = [math.cos(0.5 * home.yaw), 0.0, 0.0, math.sin(0.5 * home.yaw)]
    return dialect.MAVLink_home_position_message(
        _i32(home.lat_deg * 1e7), _i32(home.lon_deg * 1e7), _i32(home.alt_m * 1e3), *home.position_ned, q,
        0.0, 0.0, 0.0, v.state.time_us,
    )  # fmt: skip


def extended_sys_state(v: Vehicle) -> Message:
    return dialect.MAVLink_extended_sys_state_message(0, v.commander.landed_state)


def battery_status(v: Vehicle) -> Message | None:
    b = v.state.sensors
    if not int(b["battery_time_us"]):
        return None
    pack, remaining, p = v.airframe.battery, float(b["battery_remaining"]), v.parameters
    cells = min(pack.cells, 10)
    per_cell = whole(float(b["battery_voltage"]) * 1000.0 / cells, 0, 65534, 65535)
    if remaining < p["BAT_EMERGEN_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY
    elif remaining < p["BAT_CRIT_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL
    elif remaining < p["BAT_LOW_THR"]:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_LOW
    else:
        charge = dialect.MAV_BATTERY_CHARGE_STATE_OK
    return dialect.MAVLink_battery_status_message(
        0, dialect.MAV_BATTERY_FUNCTION_ALL, dialect.MAV_BATTERY_TYPE_LIPO, 32767,
        [per_cell] * cells + [65535] * (10 - cells), whole(float(b["battery_current"]) * 100.0, 0, 32767, -1),
        whole((1.0 - remaining) * pack.capacity_ah * 1000.0, 0, 1 << 30, -1), -1,
        whole(remaining * 100.0, 0, 100, -1), 0, charge,
    )  # fmt: skip


def altitude(v: Vehicle) -> Message | None:
    s = v.state
    if not s.altitude_valid:
        return None
    up = -s.position_ned[2]
    amsl = s.origin_alt_m + up if s.origin_set else NAN
    home = v.commander.flight.home
    clearance = s.range_m()
    return dialect.MAVLink_altitude_message(
        s.time_us, amsl, amsl, up, up + home.position_ned[2] if home else up, amsl - clearance, clearance
    )


def vfr_hud(v: Vehicle) -> Message | None:
    s = v.state
    if not s.altitude_valid:
        return None
    speed = math.hypot(s.velocity_ned[0], s.velocity_ned[1])
    return dialect.MAVLink_vfr_hud_message(
        0.0, speed, round(math.degrees(s.yaw)) % 360, whole(s.thrust_setpoint * 100.0, 0, 100),
        s.origin_alt_m - s.position_ned[2], -s.velocity_ned[2],
    )  # fmt: skip


def _pressure_altitude(pressure_hpa: float) -> float:
    """Return m in the International Standard Atmosphere (ISO 2533 troposphere)."""
    if not pressure_hpa > 0.0:
        return NAN
    return float(288.15 / 0.0065 * (1.0 - (pressure_hpa / 1013.25) ** 0.190263))


def highres_imu(v: Vehicle) -> Message | None:
    r = v.state.sensors
    if not int(r["imu_time_us"]):
        return None
    pressure = float(r["pressure_hpa"])
    return dialect.MAVLink_highres_imu_message(
        int(r["imu_time_us"]), *r["accel_frd"].tolist(), *r["gyro_frd"].tolist(), *r["mag_frd"].tolist(),
        pressure, 0.0, _pressure_altitude(pressure), float(r["temperature_c"]), 0x1BFF,
    )  # fmt: skip


def _diagonal(first: float, second: float, third: float, fourth: float) -> list[float]:
    row = [0.0] * 21
    for place, sigma in zip(ONE_COVARIANCE_ROW, (first, first, second, third, third, fourth), strict=True):
        row[place] = sigma * sigma
    return row


def odometry(v: Vehicle) -> Message | None:
    s = v.state
    if not (s.position_valid and s.attitude_valid):
        return None
    return dialect.MAVLink_odometry_message(
        s.time_us, dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD, *s.position_ned, list(s.attitude),
        *rotate_inverse(s.attitude, s.velocity_ned), *s.rates_frd,
        _diagonal(s.position_std_h, s.position_std_v, s.tilt_std, s.yaw_std),
        _diagonal(s.velocity_std_h, s.velocity_std_v, 0.0, 0.0), 0, dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT, 100,
    )  # fmt: skip


def estimator_status(v: Vehicle) -> Message:
    s = v.state
    flags = 0x1 if s.attitude_valid else 0
    if s.velocity_valid:
        flags |= 0x2 | 0x4
    if s.position_valid:
        flags |= 0x8 | 0x100
    if s.global_valid:
        flags |= 0x10 | 0x200
    if s.altitude_valid:
        flags |= 0x20
    if math.isfinite(s.range_m()):
        flags |= 0x40
    if not s.velocity_valid:
        flags |= 0x80
    return dialect.MAVLink_estimator_status_message(
        s.time_us, flags, s.ratio_gps_velocity, s.ratio_gps_position, s.ratio_baro, s.ratio_mag, 0.0, 0.0,
        s.position_std_h, s.position_std_v,
    )  # fmt: skip


def system_time(v: Vehicle) -> Message:
    # the vehicle carries no calendar: 0 = unknown
    return dialect.MAVLink_system_time_message(0, _ms(v))


def current_mode(v: Vehicle) -> Message:
    c = v.commander
    return dialect.MAVLink_current_mode_message(standard_mode(c.mode), c.custom_mode, MODES[c.intended].custom_mode)


def attitude_target(v: Vehicle) -> Message | None:
    s = v.state
    if not v.commander.armed:
        return None
    return dialect.MAVLink_attitude_target_message(
        _ms(v), 0, list(s.attitude_setpoint), *s.rates_setpoint, s.thrust_setpoint
    )


def position_target_local_ned(v: Vehicle) -> Message | None:
    d = v.commander.passed
    if d.kind != KIND_TRAJECTORY:
        return None
    fields = (*d.position_ned, *d.velocity_ned, *d.acceleration_ned)
    mask = sum(1 << bit for bit, value in enumerate(fields) if not math.isfinite(value))
    mask |= (0 if math.isfinite(d.yaw) else 0x400) | (0 if math.isfinite(d.yaw_rate) else 0x800)
    return dialect.MAVLink_position_target_local_ned_message(
        _ms(v), dialect.MAV_FRAME_LOCAL_NED, mask, *fields, d.yaw, d.yaw_rate
    )


def servo_output_raw(v: Vehicle) -> Message | None:
    if v.actuators is None:
        return None
    armed = int(v.actuators["armed"])
    commands = v.actuators["command"].tolist()[: len(v.airframe.rotors)]
    pulses = [whole(1000.0 + 1000.0 * u, 900, 2000) if armed else 900 for u in commands] + [0] * (8 - len(commands))
    return dialect.MAVLink_servo_output_raw_message(v.state.time_us & 0xFFFFFFFF, 0, *pulses)


def distance_sensor(v: Vehicle) -> Message | None:
    distance = v.state.range_m()
    if not math.isfinite(distance):
        return None
    return dialect.MAVLink_distance_sensor_message(
        _ms(v), 10, 5000, whole(distance * 100.0, 0, 65535), dialect.MAV_DISTANCE_SENSOR_LASER, 0,
        dialect.MAV_SENSOR_ROTATION_PITCH_270, 255,
    )  # fmt: skip


def scaled_pressure(v: Vehicle) -> Message | None:
    r = v.state.sensors
    if not int(r["baro_time_us"]):
        return None
    return dialect.MAVLink_scaled_pressure_message(
        _ms(v), float(r["pressure_hpa"]), 0.0, _i16(float(r["temperature_c"]) * 100.0)
    )


def vibration(v: Vehicle) -> Message:
    return dialect.MAVLink_vibration_message(v.state.time_us, 0.0, 0.0, 0.0, 0, 0, 0)


def mission_current(v: Vehicle) -> Message:
    return dialect.MAVLink_mission_current_message(0, 0, 1 if not v.commander.mission_loaded else 2)


def orbit_execution_status(v: Vehicle) -> Message | None:
    c = v.commander
    if c.mode != "ORBIT" or c.orbit.centre is None:
        return None
    lat, lon, alt = v.state.geodetic(c.orbit.centre)
    return dialect.MAVLink_orbit_execution_status_message(
        v.state.time_us, math.copysign(c.orbit.radius, c.orbit.speed), dialect.MAV_FRAME_GLOBAL,
        _i32(lat * 1e7), _i32(lon * 1e7), alt,
    )  # fmt: skip


def autopilot_version(v: Vehicle) -> Message:
    uid = int(v.parameters["MAV_SYS_ID"])
    return dialect.MAVLink_autopilot_version_message(
        CAPABILITIES, FLIGHT_SW_VERSION, FLIGHT_SW_VERSION, 0, 0, [0] * 8, [0] * 8, [0] * 8, VENDOR_ID, PRODUCT_ID,
        uid, [uid & 0xFF] + [0] * 17,
    )  # fmt: skip


def flight_information(v: Vehicle) -> Message:
    return dialect.MAVLink_flight_information_message(_ms(v), 0, v.commander.takeoff_us, 0)


def ping(v: Vehicle) -> Message:
    return dialect.MAVLink_ping_message(v.state.time_us, v.state.time_us // 1_000_000 & 0xFFFFFFFF, 0, 0)


def timesync(v: Vehicle) -> Message:
    return dialect.MAVLink_timesync_message(0, v.state.time_us * 1000)


Maker = Callable[[Vehicle], Message | None]
