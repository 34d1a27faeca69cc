"""What a vehicle last said of itself, as one frozen state, and the vehicle's clock."""

from typing import NamedTuple

from dronecats.border.frames import Vec3
from dronecats.border.mavlink import dialect, mode_name

WRAP_MS = 1 << 32  # time_boot_ms is a uint32


class VehicleClock:
    """µs since boot from time_boot_ms, robust against its wrap after 49 days; never runs backwards but for a reboot."""

    def __init__(self) -> None:
        self.time_us = 0
        self.reboots = 0
        self._wraps = 0
        self._last_ms: int | None = None

    def see(self, time_boot_ms: int) -> None:
        """Take note of a time stamp."""
        if self._last_ms is not None and time_boot_ms < self._last_ms:
            back_ms = self._last_ms - time_boot_ms
            if back_ms > WRAP_MS // 2:
                self._wraps += 1
            elif back_ms > 5000 and time_boot_ms < 60_000:
                self.reboots += 1
                self.time_us, self._wraps = 0, 0
            else:
                return  # a late packet
        self._last_ms = time_boot_ms
        self.time_us = max(self.time_us, (time_boot_ms + self._wraps * WRAP_MS) * 1000)


class VehicleState(NamedTuple):
    """The newest of everything; None where nothing has been heard yet."""

    armed: bool = False
    mode: str = ""
    mode_us: int = 0  # µs, vehicle clock when the mode was last told
    heartbeat_us: int = 0  # µs, vehicle clock at the last heartbeat
    system_status: int = 0
    position_ned: Vec3 | None = None  # m, local frame of the autopilot
    position_us: int = 0  # µs, vehicle clock of the position
    velocity_ned: Vec3 | None = None  # m/s
    euler: Vec3 | None = None  # rad, roll pitch yaw
    landed: bool | None = None
    healthy: bool = False  # ready to arm: the pre-arm check and the sensors that flying needs
    origin: Vec3 | None = None  # lat °, lon °, alt m of the local frame
    home_ned: Vec3 | None = None  # m, home in the local frame
    battery_remaining: float | None = None  # 0 … 1
    battery_voltage: float | None = None  # V
    gps_fix: int | None = None
    status_text: str = ""  # the newest STATUSTEXT of severity warning or worse


PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
SENSORS = 0x1 | 0x2 | 0x4  # gyro, accelerometer, magnetometer


TOLD = frozenset(  # the messages that tell something of the state
    {
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE,
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
        dialect.MAVLINK_MSG_ID_HOME_POSITION,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
    }
)


def update(state: VehicleState, message: dialect.MAVLink_message, time_us: int = 0) -> VehicleState:
    """Return the state after a message of the autopilot component, heard at `time_us` of the vehicle's clock."""
    match message.get_msgId():
        case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            return state._replace(
                position_ned=(message.x, message.y, message.z),
                velocity_ned=(message.vx, message.vy, message.vz),
                position_us=time_us,
            )
        case dialect.MAVLINK_MSG_ID_ATTITUDE:
            return state._replace(euler=(message.roll, message.pitch, message.yaw))
        case dialect.MAVLINK_MSG_ID_HEARTBEAT:
            return state._replace(
                armed=bool(message.base_mode & 128),
                mode=mode_name(message.custom_mode),
                mode_us=time_us,
                heartbeat_us=time_us,
                system_status=message.system_status,
            )
        case dialect.MAVLINK_MSG_ID_CURRENT_MODE:
            return state._replace(mode=mode_name(message.custom_mode), mode_us=time_us)
        case dialect.MAVLINK_MSG_ID_SYS_STATUS:
            health = message.onboard_control_sensors_health
            return state._replace(
                healthy=health & PREARM != 0 and health & SENSORS == SENSORS,
                battery_remaining=message.battery_remaining / 100 if message.battery_remaining >= 0 else None,
                battery_voltage=message.voltage_battery / 1000 if message.voltage_battery != 65535 else None,
            )
        case dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            landed = {1: True, 2: False, 3: False, 4: False}.get(message.landed_state)
            return state if landed is None else state._replace(landed=landed)
        case dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            origin = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
            return state._replace(origin=origin)
        case dialect.MAVLINK_MSG_ID_HOME_POSITION:
            return state._replace(home_ned=(message.x, message.y, message.z))
        case dialect.MAVLINK_MSG_ID_GPS_RAW_INT:
            return state._replace(gps_fix=message.fix_type)
        case dialect.MAVLINK_MSG_ID_STATUSTEXT:
            return state._replace(status_text=" ".join(message.text.split())) if message.severity <= 4 else state
    return state
