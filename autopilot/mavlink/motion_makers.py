"""Makers of the telemetry messages about position, motion, setpoints and raw sensor samples.

Each maker returns the fields of one message, or None if the data are not valid or the sensor has no sample.
"""

import math

from autopilot.estimator.estimated_state import EstimatedState
from autopilot.mavlink.status_makers import TelemetrySource, boot_ms, heading_cdeg
from autopilot.records import HEADING_TEST, HEIGHT_TEST, KIND_TRAJECTORY, POSITION_TEST, VELOCITY_TEST
from foundation.atmosphere import pressure_altitude
from foundation.frames import GRAVITY, rotate_inverse
from foundation.mavlink import dialect
from foundation.sensors import RANGE_M
from foundation.wire import Fields, clamped, int16, int32

NAN = math.nan
COVARIANCE_DIAGONAL = (0, 6, 11, 15, 18, 20)  # indices of the diagonal in the upper triangle of a 6x6 matrix


def attitude(v: TelemetrySource) -> Fields | None:
    s = v.state
    return (boot_ms(v), *s.euler, *s.rates_frd) if s.attitude_valid else None


def attitude_quaternion(v: TelemetrySource) -> Fields | None:
    s = v.state
    return (boot_ms(v), *s.attitude, *s.rates_frd) if s.attitude_valid else None


def local_position_ned(v: TelemetrySource) -> Fields | None:
    s = v.state
    return (boot_ms(v), *s.position_ned, *s.velocity_ned) if s.position_valid or s.altitude_valid else None


