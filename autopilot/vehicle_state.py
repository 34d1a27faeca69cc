"""What the commander knows of its vehicle at one tick: the newest estimate and the raw sensor samples behind it."""

import math
import struct
from functools import cached_property
from operator import itemgetter
from typing import Any

from autopilot.records import ESTIMATE
from dronecats.border.frames import Quat, Vec3, ned_to_geodetic, quat_to_euler

FARTHEST_M = 1e6  # a local position beyond this is no position
RANGE_FRESH_US = 300_000  # the downward rangefinder samples at 10 Hz or faster; three missed samples make it stale

_LAYOUT = tuple((name, ESTIMATE[name].base.kind, math.prod(ESTIMATE[name].shape)) for name in ESTIMATE.names or ())
_FORMAT = struct.Struct("=" + "".join(f"{count}{'q' if kind == 'i' else 'd'}" for _, kind, count in _LAYOUT))


def _places() -> list[int | slice]:
    start, places = 0, list[int | slice]()
    for _, _, count in _LAYOUT:
        places.append(start if count == 1 else slice(start, start + count))
        start += count
    return places


_NAMES = tuple(name for name, _, _ in _LAYOUT)
_SORTED = itemgetter(*_places())  # the numbers of the record, in a tuple, as the values of its fields


class VehicleState:
    """A snapshot of the ESTIMATE record as plain floats and tuples (same names, units, frames); `refresh` renews it.

    Plain Python numbers are an order of magnitude faster to use than the fields of a numpy record.
    """

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
    ratio_gps_position: float
    ratio_gps_velocity: float
    ratio_baro: float
    ratio_mag: float
    attitude_setpoint: Quat
    rates_setpoint: Vec3
    thrust_setpoint: float
    hover_thrust: float

    def __init__(self, estimate: Any, sensors: Any) -> None:
        self.estimate = estimate
        self.sensors = sensors
        self._buffer = memoryview(estimate)
        self.refresh()

    def refresh(self) -> None:
        """Read the records again. Before the estimator has run once, time comes from the sensors."""
        fields = self.__dict__
        fields.update(zip(_NAMES, _SORTED(_FORMAT.unpack_from(self._buffer)), strict=True))
        fields.pop("euler", None)
        if not self.time_us:
            self.time_us = int(self.sensors["time_us"])

    @cached_property
    def euler(self) -> Vec3:
        """rad, roll, pitch and yaw; computed for the ticks that ask for it."""
        return quat_to_euler(self.attitude)

    @property
    def yaw(self) -> float:
        """rad, 0 = north."""
        return self.euler[2]

    @property
    def global_valid(self) -> bool:
        """Whether latitude, longitude and altitude may be believed."""
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
