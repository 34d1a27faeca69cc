"""What must be true before the motors may start."""

import math
from dataclasses import dataclass

from autopilot.commander.accuracy import required
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable

SENSOR_TIMEOUT_US = 500_000
NO_ARMING_MODES = frozenset({"LAND", "RETURN", "ORBIT", "PRECLAND", "FOLLOW", "TERMINATION"})  # PX4 mode requirements
STICK_MODES = frozenset({"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED"})
POSITION_MODES = frozenset({"HOLD", "TAKEOFF", "MISSION", "RETURN", "ORBIT", "FOLLOW", "POSCTL"})


@dataclass(frozen=True, slots=True)
class SensorHealth:
    """Which sensors deliver."""

    imu: bool
    mag: bool
    baro: bool
    gps: bool
    range: bool
    battery: bool


def sensor_health(state: EstimatedState) -> SensorHealth:
    """Return which sensors gave a usable sample within the last half second (GPS: a 3-D fix within a second)."""
    return SensorHealth(
        imu=state.age_us("imu") < SENSOR_TIMEOUT_US,
        mag=state.age_us("mag") < SENSOR_TIMEOUT_US,
        baro=state.age_us("baro") < SENSOR_TIMEOUT_US,
        gps=state.age_us("gps") < 2 * SENSOR_TIMEOUT_US and int(state.sensors["gps_fix_type"]) >= 3,
        range=state.age_us("range") < SENSOR_TIMEOUT_US,
        battery=state.age_us("battery") < 2 * SENSOR_TIMEOUT_US,
    )


def attitude_failures(state: EstimatedState, parameters: ParameterTable) -> list[str]:
    """Return in which axes the vehicle leans beyond FD_FAIL_R and FD_FAIL_P (°, 0 = off), in PX4's words."""
    if not state.attitude_valid:
        return []
    limits = {"roll": parameters["FD_FAIL_R"], "pitch": parameters["FD_FAIL_P"]}
    return [
        f"Attitude failure ({axis})"
        for (axis, limit), angle in zip(limits.items(), state.euler[:2], strict=True)
        if 0.0 < math.radians(limit) < abs(angle)
    ]


def preflight_failures(state: EstimatedState, parameters: ParameterTable) -> list[str]:
    """Return the reasons, short enough for one STATUSTEXT each, why no mode could fly now; empty when ready."""
    health, p = sensor_health(state), parameters
    reasons = []
    if not health.imu:
        reasons.append("no inertial data")
    if not health.mag and p["SYS_HAS_MAG"]:
        reasons.append("no compass data")
    if not health.baro and p["SYS_HAS_BARO"]:
        reasons.append("no barometer data")
    if not state.attitude_valid:
        reasons.append("attitude not converged")
    reasons += attitude_failures(state, parameters)
    if not state.altitude_valid:
        reasons.append("altitude not converged")
    if not state.velocity_valid or state.velocity_std_h > required(p, "COM_VEL_FS_EVH"):
        reasons.append("velocity not converged")
    if not p["COM_ARM_WO_GPS"] and not health.gps:
        reasons.append("no 3-D fix")
    if health.battery:
        remaining = float(state.sensors["battery_remaining"])
        if remaining < max(p["COM_ARM_BAT_MIN"], p["BAT_CRIT_THR"]):
            reasons.append("battery too low")
    return reasons


def mode_failures(
    mode: str,
    state: EstimatedState,
    parameters: ParameterTable,
    *,
    home: bool,
    sticks: bool,
    offboard: bool,
    mission: list[str],
) -> list[str]:
    """Return the reasons why `mode` cannot run now; the flags say what is available. PX4 mode_requirements.

    `mission`: what is wrong with the loaded mission.
    """
    reasons = []
    accurate = state.position_valid and state.position_std_h < required(parameters, "COM_POS_FS_EPH")
    if mode in POSITION_MODES and not accurate:
        reasons.append("position not converged")
    if mode == "RETURN" and not home:
        reasons.append("no home position")
    if mode in STICK_MODES and not sticks:
        reasons.append("no manual control")
    if mode == "OFFBOARD" and not offboard:
        reasons.append("no offboard signal")
    return reasons + mission