def global_position_int(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not s.global_valid:
        return None
    lat, lon, alt = s.geodetic(s.position_ned)
    home = v.commander.flight.home
    relative = alt - home.alt_m if home is not None else -s.position_ned[2]
    vn, ve, vd = s.velocity_ned
    return (
        boot_ms(v), int32(lat * 1e7), int32(lon * 1e7), int32(alt * 1e3), int32(relative * 1e3),
        int16(vn * 100.0), int16(ve * 100.0), int16(vd * 100.0), heading_cdeg(v),
    )  # fmt: skip


def gps_global_origin(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not s.origin_set:
        return None
    return (int32(s.origin_lat_deg * 1e7), int32(s.origin_lon_deg * 1e7), int32(s.origin_alt_m * 1e3), s.time_us)


def home_position(v: TelemetrySource) -> Fields | None:
    home = v.commander.flight.home
    if home is None:
        return None
    q = [math.cos(0.5 * home.yaw), 0.0, 0.0, math.sin(0.5 * home.yaw)]
    return (
        int32(home.lat_deg * 1e7), int32(home.lon_deg * 1e7), int32(home.alt_m * 1e3), *home.position_ned, q,
        0.0, 0.0, 0.0, v.state.time_us,
    )  # fmt: skip


def altitude(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not s.altitude_valid:
        return None
    up = -s.position_ned[2]
    amsl = s.origin_alt_m + up if s.origin_set else NAN
    home = v.commander.flight.home
    clearance = s.range_m()
    return (s.time_us, amsl, amsl, up, up + home.position_ned[2] if home else up, amsl - clearance, clearance)


def vfr_hud(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not s.altitude_valid:
        return None
    speed = math.hypot(s.velocity_ned[0], s.velocity_ned[1])
    return (
        0.0, speed, round(math.degrees(s.yaw)) % 360, clamped(s.thrust_setpoint * 100.0, 0, 100),
        s.origin_alt_m - s.position_ned[2], -s.velocity_ned[2],
    )  # fmt: skip


def _diagonal(first: float, second: float, third: float, fourth: float) -> list[float]:
    row = [0.0] * 21
    for place, sigma in zip(COVARIANCE_DIAGONAL, (first, first, second, third, third, fourth), strict=True):
        row[place] = sigma * sigma
    return row


def odometry(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not (s.position_valid and s.attitude_valid):
        return None
    return (
        s.time_us, dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD, *s.position_ned, list(s.attitude),
        *rotate_inverse(s.attitude, s.velocity_ned), *s.rates_frd,
        _diagonal(s.position_std_h, s.position_std_v, s.tilt_std, s.yaw_std),
        _diagonal(s.velocity_std_h, s.velocity_std_v, 0.0, 0.0), s.resets % 256,
        dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT, 100,
    )  # fmt: skip


def estimator_flags(s: EstimatedState) -> int:
    """Return ESTIMATOR_STATUS_FLAGS."""
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
    return flags if s.velocity_valid else flags | 0x80


def estimator_status(v: TelemetrySource) -> Fields:
    s = v.state
    return (
        s.time_us, estimator_flags(s),
        s.innovation_over_gate(VELOCITY_TEST, 3), s.innovation_over_gate(POSITION_TEST, 2),
        s.innovation_over_gate(HEIGHT_TEST), s.innovation_over_gate(HEADING_TEST), 0.0, 0.0,
        s.position_std_h, s.position_std_v,
    )  # fmt: skip


def attitude_target(v: TelemetrySource) -> Fields | None:
    s = v.state
    if not v.commander.armed:
        return None
    return (boot_ms(v), 0, list(s.attitude_setpoint), *s.rates_setpoint, s.thrust_setpoint)


def position_target_local_ned(v: TelemetrySource) -> Fields | None:
    d = v.commander.passed
    if d.kind != KIND_TRAJECTORY:
        return None
    fields = (*d.position_ned, *d.velocity_ned, *d.acceleration_ned)
    mask = sum(1 << bit for bit, value in enumerate(fields) if not math.isfinite(value))
    mask |= (0 if math.isfinite(d.yaw) else 0x400) | (0 if math.isfinite(d.yaw_rate) else 0x800)
    return (boot_ms(v), dialect.MAV_FRAME_LOCAL_NED, mask, *fields, d.yaw, d.yaw_rate)


def _pulses(v: TelemetrySource) -> list[int]:
    """Return the length (µs) of the pulse to each rotor; empty without an ACTUATORS record."""
    if v.actuators is None:
        return []
    armed = int(v.actuators["armed"])
    commands = v.actuators["command"].tolist()[: len(v.airframe.rotors)]
    return [clamped(1000.0 + 1000.0 * u, 900, 2000) if armed else 900 for u in commands]


def servo_output_raw(v: TelemetrySource) -> Fields | None:
    pulses = _pulses(v)
    if not pulses:
        return None
    padded = pulses + [0] * (8 - len(pulses))
    return (v.state.time_us & 0xFFFFFFFF, 0, *padded)


def actuator_output_status(v: TelemetrySource) -> Fields | None:
    pulses = _pulses(v)
    if not pulses:
        return None
    padded = pulses + [0] * (32 - len(pulses))
    return (v.state.time_us, len(pulses), padded)


def orbit_execution_status(v: TelemetrySource) -> Fields | None:
    c = v.commander
    if c.mode != "ORBIT" or c.orbit.centre is None:
        return None
    lat, lon, alt = v.state.geodetic(c.orbit.centre)
    return (
        v.state.time_us, math.copysign(c.orbit.radius, c.orbit.speed), dialect.MAV_FRAME_GLOBAL,
        int32(lat * 1e7), int32(lon * 1e7), alt,
    )  # fmt: skip


def gps_raw_int(v: TelemetrySource) -> Fields | None:
    g = v.state.sensors
    if not int(g["gps_time_us"]):
        return None
    vn, ve, _ = (float(x) for x in g["gps_velocity_ned"])
    eph, epv, alt = float(g["gps_eph_m"]), float(g["gps_epv_m"]), int32(float(g["gps_alt_m"]) * 1e3)
    return (
        int(g["gps_time_us"]), int(g["gps_fix_type"]),
        int32(float(g["gps_lat_deg"]) * 1e7), int32(float(g["gps_lon_deg"]) * 1e7), alt,
        clamped(eph * 100.0, 0, 65534, 65535), clamped(epv * 100.0, 0, 65534, 65535),
        clamped(math.hypot(vn, ve) * 100.0, 0, 65534, 65535),
        round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000, clamped(float(g["gps_satellites"]), 0, 254, 255),
        alt, clamped(eph * 1e3, 0, 1 << 31), clamped(epv * 1e3, 0, 1 << 31),
        clamped(float(g["gps_speed_accuracy"]) * 1e3, 0, 1 << 31),
    )  # fmt: skip


def highres_imu(v: TelemetrySource) -> Fields | None:
    r = v.state.sensors
    if not int(r["imu_time_us"]):
        return None
    pressure = float(r["pressure_hpa"])
    return (
        int(r["imu_time_us"]), *r["accel_frd"].tolist(), *r["gyro_frd"].tolist(), *r["mag_frd"].tolist(),
        pressure, 0.0, pressure_altitude(pressure) if pressure > 0.0 else NAN, float(r["temperature_c"]), 0x1BFF,
    )  # fmt: skip


def scaled_imu(v: TelemetrySource) -> Fields | None:
    r = v.state.sensors
    if not int(r["imu_time_us"]):
        return None
    accel_mg = [int16(a * 1e3 / GRAVITY) for a in r["accel_frd"].tolist()]
    gyro_mrad, mag_mgauss = ([int16(x * 1e3) for x in r[name].tolist()] for name in ("gyro_frd", "mag_frd"))
    return (boot_ms(v), *accel_mg, *gyro_mrad, *mag_mgauss, int16(float(r["temperature_c"]) * 100.0))


def distance_sensor(v: TelemetrySource) -> Fields | None:
    distance = v.state.range_m()
    if not math.isfinite(distance):
        return None
    return (
        boot_ms(v), *(round(100.0 * limit_m) for limit_m in RANGE_M), clamped(distance * 100.0, 0, 65535),
        dialect.MAV_DISTANCE_SENSOR_LASER, 0, dialect.MAV_SENSOR_ROTATION_PITCH_270, 255,
    )  # fmt: skip


def scaled_pressure(v: TelemetrySource) -> Fields | None:
    r = v.state.sensors
    if not int(r["baro_time_us"]):
        return None
    return (boot_ms(v), float(r["pressure_hpa"]), 0.0, int16(float(r["temperature_c"]) * 100.0))


def vibration(v: TelemetrySource) -> Fields:
    # order of the fields as in PX4: coning (not measured here), gyro, accelerometer
    s = v.state
    return (s.time_us, 0.0, s.vibration_gyro, s.vibration_accel, *s.clipped)
