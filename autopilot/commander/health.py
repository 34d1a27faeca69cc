"""Health of the vehicle: the checks before arming, the accuracy limits in flight, and calibrations on the ground.

In flight COM_POS_FS_EPH and COM_VEL_FS_EVH limit the standard deviations of position and velocity, with PX4's
hysteresis. A quantity becomes invalid when its deviation exceeds 2.5 times the parameter. It becomes valid again when
the deviation has been below the parameter for a second. A negative parameter switches the check off. Source: the
parameter reference of PX4 1.15 and the behaviour of its `EstimatorChecks`.

One rule differs from PX4. After an impact our estimator reports a velocity deviation of several m/s, until the next GPS
fix corrects it about 0.1 s later. PX4's filter does not detect impacts and does not report this. So a velocity
deviation must last for LASTING_US before it counts. Otherwise every bump into a lamp post would trigger a failsafe.

A calibration only checks the sensor, with the vehicle at rest, because the estimator finds the biases in flight.
Clients need not turn the vehicle: accelerometer and compass are checked in the present attitude. The status texts are
the same as PX4's, because MAVSDK and QGroundControl parse them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from foundation.frames import GRAVITY
from foundation.mavlink import MODES, dialect

HYSTERESIS_FACTOR = 2.5  # a valid quantity becomes invalid above this factor times the parameter
PROBATION_US = 1_000_000
LASTING_US = 500_000


def required(parameters: ParameterTable, name: str) -> float:
    """Return the largest deviation that COM_POS_FS_EPH (m) or COM_VEL_FS_EVH (m/s) allows; inf for a negative value."""
    value = float(parameters[name])
    return value if value >= 0.0 else math.inf


class _Hysteresis:
    """Decides with a hysteresis whether one quantity is valid."""

    def __init__(self, lasting_us: int = 0) -> None:
        """A deviation that is too large counts only after it has lasted for `lasting_us` (µs)."""
        self._lasting_us = lasting_us
        self._believed = True
        self._failed_us = 0
        self._good_us = 0  # last time at which the deviation was small enough

    def limit(self, now_us: int, valid: bool, deviation: float, wanted: float) -> float:
        """Return the deviation above which the quantity is invalid; -inf if the quantity is invalid now.

        With `lasting_us`, the limit of a valid quantity is inf, so that a short deviation does not count. `valid` is
        the estimator's own flag; `wanted` is the result of `required`.
        """
        if valid and deviation < (wanted * HYSTERESIS_FACTOR if self._believed else wanted):
            self._good_us = now_us
            if now_us - self._failed_us >= PROBATION_US:
                self._believed = True
        elif not (valid and self._believed and now_us - self._good_us < self._lasting_us):
            self._believed, self._failed_us = False, now_us
        if not self._believed:
            return -math.inf
        return math.inf if self._lasting_us else wanted * HYSTERESIS_FACTOR


class AccuracyWatch:
    """Sets `position_limit` and `velocity_limit` of an EstimatedState. Call `look` about ten times a second."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._position, self._velocity = _Hysteresis(), _Hysteresis(LASTING_US)
        self._limited: EstimatedState | None = None

    def reset(self) -> None:
        """Remove both limits until the next `look`. Called when the vehicle is armed or disarmed."""
        self._position, self._velocity = _Hysteresis(), _Hysteresis(LASTING_US)
        if self._limited is not None:
            self._limited.position_limit = self._limited.velocity_limit = math.inf

    def look(self, state: EstimatedState) -> None:
        """Update both limits. Reads the ESTIMATE record, because the flags of `state` already depend on the limits."""
        self._limited = state
        now, p, e = state.time_us, self._parameters, state.estimate
        state.position_limit = self._position.limit(
            now, bool(e["position_valid"]), float(e["position_std_h"]), required(p, "COM_POS_FS_EPH")
        )
        state.velocity_limit = self._velocity.limit(
            now, bool(e["velocity_valid"]), float(e["velocity_std_h"]), required(p, "COM_VEL_FS_EVH")
        )


SENSOR_TIMEOUT_US = 500_000
NO_ARMING_MODES = frozenset({"LAND", "RETURN", "ORBIT", "PRECLAND", "FOLLOW", "TERMINATION"})  # as on PX4
STICK_MODES = frozenset({"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED"})
EXTERNAL_MODES = frozenset(name for name in MODES if name.startswith("EXTERNAL"))  # a companion computer flies these
UNREGISTERED = "mode is not registered"  # this autopilot has no registration of external modes
POSITION_MODES = frozenset({"HOLD", "TAKEOFF", "MISSION", "RETURN", "ORBIT", "FOLLOW", "POSCTL"})


@dataclass(frozen=True, slots=True)
class SensorHealth:
    """Whether each sensor delivers usable samples."""

    imu: bool
    mag: bool
    baro: bool
    gps: bool
    range: bool
    battery: bool


def sensor_health(state: EstimatedState) -> SensorHealth:
    """Return which sensors delivered a sample in the last 0.5 s (battery, GPS: 1 s). The GPS also needs a 3-D fix."""
    return SensorHealth(
        imu=state.age_us("imu") < SENSOR_TIMEOUT_US,
        mag=state.age_us("mag") < SENSOR_TIMEOUT_US,
        baro=state.age_us("baro") < SENSOR_TIMEOUT_US,
        gps=state.age_us("gps") < 2 * SENSOR_TIMEOUT_US and int(state.sensors["gps_fix_type"]) >= 3,
        range=state.age_us("range") < SENSOR_TIMEOUT_US,
        battery=state.age_us("battery") < 2 * SENSOR_TIMEOUT_US,
    )


