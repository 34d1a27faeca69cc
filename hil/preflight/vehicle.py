"""Rows of the preflight check about the vehicle itself: autopilot, position, home and battery.

Autopilot: firmware, its own checks, quality of its estimate. Battery: charge, measurement, number of cells.
"""

import math
from collections.abc import Mapping

from foundation.mavlink import dialect, mode_name
from hil.link.parameters import Value
from hil.link.telemetry import PREARM
from hil.preflight.observation import Message, Observation, Row, RuleResult, bad, good, unclear

OLDEST = (1, 14)  # from this version on, sticks and other parts that are absent at arming are optional: failsafe.cpp
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
NEEDED = ("gyro", "accelerometer", "compass", "barometer", "GPS")  # a vehicle that lacks one of these cannot be flown
PRESENT_UNSAID = dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL  # PX4 never reports it as present, only as unhealthy
ESTIMATES = {  # bits of ESTIMATOR_STATUS that flying needs
    dialect.ESTIMATOR_ATTITUDE: "attitude",
    dialect.ESTIMATOR_VELOCITY_HORIZ: "horizontal velocity",
    dialect.ESTIMATOR_VELOCITY_VERT: "vertical velocity",
    dialect.ESTIMATOR_POS_HORIZ_ABS: "place",
    dialect.ESTIMATOR_POS_VERT_ABS: "altitude",
}
TROUBLES = {  # bits of ESTIMATOR_STATUS; without CONST_POS_MODE, which PX4 sets whenever the vehicle is at rest
    dialect.ESTIMATOR_GPS_GLITCH: "the estimator rejects the GPS as a glitch",
    dialect.ESTIMATOR_ACCEL_ERROR: "the estimator suspects the accelerometer",
}
RATIOS = {  # test ratios of ESTIMATOR_STATUS: above 1 the filter rejects the measurement
    "vel_ratio": "velocity", "pos_horiz_ratio": "place", "pos_vert_ratio": "height", "mag_ratio": "heading",
}  # fmt: skip
TESTED = "1.14.4, 1.15.4 and 1.16.1"
SPREAD_MOST = 5.0  # m, default of COM_POS_FS_EPH: with a larger error, PX4 does not trust its position


def _firmware(observed: Observation) -> RuleResult:
    firmware = observed.firmware
    if firmware is None:
        return unclear("the autopilot does not send its version, so some advice is a guess")
    if version(observed) < OLDEST:
        return bad(f"{firmware}: the advice here was tested with PX4 {TESTED}", f"update to one of {TESTED}")
    return good(str(firmware))


def version(observed: Observation) -> tuple[int, int]:
    """Return (major, minor) of the firmware; (0, 0): it was not sent."""
    message = observed.message("AUTOPILOT_VERSION")
    number = 0 if message is None else int(message.flight_sw_version)
    return number >> 24 & 0xFF, number >> 16 & 0xFF


def _armed(observed: Observation) -> RuleResult:
    beat = observed.message("HEARTBEAT")
    if beat is None:
        return unclear("no heartbeat arrived")
    if beat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED:
        return bad("the motors are armed", "disarm the vehicle; this check is for a disarmed one")
    return good("the motors are off")


def _sensors(observed: Observation) -> RuleResult:
    status = observed.message("SYS_STATUS")
    if status is None:
        return bad("SYS_STATUS does not arrive, so nothing is known", "look at the link's rates")
    present = int(status.onboard_control_sensors_present) | PRESENT_UNSAID
    enabled = int(status.onboard_control_sensors_enabled)
    unhealthy = [name for bit, name in SENSORS.items() if enabled & bit and not _health(status) & bit]
    absent = [name for bit, name in SENSORS.items() if name in NEEDED and not present & bit]
    missing = [name for name in absent if name not in unhealthy]
    if unhealthy or missing:
        reasons = [f"{name} unhealthy" for name in unhealthy] + [f"no {name}" for name in missing]
        return bad(", ".join(reasons) + _texts(observed), "calibrate or replace these sensors")
    return good(", ".join(name for bit, name in SENSORS.items() if present & bit))


