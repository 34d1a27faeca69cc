"""Messages with raw sensor samples. Each maker returns None while its sensor is silent."""

import math

from autopilot.mavlink.telemetry_source import Message, TelemetrySource, boot_ms, int16, int32, whole
from foundation.frames import GRAVITY
from foundation.mavlink import dialect


def gps_raw_int(v: TelemetrySource) -> Message | None:
    g = v.state.sensors
    if not int(g["gps_time_us"]):
        return None
    vn, ve, _ = (float(x) for x in g["gps_velocity_ned"])
    eph, epv, alt = float(g["gps_eph_m"]), float(g["gps_epv_m"]), int32(float(g["gps_alt_m"]) * 1e3)
    return dialect.MAVLink_gps_raw_int_message(
        int(g["gps_time_us"]), int(g["gps_fix_type"]),
        int32(float(g["gps_lat_deg"]) * 1e7), int32(float(g["gps_lon_deg"]) * 1e7), alt,
        whole(eph * 100.0, 0, 65534, 65535), whole(epv * 100.0, 0, 65534, 65535),
        whole(math.hypot(vn, ve) * 100.0, 0, 65534, 65535),
        round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000, whole(float(g["gps_satellites"]), 0, 254, 255),
        alt, whole(eph * 1e3, 0, 1 << 31), whole(epv * 1e3, 0, 1 << 31),
        whole(float(g["gps_speed_accuracy"]) * 1e3, 0, 1 << 31),
    )  # fmt: skip


def _pressure_altitude(pressure_hpa: float) -> float:
    """Return m in the International Standard Atmosphere (ISO 2533 troposphere)."""
    if not pressure_hpa > 0.0:
        return math.nan
    return float(288.15 / 0.0065 * (1.0 - (pressure_hpa / 1013.25) ** 0.190263))


def highres_imu(v: TelemetrySource) -> Message | None:
    r = v.state.sensors
    if not int(r["imu_time_us"]):
        return None
    pressure = float(r["pressure_hpa"])
    return dialect.MAVLink_highres_imu_message(
        int(r["imu_time_us"]), *r["accel_frd"].tolist(), *r["gyro_frd"].tolist(), *r["mag_frd"].tolist(),
        pressure, 0.0, _pressure_altitude(pressure), float(r["temperature_c"]), 0x1BFF,
    )  # fmt: skip


def scaled_imu(v: TelemetrySource) -> Message | None:
    r = v.state.sensors
    if not int(r["imu_time_us"]):
        return None
    accel_mg = [int16(a * 1e3 / GRAVITY) for a in r["accel_frd"].tolist()]
    gyro_mrad, mag_mgauss = ([int16(x * 1e3) for x in r[name].tolist()] for name in ("gyro_frd", "mag_frd"))
    return dialect.MAVLink_scaled_imu_message(
        boot_ms(v), *accel_mg, *gyro_mrad, *mag_mgauss, int16(float(r["temperature_c"]) * 100.0)
    )


def distance_sensor(v: TelemetrySource) -> Message | None:
    distance = v.state.range_m()
    if not math.isfinite(distance):
        return None
    return dialect.MAVLink_distance_sensor_message(
        boot_ms(v), 10, 5000, whole(distance * 100.0, 0, 65535), dialect.MAV_DISTANCE_SENSOR_LASER, 0,
        dialect.MAV_SENSOR_ROTATION_PITCH_270, 255,
    )  # fmt: skip


def scaled_pressure(v: TelemetrySource) -> Message | None:
    r = v.state.sensors
    if not int(r["baro_time_us"]):
        return None
    return dialect.MAVLink_scaled_pressure_message(
        boot_ms(v), float(r["pressure_hpa"]), 0.0, int16(float(r["temperature_c"]) * 100.0)
    )


def vibration(v: TelemetrySource) -> Message:
    # as PX4 fills it: coning (not measured here), gyro, accelerometer
    return dialect.MAVLink_vibration_message(
        v.state.time_us, 0.0, v.vibration.gyro, v.vibration.accel, *v.vibration.clipped
    )
