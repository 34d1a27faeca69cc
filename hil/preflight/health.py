"""The autopilot itself: which firmware, what its own checks say, and whether its estimate can be flown on."""

from foundation.mavlink import dialect
from foundation.px4 import mode_name
from hil.preflight.heard import Heard, Message
from hil.preflight.row import Row

OLDEST = (1, 14)  # from there on what was absent at arming, such as sticks, counts as optional: failsafe.cpp
SENSORS = {  # bits of SYS_STATUS
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO: "gyro",
    dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "accelerometer",
    dialect.MAV_SYS_STATUS_SENSOR_3D_MAG: "compass",
    dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "barometer",
    dialect.MAV_SYS_STATUS_SENSOR_GPS: "GPS",
    dialect.MAV_SYS_STATUS_AHRS: "attitude",
    dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS: "motors",
    dialect.MAV_SYS_STATUS_SENSOR_BATTERY: "battery",
    dialect.MAV_SYS_STATUS_LOGGING: "flight log",
}
NEEDED = ("gyro", "accelerometer", "compass", "barometer", "GPS")  # without one of them it is no vehicle for us
PRESENT_UNSAID = dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL  # PX4 only ever says that it is unhealthy
PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
ESTIMATES = {  # bits of ESTIMATOR_STATUS that flying velocities and places stands on
    dialect.ESTIMATOR_ATTITUDE: "attitude",
    dialect.ESTIMATOR_VELOCITY_HORIZ: "horizontal velocity",
    dialect.ESTIMATOR_VELOCITY_VERT: "vertical velocity",
    dialect.ESTIMATOR_POS_HORIZ_ABS: "place",
    dialect.ESTIMATOR_POS_VERT_ABS: "altitude",
}
TROUBLES = {  # not CONST_POS_MODE: PX4 assumes a constant place whenever the vehicle stands still
    dialect.ESTIMATOR_GPS_GLITCH: "it rejects the GPS as a glitch",
    dialect.ESTIMATOR_ACCEL_ERROR: "it suspects the accelerometer",
}
RATIOS = {  # test ratios of ESTIMATOR_STATUS: above 1 the filter throws the measurement away
    "vel_ratio": "velocity", "pos_horiz_ratio": "place", "pos_vert_ratio": "height", "mag_ratio": "heading",
}  # fmt: skip
FLOWN = "1.14.4, 1.15.4 and 1.16.1"
SPREAD_MOST = 5.0  # m, COM_POS_FS_EPH's default: beyond it PX4 does not trust the place itself


def rows(heard: Heard) -> list[Row]:
    """Return the rows of the autopilot's condition."""
    return [_firmware(heard), _armed(heard), _sensors(heard), _prearm(heard), _estimator(heard)]


def _firmware(heard: Heard) -> Row:
    firmware = heard.firmware
    if firmware is None:
        return Row("firmware", None, "it does not tell its version, so advice that depends on it is a guess")
    if version(heard) < OLDEST:
        return Row("firmware", False, f"{firmware}: the advice here is for PX4 {FLOWN}, which were flown with it",
                   f"update to one of {FLOWN}")  # fmt: skip
    return Row("firmware", True, str(firmware))


def version(heard: Heard) -> tuple[int, int]:
    """Return (major, minor) of the firmware, (0, 0) when it was not told."""
    message = heard.message("AUTOPILOT_VERSION")
    number = 0 if message is None else int(message.flight_sw_version)
    return number >> 24 & 0xFF, number >> 16 & 0xFF


def _armed(heard: Heard) -> Row:
    beat = heard.message("HEARTBEAT")
    if beat is None:
        return Row("disarmed", None, "no heartbeat came meanwhile")
    if beat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED:
        return Row("disarmed", False, "the motors are armed", "disarm; a vehicle is checked before it is armed")
    return Row("disarmed", True, "the motors are off")


def _sensors(heard: Heard) -> Row:
    status = heard.message("SYS_STATUS")
    if status is None:
        return Row("sensors", False, "SYS_STATUS does not come: nothing is known", "look at the link's rates")
    present = int(status.onboard_control_sensors_present) | PRESENT_UNSAID
    bad = [name for bit, name in SENSORS.items() if _enabled(status) & bit and not _health(status) & bit]
    missing = [
        name for bit, name in SENSORS.items()
        if name in NEEDED and name not in bad and not present & bit
    ]  # fmt: skip
    if bad or missing:
        reasons = [f"{name} unhealthy" for name in bad] + [f"no {name}" for name in missing]
        return Row("sensors", False, ", ".join(reasons) + _said(heard), "calibrate or replace what is named")
    good = [name for bit, name in SENSORS.items() if present & bit]
    return Row("sensors", True, ", ".join(good))


def _prearm(heard: Heard) -> Row:
    status = heard.message("SYS_STATUS")
    if status is None:
        return Row("pre-arm check", False, "SYS_STATUS does not come", "look at the link's rates")
    if not _health(status) & PREARM:
        standing = _mode(heard) == "OFFBOARD"  # as a flight that was broken off leaves it
        fix = "switch it to Hold: in OFFBOARD it wants setpoints" if standing else "a ground station names every reason"
        return Row("pre-arm check", False, f"it would refuse to arm in {_mode(heard)}" + _said(heard), fix)
    return Row("pre-arm check", True, f"it would arm in {_mode(heard)}" + _said(heard))


def _estimator(heard: Heard) -> Row:
    status = heard.message("ESTIMATOR_STATUS")
    if status is None:
        return Row("estimator", False, "ESTIMATOR_STATUS does not come, so nothing is known of its estimate",
                   "look at the link's rates")  # fmt: skip
    reasons = [f"no {name}" for bit, name in ESTIMATES.items() if not status.flags & bit]
    reasons += [text for bit, text in TROUBLES.items() if status.flags & bit]
    reasons += [
        f"the measured {RATIOS[name]} is rejected (test ratio {ratio:.1f})"
        for name, ratio in heard.worst_ratio.items() if ratio > 1.0
    ]  # fmt: skip
    if not status.pos_horiz_accuracy <= SPREAD_MOST:
        reasons.append(f"the place is only known to {status.pos_horiz_accuracy:.1f} m")
    if reasons:
        return Row("estimator", False, "; ".join(reasons), "wait; away from steel and under open sky if it stays so")
    worst = max(heard.worst_ratio.values(), default=0.0)
    return Row("estimator", True, f"attitude, velocity, place and altitude; place ±{status.pos_horiz_accuracy:.1f} m, "
               f"altitude ±{status.pos_vert_accuracy:.1f} m, largest test ratio {worst:.2f}")  # fmt: skip


def _mode(heard: Heard) -> str:
    beat = heard.message("HEARTBEAT")
    return "its present mode" if beat is None else mode_name(beat.custom_mode)


def _said(heard: Heard) -> str:
    return f"; it says: {'; '.join(heard.texts[-3:])}" if heard.texts else ""


def _enabled(status: Message) -> int:
    return int(status.onboard_control_sensors_enabled)


def _health(status: Message) -> int:
    return int(status.onboard_control_sensors_health)