def _prearm(observed: Observation) -> RuleResult:
    status = observed.message("SYS_STATUS")
    if status is None:
        return bad("SYS_STATUS does not arrive", "look at the link's rates")
    if not _health(status) & PREARM:
        in_offboard = _mode(observed) == "OFFBOARD"  # for example after a broken flight
        fix = (
            "switch it to Hold, because OFFBOARD needs setpoints"
            if in_offboard
            else "a ground station shows every reason"
        )
        return bad(f"the vehicle would refuse to arm in {_mode(observed)}" + _texts(observed), fix)
    return good(f"the vehicle would arm in {_mode(observed)}" + _texts(observed))


def _estimator(observed: Observation) -> RuleResult:
    status = observed.message("ESTIMATOR_STATUS")
    if status is None:
        return bad("ESTIMATOR_STATUS does not arrive, so the estimate is unknown", "look at the link's rates")
    reasons = [f"no {name}" for bit, name in ESTIMATES.items() if not status.flags & bit]
    reasons += [text for bit, text in TROUBLES.items() if status.flags & bit]
    reasons += [
        f"the measured {RATIOS[name]} is rejected (test ratio {ratio:.1f})"
        for name, ratio in observed.worst_ratio.items() if ratio > 1.0
    ]  # fmt: skip
    if not status.pos_horiz_accuracy <= SPREAD_MOST:
        reasons.append(f"the position error is {status.pos_horiz_accuracy:.1f} m")
    if reasons:
        return bad("; ".join(reasons), "wait; if it stays, move away from steel, under open sky")
    worst = max(observed.worst_ratio.values(), default=0.0)
    return good(
        f"attitude, velocity, position and altitude are good; position ±{status.pos_horiz_accuracy:.1f} m,"
        f" altitude ±{status.pos_vert_accuracy:.1f} m, largest test ratio {worst:.2f}"
    )


def _mode(observed: Observation) -> str:
    beat = observed.message("HEARTBEAT")
    return "its present mode" if beat is None else mode_name(beat.custom_mode)


def _texts(observed: Observation) -> str:
    return f"; its messages: {'; '.join(observed.texts[-3:])}" if observed.texts else ""


def _health(status: Message) -> int:
    return int(status.onboard_control_sensors_health)


FIX_3D = 3
SATELLITES = 6  # EKF2_REQ_NSATS, default
HDOP_MOST = 2.5  # default of EKF2_REQ_PDOP; HDOP is at most PDOP
SPREAD_H, SPREAD_V = 3.0, 5.0  # m, EKF2_REQ_EPH and EKF2_REQ_EPV, defaults
UNKNOWN = 65535  # value of a 16-bit field that is not measured
HOME_NEAR = 10.0  # m; a vehicle that is nearer to home than this is at home, given the errors of GPS
EARTH = 6_371_000.0  # m, mean radius


def _gps(observed: Observation) -> RuleResult:
    gps = observed.message("GPS_RAW_INT")
    if gps is None or gps.fix_type == 0:
        return bad("no message of a receiver arrives", "check its cable; no flight is possible without a position")
    if gps.fix_type < FIX_3D:
        return bad(f"no 3-D fix, {_count(gps.satellites_visible)}", "wait under open sky")
    hdop = gps.eph / 100.0 if gps.eph != UNKNOWN else None
    spreads = [(name, value / 1000.0, most) for name, value, most in
               (("h", gps.h_acc, SPREAD_H), ("v", gps.v_acc, SPREAD_V)) if value]  # fmt: skip
    details = [f"fix type {gps.fix_type}", _count(gps.satellites_visible)]
    details += [f"HDOP {hdop:.1f}"] if hdop is not None else []
    details += [f"±{value:.1f} m {'across' if name == 'h' else 'in height'}" for name, value, _ in spreads]
    poor = [] if gps.satellites_visible >= SATELLITES else [f"fewer than {SATELLITES} satellites"]
    poor += [f"HDOP above {HDOP_MOST:g}"] if hdop is not None and hdop > HDOP_MOST else []
    poor += [f"worse than {most:g} m {'across' if name == 'h' else 'in height'}" for name, value, most in spreads
             if value > most]  # fmt: skip
    if poor:
        return bad(f"{', '.join(details)}: {', '.join(poor)}", "wait under open sky")
    return good(", ".join(details))


