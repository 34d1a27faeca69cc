"""PX4's simulator interface as pure functions: sensor records into HIL messages, PX4's answers into rotor commands.

PX4 takes a group of HIL_SENSOR only when every bit of it is set. Specific forces are in m/s², rates in rad/s, fields in
gauss, pressures in hPa, vectors in FRD; HIL_GPS carries centimetres and 1e-7 degrees. Source: PX4 SimulatorMavlink.cpp.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from foundation.mavlink import dialect
from foundation.sensors import MAX_ROTORS

ACCEL, GYRO, MAG, BARO = 0x7, 0x38, 0x1C0, 0x1A00  # groups of HIL_SENSOR.fields_updated
ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED
HIL_ENABLED = dialect.MAV_MODE_FLAG_HIL_ENABLED
SENSOR_BYTES = 74  # a HIL_SENSOR on the wire at most: MAVLink 2 leaves trailing zeros out, and id is 0
COURSE_UNKNOWN = 65535
COURSE_FROM = 0.3  # m/s, below which a receiver has no course over ground to tell


@dataclass(frozen=True, slots=True)
class Told:
    """Times (µs, vehicle clock) of the newest samples that the autopilot has been sent; 0: none yet."""

    imu_us: int = 0
    mag_us: int = 0
    baro_us: int = 0
    gps_us: int = 0


def sensor_message(sensors: Any, time_us: int, told: Told) -> dialect.MAVLink_hil_sensor_message:
    """Return HIL_SENSOR at `time_us` (µs, vehicle clock), with the groups marked that are newer than `told`.

    `sensors` is a record of `foundation.sensors.SENSORS`. With nothing new it still carries PX4's clock onward.
    """
    updated = 0
    if sensors["imu_time_us"] > told.imu_us:
        updated |= ACCEL | GYRO
    if sensors["mag_time_us"] > told.mag_us:
        updated |= MAG
    if sensors["baro_time_us"] > told.baro_us:
        updated |= BARO
    pressure_hpa = float(sensors["pressure_hpa"])
    return dialect.MAVLink_hil_sensor_message(
        time_us,
        *sensors["accel_frd"].tolist(),
        *sensors["gyro_frd"].tolist(),
        *sensors["mag_frd"].tolist(),
        pressure_hpa,
        0.0,
        pressure_altitude(pressure_hpa),
        float(sensors["temperature_c"]),
        updated,
        0,
    )


def gps_message(sensors: Any) -> dialect.MAVLink_hil_gps_message:
    """Return HIL_GPS of the newest fix, stamped with the time (µs, vehicle clock) at which it was valid."""
    north, east, down = sensors["gps_velocity_ned"].tolist()
    speed = math.hypot(north, east)
    course = math.degrees(math.atan2(east, north)) % 360.0
    return dialect.MAVLink_hil_gps_message(
        int(sensors["gps_time_us"]),
        int(sensors["gps_fix_type"]),
        round(float(sensors["gps_lat_deg"]) * 1e7),
        round(float(sensors["gps_lon_deg"]) * 1e7),
        round(float(sensors["gps_alt_m"]) * 1e3),
        _uint16(float(sensors["gps_eph_m"]) * 100),
        _uint16(float(sensors["gps_epv_m"]) * 100),
        _uint16(speed * 100),
        *(_int16(v * 100) for v in (north, east, down)),
        round(course * 100) % 36000 if speed >= COURSE_FROM else COURSE_UNKNOWN,
        int(sensors["gps_satellites"]),
        0,
        0,
    )


def told_now(sensors: Any) -> Told:
    """Return what the autopilot has been told once everything in `sensors` was sent."""
    return Told(
        int(sensors["imu_time_us"]),
        int(sensors["mag_time_us"]),
        int(sensors["baro_time_us"]),
        int(sensors["gps_time_us"]),
    )


def rotor_commands(controls: Sequence[float], rotors: int, idle: float) -> list[float]:
    """Return fractions of full rotor speed (MAX_ROTORS of them) for PX4's motor outputs 0 … 1.

    0 is the idle speed and 1 the full one, a straight line between, which is how PX4's own Gazebo bridge makes rotor
    speeds of this aircraft's outputs (SIM_GZ_EC_MIN, SIM_GZ_EC_MAX). Thrust grows with the square of the output, as
    behind a real motor controller, and THR_MDL_FAC stays 0. `idle`: the idle speed as a fraction of the full one. What
    is not a number idles.
    """
    used = [idle + (1.0 - idle) * min(max(u, 0.0), 1.0) if u == u else idle for u in controls[:rotors]]
    return used + [0.0] * (MAX_ROTORS - len(used))


def is_armed(message: dialect.MAVLink_message) -> bool:
    """Return whether the autopilot that sent this HIL_ACTUATOR_CONTROLS or HEARTBEAT is armed."""
    mode = message.mode if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS else message.base_mode
    return bool(mode & ARMED)


def pressure_altitude(pressure_hpa: float) -> float:
    """Return the altitude (m) at which the standard atmosphere has this pressure (hPa)."""
    return 44330.77 * (1.0 - math.pow(max(pressure_hpa, 0.0) / 1013.25, 0.190263))


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _uint16(value: float) -> int:
    return max(0, min(65534, round(value)))
