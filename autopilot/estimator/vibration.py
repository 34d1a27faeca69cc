"""How much the inertial unit shakes, by PX4's metric: the smoothed change from sample to sample, and clipping."""

import math

from autopilot.estimator.estimated_state import EstimatedState
from foundation.frames import Vec3

SHARE = 0.02  # of a new sample in the metric: PX4's second of smoothing, at the commander's 50 Hz
CLIPPED = 0.98 * 16.0 * 9.80665  # m/s², of an accelerometer with 16 g full scale


class Vibration:
    """`accel` in m/s² and `gyro` in rad/s; `clipped` counts samples at full scale per axis."""

    def __init__(self) -> None:
        self.accel = 0.0
        self.gyro = 0.0
        self.clipped = [0, 0, 0]
        self._last: tuple[Vec3, Vec3] | None = None

    def take(self, state: EstimatedState) -> None:
        """Follow one tick on the newest inertial sample."""
        a, g = state.accel_frd, state.rates_frd
        if self._last is not None and math.isfinite(sum(a) + sum(g)):
            b, h = self._last
            self.accel += SHARE * (math.dist(a, b) - self.accel)
            self.gyro += SHARE * (math.dist(g, h) - self.gyro)
            if max(a) > CLIPPED or min(a) < -CLIPPED:
                for i in range(3):
                    self.clipped[i] += abs(a[i]) > CLIPPED
            self._last = a, g
        elif self._last is None:
            self._last = a, g