def _count(satellites: int) -> str:
    return "number of satellites unknown" if satellites == 255 else f"{satellites} satellites"


def _home(observed: Observation) -> RuleResult:
    home, here = observed.message("HOME_POSITION"), observed.message("GLOBAL_POSITION_INT")
    if home is None:
        return bad(
            "none is set, so the vehicle cannot return, and the fence has no centre",
            "wait for a good position; PX4 then sets home itself",
        )
    if here is None:
        return unclear("set, but GLOBAL_POSITION_INT does not arrive, so its distance is unknown")
    distance = ground_distance(home.latitude, home.longitude, here.lat, here.lon)
    height = (here.alt - home.altitude) / 1000.0
    why = f"set, {distance:.1f} m from here, {abs(height):.1f} m {'below' if height >= 0 else 'above'}"
    if distance > HOME_NEAR:
        return bad(
            f"{why}: the vehicle would return to another place",
            "set it again where the vehicle stands, or reboot the autopilot there",
        )
    return good(why)


def ground_distance(lat_a: int, lon_a: int, lat_b: int, lon_b: int) -> float:
    """Return the distance in m between two places in 1e-7 degrees; good for some kilometres."""
    north = math.radians((lat_b - lat_a) * 1e-7) * EARTH
    turn = ((lon_b - lon_a) * 1e-7 + 180.0) % 360.0 - 180.0
    return math.hypot(north, math.radians(turn) * EARTH * math.cos(math.radians(lat_a * 1e-7)))


BATTERY_PARAMETERS = ("BAT1_N_CELLS", "BAT_LOW_THR")
CELL_LEAST, CELL_MOST = 3.5, 4.35  # V at rest: an empty lithium cell, and a full one of the high-voltage kind
MARGIN = 0.25  # share of the capacity that a flight of five minutes needs, above BAT_LOW_THR (low battery)


def _battery(observed: Observation, values: Mapping[str, Value | None]) -> RuleResult:
    status = observed.message("SYS_STATUS")
    if status is None or status.voltage_battery in (0, UNKNOWN):
        return bad(
            "its voltage is not measured, so the vehicle would not land before it is empty",
            "configure the battery in the ground station",
        )
    volts = status.voltage_battery / 1000.0
    details = [f"{volts:.1f} V"]
    cells = int(values.get("BAT1_N_CELLS") or 0)
    if cells > 0:
        details.append(f"{volts / cells:.2f} V in each of {cells} cells")
    if status.battery_remaining >= 0:
        details.append(f"{status.battery_remaining} % left")
    why = ", ".join(details)
    if cells > 0 and not CELL_LEAST <= volts / cells <= CELL_MOST:
        return bad(f"{why}: a resting cell cannot have this voltage", "charge it, or correct BAT1_N_CELLS")
    if status.battery_remaining < 0:
        return unclear(f"{why}; the remaining charge is unknown", "judge by the voltage")
    least = float(values.get("BAT_LOW_THR") or 0.15) + MARGIN
    if status.battery_remaining < 100.0 * least:
        return bad(f"{why}: less than {100 * least:.0f} %, the charge of a flight and the reserve", "charge it")
    if not cells:
        return unclear(f"{why}; the number of cells is unknown, so the voltage cannot be checked")
    return good(why)


def rows(observed: Observation, values: Mapping[str, Value | None]) -> list[Row]:
    """Return the rows of the autopilot, its position, home and battery."""
    return [
        _firmware(observed).named("firmware"),
        _armed(observed).named("disarmed"),
        _sensors(observed).named("sensors"),
        _prearm(observed).named("pre-arm check"),
        _estimator(observed).named("estimator"),
        _gps(observed).named("GPS"),
        _home(observed).named("home"),
        _battery(observed, values).named("battery"),
    ]
