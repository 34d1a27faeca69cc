"""The vehicle's state at one tick as the commander knows it: estimate, raw sensor samples, and vibration.

Vibration is PX4's metric: the smoothed change from sample to sample, and clipping.
"""

import math
import struct
from collections.abc import Callable
from functools import cached_property
from typing import Any

from autopilot.records import ESTIMATE
from foundation.frames import Quat, Vec3, ned_to_geodetic, quat_to_euler

FARTHEST_M = 1e6  # a local position beyond this is no position
RANGE_FRESH_US = 300_000  # the downward rangefinder samples at 10 Hz or faster; three missed samples make it stale

_LAYOUT = tuple((name, ESTIMATE[name].base.kind, math.prod(ESTIMATE[name].shape)) for name in ESTIMATE.names or ())
_FORMAT = struct.Struct("=" + "".join(f"{count}{'q' if kind == 'i' else 'd'}" for _, kind, count in _LAYOUT))
_NAMES = frozenset(name for name, _, _ in _LAYOUT)


def _display() -> Callable[[tuple[Any, ...]], dict[str, Any]]:
    """Return a function from the numbers of the record to its fields by name, scalars or tuples.

    Made from source, as `namedtuple` makes its constructor: one dict display takes half the time of a loop, and this
    runs at every tick.
    """
    start, entries = 0, []
    for name, _, count in _LAYOUT:
        entries.append(f"{name!r}: v[{start}]" if count == 1 else f"{name!r}: v[{start}:{start + count}]")
        start += count
    made: Callable[[tuple[Any, ...]], dict[str, Any]] = eval(f"lambda v: {{{', '.join(entries)}}}")
    return made


_fields = _display()
_TIME = struct.Struct("=q")
_TIME_AT = ESTIMATE.fields["time_us"][1] if ESTIMATE.fields else 0


class EstimatedState:
    """A snapshot of the ESTIMATE record as plain floats and tuples (same names, units, frames); `refresh` renews it.

    Plain Python numbers are an order of magnitude faster to use than the fields of a numpy record. They are read from
    it all at once, when the first of them is asked for: on most ticks nobody needs more than the time.
    """

    # what stays; the snapshot itself is in __dict__
    __slots__ = ("__dict__", "_buffer", "estimate", "position_limit", "sensors", "velocity_limit")

    time_us: int
    attitude: Quat
    rates_frd: Vec3
    accel_frd: Vec3
    velocity_ned: Vec3
    position_ned: Vec3
    gyro_bias: Vec3
    accel_bias: Vec3
    origin_lat_deg: float
    origin_lon_deg: float
    origin_alt_m: float
    origin_set: int
    attitude_valid: int
    velocity_valid: int
    position_valid: int
    altitude_valid: int
    position_std_h: float
    position_std_v: float
    velocity_std_h: float
    velocity_std_v: float
    tilt_std: float
    yaw_std: float
    innovation: tuple[float, ...]
    innovation_variance: tuple[float, ...]
    test_ratio: tuple[float, ...]
    attitude_setpoint: Quat
    rates_setpoint: Vec3
    thrust_setpoint: float
    hover_thrust: float
    resets: int

    def __init__(self, estimate: Any, sensors: Any) -> None:
        self.estimate = estimate
        self.sensors = sensors
        self.position_limit = math.inf  # m, position_std_h from which on the position is not valid: `AccuracyWatch`
        self.velocity_limit = math.inf  # m/s, velocity_std_h likewise
        self._buffer = memoryview(estimate)
        self.refresh()

    def refresh(self) -> None:
        """Forget the snapshot but for its time. Before the estimator has run once, time comes from the sensors."""
        (time_us,) = _TIME.unpack_from(self._buffer, _TIME_AT)
        self.__dict__ = {"time_us": time_us or int(self.sensors["time_us"])}

    def __getattr__(self, name: str) -> Any:
        """Take the snapshot, at the first field that is asked for after `refresh`."""
        if name not in _NAMES:
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
        fields = _fields(_FORMAT.unpack_from(self._buffer))
        fields["time_us"] = self.__dict__["time_us"]
        if fields["position_std_h"] > self.position_limit:
            fields["position_valid"] = 0
        if fields["velocity_std_h"] > self.velocity_limit:
            fields["velocity_valid"] = 0
        self.__dict__ = fields
        return fields[name]

    @cached_property
    def euler(self) -> Vec3:
        """rad, roll, pitch and yaw; computed for the ticks that ask for it."""
        return quat_to_euler(self.attitude)

    @property
    def yaw(self) -> float:
        """rad, 0 = north."""
        return self.euler[2]

    def innovation_over_gate(self, first: int, count: int = 1) -> float:
        """Return the largest innovation over its gate of `count` tests from `first` on; above 1: not used."""
        return math.sqrt(max(self.test_ratio[first : first + count]))

    @property
    def global_valid(self) -> bool:
        """True if latitude, longitude and altitude are valid."""
        n, e, d = self.position_ned
        believable = n * n + e * e + d * d < FARTHEST_M**2  # false for nan too
        return bool(self.origin_set and self.position_valid and self.altitude_valid and believable)

    def age_us(self, sensor: str) -> int:
        """Return the age (µs) of the sample named `sensor` ('imu', 'mag', 'baro', 'gps', 'range', 'battery')."""
        stamp = int(self.sensors[f"{sensor}_time_us"])
        return self.time_us - stamp if stamp else 1 << 62

    def range_m(self) -> float:
        """Return the fresh downward range (m), nan when there is none."""
        return float(self.sensors["range_m"]) if self.age_us("range") < RANGE_FRESH_US else math.nan

    def geodetic(self, position_ned: Vec3) -> Vec3:
        """Return (lat deg, lon deg, alt m above mean sea level) of a local position."""
        return ned_to_geodetic(self.origin_lat_deg, self.origin_lon_deg, self.origin_alt_m, *position_ned)


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
