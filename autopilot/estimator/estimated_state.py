"""The vehicle's state for commander and telemetry: the estimate and the raw sensor samples."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from autopilot.records import ESTIMATE
from foundation.frames import Quat, Vec3, ned_to_geodetic, quat_to_euler
from foundation.record_reader import reader

FARTHEST_M = 1e6  # a local position farther from the origin is invalid
RANGE_FRESH_US = 300_000  # the downward rangefinder samples at 10 Hz or faster; three missed samples make it stale

# Three groups of fields; the fields of a group are read together. The commander uses _FLIGHT at each of its ticks.
_FLIGHT = (
    "velocity_ned", "position_ned", "attitude_valid", "velocity_valid", "position_valid", "altitude_valid",
    "position_std_h", "velocity_std_h", "thrust_setpoint", "hover_thrust",
)  # fmt: skip
_MOTION = ("attitude", "rates_frd", "accel_frd")
_REST = tuple(name for name in ESTIMATE.names or () if name not in ("time_us", *_FLIGHT, *_MOTION))


def display(dtype: np.dtype[np.void], names: tuple[str, ...]) -> Callable[[tuple[Any, ...]], dict[str, Any]]:
    """Return a function that converts the numbers of a record's fields to a dict: field name → scalar or tuple.

    The numbers come from `foundation.record_reader.reader` with the same names. The function is compiled from source
    text, because a dict literal takes half the time of a loop, and this runs at every tick.
    """
    start, entries = 0, []
    for name in names:
        count = math.prod(dtype[name].shape)
        entries.append(f"{name!r}: v[{start}]" if count == 1 else f"{name!r}: v[{start}:{start + count}]")
        start += count
    made: Callable[[tuple[Any, ...]], dict[str, Any]] = eval(f"lambda v: {{{', '.join(entries)}}}")
    return made


_GROUPS = tuple((names, display(ESTIMATE, names)) for names in (_FLIGHT, _MOTION, _REST))
_GROUP_OF = {name: number for number, (names, _) in enumerate(_GROUPS) for name in names}


class EstimatedState:
    """A snapshot of the ESTIMATE record as plain floats and tuples (same names, units, frames).

    `refresh` starts a new snapshot. Plain Python numbers are ten times faster to use than the fields of a numpy record.
    A group of fields is read when one of its fields is first used, because many snapshots are used only for the time.
    """

    # these stay when a new snapshot starts; the snapshot itself is in __dict__
    __slots__ = (
        "__dict__",
        "_groups",
        "_range",
        "_time",
        "battery",
        "estimate",
        "position_limit",
        "sensors",
        "velocity_limit",
    )

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
    vibration_accel: float
    vibration_gyro: float
    clipped: tuple[int, ...]

    def __init__(self, estimate: Any, sensors: Any) -> None:
        self.estimate = estimate
        self.sensors = sensors
        self.position_limit = math.inf  # m; above this position_std_h the position is invalid; set by `AccuracyWatch`
        self.velocity_limit = math.inf  # m/s; above this velocity_std_h the velocity is invalid
        self._time = reader(estimate, "time_us")
        self._range = reader(sensors, "range_time_us", "range_m")
        self.battery = reader(sensors, "battery_time_us", "battery_remaining")  # time (µs; 0: none), charge (0 … 1)
        self._groups = tuple((reader(estimate, *names), as_fields) for names, as_fields in _GROUPS)
        self.refresh()

    def refresh(self) -> None:
        """Start a new snapshot with the estimate's time; before the first estimate, with the sensors' time."""
        (time_us,) = self._time()
        self.__dict__ = {"time_us": time_us or int(self.sensors["time_us"])}

    def __getattr__(self, name: str) -> Any:
        """Read a group of fields when the first of them is used after `refresh`."""
        number = _GROUP_OF.get(name)
        if number is None:
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
        read, as_fields = self._groups[number]
        fields = as_fields(read())
        if number == 0:
            if fields["position_std_h"] > self.position_limit:
                fields["position_valid"] = 0
            if fields["velocity_std_h"] > self.velocity_limit:
                fields["velocity_valid"] = 0
        self.__dict__ |= fields
        return fields[name]

    @cached_property
    def euler(self) -> Vec3:
        """Roll, pitch and yaw (rad), computed when first used."""
        return quat_to_euler(self.attitude)

    @property
    def yaw(self) -> float:
        """Yaw (rad), 0 = north."""
        return self.euler[2]

    def innovation_over_gate(self, first: int, count: int = 1) -> float:
        """Return the largest innovation / gate of `count` tests from `first` on; above 1 the sample is rejected."""
        return math.sqrt(max(self.test_ratio[first : first + count]))

    @property
    def global_valid(self) -> bool:
        """True if latitude, longitude and altitude are valid."""
        n, e, d = self.position_ned
        believable = n * n + e * e + d * d < FARTHEST_M**2  # false for nan too
        return bool(self.origin_set and self.position_valid and self.altitude_valid and believable)

    def age_us(self, sensor: str) -> int:
        """Return the age (µs) of a sensor's newest sample; 2⁶² before the first one.

        `sensor` is 'imu', 'mag', 'baro', 'gps', 'range' or 'battery'.
        """
        stamp = int(self.sensors[f"{sensor}_time_us"])
        return self.time_us - stamp if stamp else 1 << 62

    def range_m(self) -> float:
        """Return the fresh downward range (m); nan if there is none."""
        stamp_us, distance = self._range()
        return distance if stamp_us and self.time_us - stamp_us < RANGE_FRESH_US else math.nan

    def geodetic(self, position_ned: Vec3) -> Vec3:
        """Return (lat deg, lon deg, alt m above mean sea level) of a local position."""
        return ned_to_geodetic(self.origin_lat_deg, self.origin_lon_deg, self.origin_alt_m, *position_ned)