def attitude_failures(state: EstimatedState, parameters: ParameterTable) -> list[str]:
    """Return PX4's text for each axis, roll or pitch, whose angle exceeds FD_FAIL_R or FD_FAIL_P (°, 0 = off)."""
    if not state.attitude_valid:
        return []
    limits = {"roll": parameters["FD_FAIL_R"], "pitch": parameters["FD_FAIL_P"]}
    return [
        f"Attitude failure ({axis})"
        for (axis, limit), angle in zip(limits.items(), state.euler[:2], strict=True)
        if 0.0 < math.radians(limit) < abs(angle)
    ]


def preflight_failures(state: EstimatedState, parameters: ParameterTable) -> list[str]:
    """Return the reasons why no mode can fly now, each short enough for one STATUSTEXT; empty if ready."""
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
    """Return the reasons why `mode` cannot run now. Source: PX4 mode_requirements.

    `home`: home is set. `sticks`, `offboard`: usable messages arrive. `mission`: the faults of the loaded mission.
    """
    reasons = [UNREGISTERED] if mode in EXTERNAL_MODES else []
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


class AttitudeWatch:
    """Sets `failed` if roll or pitch exceeds FD_FAIL_R or FD_FAIL_P (°, 0 = off) for FD_FAIL_R_TTRI or _P_TTRI (s)."""

    def __init__(self, parameters: ParameterTable) -> None:
        self.failed = False
        self._parameters = parameters
        self._since_us: list[int | None] = [None, None]

    def reset(self) -> None:
        """Clear `failed` and start again."""
        self.failed, self._since_us = False, [None, None]

    def look(self, state: EstimatedState, *, controlled: bool) -> None:
        """Update `failed`. `controlled`: the mode controls the attitude; in ACRO the pilot may flip the vehicle."""
        self.failed = False
        for i, name in enumerate(("FD_FAIL_R", "FD_FAIL_P")):
            limit = float(self._parameters[name])
            beyond = controlled and limit > 0.0 and abs(state.euler[i]) > math.radians(limit)
            if not beyond:
                self._since_us[i] = None
                continue
            since = self._since_us[i]
            if since is None:
                self._since_us[i] = since = state.time_us
            self.failed |= state.time_us - since >= self._parameters[f"{name}_TTRI"] * 1e6


DURATION_US = 2_000_000
STEPS = 10  # calibration reports its progress in tenths
MOVING_RATE = math.radians(5.0)  # rad/s; a larger gyro value shows motion, because no gyro's bias is so large
GRAVITY_TOLERANCE = 0.1  # largest relative error of the measured gravity
FIELD_GAUSS = (0.1, 1.0)  # accepted range; the Earth's field is 0.22 to 0.67 gauss
LEVEL_MOST = math.radians(10.0)  # rad, largest roll or pitch of a level vehicle

StatusText = Callable[[int, str], None]  # severity (MAV_SEVERITY), text


class SensorCalibration:
    """Calibrates sensors, one at a time. `tick` advances the calibration in vehicle time."""

    def __init__(self, state: EstimatedState, send_text: StatusText) -> None:
        self._state = state
        self._send_text = send_text
        self._queue: list[str] = []
        self._since_us = 0
        self._reported = 0

    @property
    def running(self) -> bool:
        return bool(self._queue)

    def start(self, sensors: list[str]) -> bool:
        """Calibrate `sensors` ("gyro", "mag", "accel", "level") one by one.

        Returns False while a calibration of other sensors runs. A repeated request has no effect and returns True.
        """
        if self._queue:
            return self._queue == sensors
        self._queue = list(sensors)
        self._open()
        return True

    def cancel(self) -> None:
        if self._queue:
            self._queue.clear()
            self._report("calibration cancelled")

    def tick(self) -> None:
        """Check the sensor, report the progress, and report the result at the end."""
        if not self._queue:
            return
        sensor, elapsed = self._queue[0], self._state.time_us - self._since_us
        fault = self._fault(sensor)
        if fault:
            self._report(f"calibration failed: {fault}", dialect.MAV_SEVERITY_CRITICAL)
            self._queue.clear()
            return
        step = min(STEPS, elapsed * STEPS // DURATION_US)
        if step > self._reported:
            self._reported = step
            self._report(f"progress <{100 * step // STEPS}>")
        if step == STEPS:
            self._report(f"calibration done: {sensor}")
            self._queue.pop(0)
            if self._queue:
                self._open()

    def _open(self) -> None:
        self._since_us, self._reported = self._state.time_us, 0
        self._report(f"calibration started: 2 {self._queue[0]}")
        self._report("progress <0>")

    def _report(self, text: str, severity: int = dialect.MAV_SEVERITY_INFO) -> None:
        self._send_text(severity, f"[cal] {text}")

    def _fault(self, sensor: str) -> str:
        """Return the sensor's fault; empty if none."""
        s = self._state
        if s.age_us("mag" if sensor == "mag" else "imu") > DURATION_US // 4:
            return "no data"
        gyro = s.sensors["gyro_frd"].tolist()
        if not max(abs(x) for x in gyro) < MOVING_RATE:
            return "vehicle moves"
        if sensor == "mag":
            field = math.hypot(*s.sensors["mag_frd"].tolist())
            return "" if FIELD_GAUSS[0] < field < FIELD_GAUSS[1] else "no magnetic field"
        if sensor == "accel":
            pull = math.hypot(*s.sensors["accel_frd"].tolist())
            return "" if abs(pull / GRAVITY - 1.0) < GRAVITY_TOLERANCE else "gravity not measured"
        if sensor == "level":
            return "" if max(abs(s.euler[0]), abs(s.euler[1])) < LEVEL_MOST else "vehicle not level"
        return ""
