"""Calibrations on the ground. The estimator finds the biases in flight, so each one checks its sensor at rest.

A vehicle in a simulator, or on a desk, is not turned about: accelerometer and compass are judged in the attitude in
which they stand. Texts are those of PX4 that MAVSDK and QGroundControl read.
"""

import math
from collections.abc import Callable

from autopilot.estimator.estimated_state import EstimatedState
from foundation.frames import GRAVITY
from foundation.mavlink import dialect

DURATION_US = 2_000_000
STEPS = 10  # progress is told in tenths
MOVING_RATE = math.radians(5.0)  # rad/s, above any gyro's bias
GRAVITY_TOLERANCE = 0.1
FIELD_GAUSS = (0.1, 1.0)  # the Earth's field is 0.22 to 0.67
LEVEL_MOST = math.radians(10.0)
SENSORS = ("gyro", "mag", "accel", "level")

StatusText = Callable[[int, str], None]  # severity (MAV_SEVERITY), text


class SensorCalibration:
    """At most one at a time, moved on by `tick` in vehicle time."""

    def __init__(self, state: EstimatedState, say: StatusText) -> None:
        self._state = state
        self._say = say
        self._queue: list[str] = []
        self._since_us = 0
        self._told = 0

    @property
    def running(self) -> bool:
        return bool(self._queue)

    def start(self, sensors: list[str]) -> bool:
        """Begin with these of SENSORS, one after the other. Returns False while others are running."""
        if self._queue:
            return self._queue == sensors  # the same request repeated
        self._queue = list(sensors)
        self._open()
        return True

    def cancel(self) -> None:
        """Give up."""
        if self._queue:
            self._queue.clear()
            self._tell("calibration cancelled")

    def tick(self) -> None:
        """Look at the sensor, tell the progress, and judge at the end."""
        if not self._queue:
            return
        sensor, elapsed = self._queue[0], self._state.time_us - self._since_us
        fault = self._fault(sensor)
        if fault:
            self._tell(f"calibration failed: {fault}", dialect.MAV_SEVERITY_CRITICAL)
            self._queue.clear()
            return
        step = min(STEPS, elapsed * STEPS // DURATION_US)
        if step > self._told:
            self._told = step
            self._tell(f"progress <{100 * step // STEPS}>")
        if step == STEPS:
            self._tell(f"calibration done: {sensor}")
            self._queue.pop(0)
            if self._queue:
                self._open()

    def _open(self) -> None:
        self._since_us, self._told = self._state.time_us, 0
        self._tell(f"calibration started: 2 {self._queue[0]}")
        self._tell("progress <0>")

    def _tell(self, text: str, severity: int = dialect.MAV_SEVERITY_INFO) -> None:
        self._say(severity, f"[cal] {text}")

    def _fault(self, sensor: str) -> str:
        """Return what speaks against the sensor now, empty when nothing does."""
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
