"""One table: message → rate on each kind of port → the function that makes it.

Rates (Hz) as measured on PX4 1.15; 0 = only on request. A stream sends at most one message per tick of the autopilot.
"""

from dataclasses import dataclass

from autopilot.mavlink import motion_makers as motion
from autopilot.mavlink import status_makers as status
from autopilot.mavlink.telemetry_source import Maker
from foundation.mavlink import dialect

PROFILES = ("onboard", "gcs", "minimal")


@dataclass(frozen=True, slots=True)
class Stream:
    """One telemetry message."""

    name: str
    onboard: float  # Hz, PX4's offboard link, 14540
    gcs: float  # Hz, PX4's ground station link, 14550
    make: Maker

    @property
    def message_id(self) -> int:
        return int(getattr(dialect, f"MAVLINK_MSG_ID_{self.name}"))

    def rate(self, profile: str) -> float:
        """Return the default rate (Hz) on a port of this profile."""
        if self.name == "HEARTBEAT":
            return 1.0
        return {"onboard": self.onboard, "gcs": self.gcs}.get(profile, 0.0)


TABLE: tuple[Stream, ...] = (
    Stream("HEARTBEAT", 1, 1, status.heartbeat),
    Stream("ATTITUDE", 100, 50, motion.attitude),
    Stream("ATTITUDE_QUATERNION", 50, 50, motion.attitude_quaternion),
    Stream("GLOBAL_POSITION_INT", 50, 50, motion.global_position_int),
    Stream("HIGHRES_IMU", 50, 0, motion.highres_imu),
    Stream("LOCAL_POSITION_NED", 30, 50, motion.local_position_ned),
    Stream("ODOMETRY", 30, 0, motion.odometry),
    Stream("ATTITUDE_TARGET", 10, 50, motion.attitude_target),
    Stream("POSITION_TARGET_LOCAL_NED", 10, 50, motion.position_target_local_ned),
    Stream("SERVO_OUTPUT_RAW", 10, 50, motion.servo_output_raw),
    Stream("ALTITUDE", 10, 1, motion.altitude),
    Stream("VFR_HUD", 10, 4, motion.vfr_hud),
    Stream("DISTANCE_SENSOR", 10, 0.5, motion.distance_sensor),
    Stream("TIMESYNC", 10, 0, status.timesync),
    Stream("GPS_RAW_INT", 8, 5, motion.gps_raw_int),
    Stream("SYS_STATUS", 5, 1, status.sys_status),
    Stream("EXTENDED_SYS_STATE", 5, 1, status.extended_sys_state),
    Stream("RC_CHANNELS", 20, 20, status.rc_channels),
    Stream("ORBIT_EXECUTION_STATUS", 5, 2, motion.orbit_execution_status),
    Stream("ESTIMATOR_STATUS", 1, 0.5, motion.estimator_status),
    Stream("GPS_GLOBAL_ORIGIN", 1, 1, motion.gps_global_origin),
    Stream("SYSTEM_TIME", 1, 0, status.system_time),
    Stream("SCALED_PRESSURE", 1, 1, motion.scaled_pressure),
    Stream("MISSION_CURRENT", 1, 1, status.mission_current),
    Stream("PING", 1, 0.1, status.ping),
    Stream("BATTERY_STATUS", 0.5, 0.5, status.battery_status),
    Stream("HOME_POSITION", 0.5, 0.5, motion.home_position),
    Stream("CURRENT_MODE", 0.5, 0.5, status.current_mode),
    Stream("VIBRATION", 0.5, 0.1, motion.vibration),
    Stream("AVAILABLE_MODES_MONITOR", 0.3, 0.3, status.available_modes_monitor),
    Stream("AUTOPILOT_VERSION", 0, 0, status.autopilot_version),
    Stream("FLIGHT_INFORMATION", 0, 0, status.flight_information),
    Stream("SCALED_IMU", 0, 0, motion.scaled_imu),
    Stream("ACTUATOR_OUTPUT_STATUS", 0, 0, motion.actuator_output_status),
)

BY_ID: dict[int, Stream] = {stream.message_id: stream for stream in TABLE}
BY_NAME: dict[str, Stream] = {stream.name: stream for stream in TABLE}
HEARTBEAT_ID = int(dialect.MAVLINK_MSG_ID_HEARTBEAT)

# REQUEST_DATA_STREAM groups (MAV_DATA_STREAM) of clients that predate SET_MESSAGE_INTERVAL
GROUPS: dict[int, tuple[str, ...]] = {
    dialect.MAV_DATA_STREAM_RAW_SENSORS: ("HIGHRES_IMU", "SCALED_PRESSURE", "GPS_RAW_INT"),
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: ("SYS_STATUS", "EXTENDED_SYS_STATE", "GPS_RAW_INT", "MISSION_CURRENT"),
    dialect.MAV_DATA_STREAM_POSITION: ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    dialect.MAV_DATA_STREAM_EXTRA1: ("ATTITUDE",),
    dialect.MAV_DATA_STREAM_EXTRA2: ("VFR_HUD",),
    dialect.MAV_DATA_STREAM_RAW_CONTROLLER: ("SERVO_OUTPUT_RAW", "ATTITUDE_TARGET"),
}
GROUPS[dialect.MAV_DATA_STREAM_ALL] = tuple(sorted({name for names in GROUPS.values() for name in names}))
