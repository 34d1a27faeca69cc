"""Sensor models. Each model samples the true state at its own rate, adds errors, and writes into a SENSORS record.

The record type SENSORS is in `foundation.sensors`. The default suite models a current small autopilot board. Every
number can be set; zero switches an error off.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foundation.atmosphere import LAPSE, TEMPERATURE_0
from foundation.compiled import Grid, Record, njit
from foundation.errors import UsageError
from foundation.frames import Quat
from foundation.sensors import RANGE_M
from vehicles.faults import ACCEL, BARO, BIAS, DELAY, FAIL, FREEZE, GPS, GYRO, MAG, RANGE, active
from vehicles.ground import surface
from vehicles.records import GPS_QUEUE, STEP_US, RandomStream, ned_to_geodetic, pressure, rotate, rotate_inverse
from vehicles.solids import SolidTriangles, first_solid
from vehicles.wind import normal

BIAS_PERIOD_US = 100_000  # µs between updates of the inertial sensors' slow errors
BATTERY_PERIOD_US = 100_000
KELVIN = 273.15
GPS_ERRORS = (
    "gps_error_h", "gps_error_v", "gps_multipath_h", "gps_multipath_v", "gps_noise", "gps_velocity_noise_h",
    "gps_velocity_noise_v",
)  # fmt: skip
NOISE = (
    "accel_noise_density", "accel_random_walk", "gyro_noise_density", "gyro_random_walk", "mag_noise", "baro_noise_hpa",
    "baro_drift_hpa",
)  # fmt: skip


BOOT_ERRORS = ("accel_bias", "accel_scale", "gyro_bias", "gyro_scale", "mag_bias")


@dataclass(frozen=True, slots=True)
class Suite:
    """The sensors of a vehicle. Errors are 1σ; a `noise_density` is white noise per √Hz."""

    imu_period_us: int = 1000
    accel_noise_density: float = 1.72e-3  # m/s²/√Hz: BMI088 data sheet, 175 µg/√Hz
    accel_random_walk: float = 1.0e-3  # m/s²/√s: estimate, about 1 mg of drift in a minute
    accel_bias: float = 0.03  # m/s² at boot: remains after a field calibration
    accel_scale: float = 0.002  # relative error of the scale: remains after a field calibration
    accel_range: float = 156.9  # m/s²: ±16 g, as PX4 sets the ICM-42688-P and the BMI055; also the limit of HIL_SENSOR
    gyro_noise_density: float = 2.44e-4  # rad/s/√Hz: BMI088 data sheet, 0.014 °/s/√Hz
    gyro_random_walk: float = 3.9e-5  # rad/s/√s, 8 °/h/√s: RotorS' value for the ADIS16448
    gyro_bias: float = 0.003  # rad/s at boot: remains after a calibration at another temperature
    gyro_scale: float = 0.001  # relative error of the scale
    gyro_range: float = 34.9  # rad/s: BMI088, ±2000 °/s
    mag_period_us: int = 10_000
    mag_noise: float = 0.003  # gauss: IST8310 data sheet, 0.3 µT
    mag_bias: float = 0.004  # gauss: hard iron that remains after a calibration
    mag_declination_deg: float = 3.2  # WMM 2025 near Zurich
    mag_inclination_deg: float = 63.5  # WMM 2025 near Zurich
    mag_strength: float = 0.48  # gauss, WMM 2025 near Zurich
    baro_period_us: int = 20_000
    baro_noise_hpa: float = 0.012  # hPa, about 0.1 m: BMP388 data sheet at low oversampling
    baro_drift_hpa: float = 0.04  # hPa: weather and warming, Gauss-Markov
    # s, correlation time: the drift is about 0.1 m in a minute, as when the air pressure changes by 1 hPa per hour
    baro_drift_time_s: float = 1200.0
    gps_period_us: int = 100_000
    gps_latency_us: int = 100_000  # receiver and serial line: u-blox M8 at 10 Hz
    gps_late_us: int = 0  # unreported latency: a fix is this much older than its time stamp
    gps_error_h: float = 0.4  # m per horizontal axis: open sky with SBAS, Gauss-Markov
    gps_error_v: float = 0.8  # m, vertical
    # s, correlation time of the atmosphere's delay: 900 to 2700 s (Joerger and Pervan, NAVIGATION 2020, bounds of
    # their troposphere model)
    gps_error_time_s: float = 1800.0
    gps_multipath_h: float = 0.25  # m per horizontal axis: estimated effect of reflections in the open
    gps_multipath_v: float = 0.5  # m, vertical
    # s, correlation time of the reflections. The autocorrelation of recorded positions has a bend at a lag of about one
    # minute (D. L. Wilson, GPS accuracy page). PX4's Gazebo model uses 60 s.
    gps_multipath_time_s: float = 60.0
    gps_smoothing_s: float = 10.0  # s, estimated time constant of the receiver's filter, which uses carrier Doppler
    gps_noise: float = 0.02  # m, additional white noise
    gps_velocity_noise_h: float = 0.042  # m/s per axis: u-blox M8 data sheet, half of all fixes within 0.05 m/s
    gps_velocity_noise_v: float = 0.1  # m/s
    gps_eph_m: float = 0.7  # m, as the receiver reports it
    gps_epv_m: float = 1.1  # m, reported
    gps_speed_accuracy: float = 0.15  # m/s, reported
    gps_satellites: int = 14
    range_period_us: int = 20_000
    range_max_m: float = RANGE_M[1]  # 0: not fitted
    range_noise_m: float = 0.02  # m, estimate; data sheet of RANGE_M: ±5 cm below 6 m, ±1 % above

    def __post_init__(self) -> None:
        for name in ("imu", "mag", "baro", "gps", "range"):
            period = getattr(self, f"{name}_period_us")
            if period < STEP_US or period % STEP_US:
                raise UsageError(f"sensor suite: {name}_period_us = {period} must be a multiple of {STEP_US} µs")
        latest_us = self.gps_period_us * GPS_QUEUE
        if min(self.gps_latency_us, self.gps_late_us) < 0 or self.gps_age_us >= latest_us:
            raise UsageError(
                f"sensor suite: gps_latency_us = {self.gps_latency_us} and gps_late_us = {self.gps_late_us} must be 0"
                f" or more, and together less than {GPS_QUEUE} gps periods"
            )

    @property
    def gps_age_us(self) -> int:
        """Time (µs) from the validity of a fix to its delivery."""
        return self.gps_latency_us + self.gps_late_us

    def degraded(self, *, gps_delay_s: float = 0.0, gps_noise: float = 1.0, noise: float = 1.0) -> "Suite":
        """Return the suite with an additional, unreported delay of fixes and with larger errors.

        `gps_noise`: factor on all errors of a fix, but not on the accuracies that the receiver reports. `noise`: factor
        on white noise and drift of accelerometer, gyroscope, compass and barometer, but not on errors drawn at boot.
        Raises UsageError for a delay that is too long for the queue of fixes.
        """
        return replace(
            self,
            gps_late_us=self.gps_late_us + round(gps_delay_s * 1e6),
            **{name: getattr(self, name) * gps_noise for name in GPS_ERRORS},
            **{name: getattr(self, name) * noise for name in NOISE},
        )


_TRUE: dict[str, Any] = dict.fromkeys((*BOOT_ERRORS, *NOISE, *GPS_ERRORS, "range_noise_m"), 0.0)
PERFECT = replace(Suite(), **_TRUE)  # no errors, but with latency

SUITE = np.dtype(
    [(name, "i8" if kind in (int, "int") else "f8") for name, kind in Suite.__annotations__.items()]
    + [
        ("field_ned", "f8", (3,)),  # gauss, the earth's magnetic field
        ("origin_lat_deg", "f8"),
        ("origin_lon_deg", "f8"),
        ("origin_alt_m", "f8"),  # m above mean sea level
    ],
    align=True,
)

MEMORY = np.dtype(
    [
        ("rng", "u8", (1,)),
        ("accel_bias", "f8", (3,)),  # m/s²
        ("gyro_bias", "f8", (3,)),  # rad/s
        ("accel_scale", "f8", (3,)),  # factor
        ("gyro_scale", "f8", (3,)),
        ("mag_bias", "f8", (3,)),  # gauss
        ("baro_drift", "f8"),  # hPa
        ("gps_error", "f8", (3,)),  # m, NED, of the atmosphere
        ("gps_reflected", "f8", (3,)),  # m, NED, of reflections, before the receiver's filter
        ("gps_multipath", "f8", (3,)),  # m, NED, of reflections, after the receiver's filter
        ("accel_sum", "f8", (3,)),  # m/s², sum over the steps since the last inertial sample
        ("gyro_sum", "f8", (3,)),  # rad/s, sum over the same steps
        ("imu_steps", "i8"),  # steps in these sums
        ("accel_clipped", "i8"),  # number of clipped values so far, at most one per step and axis
        ("imu_next_us", "i8"),
        ("bias_next_us", "i8"),
        ("mag_next_us", "i8"),
        ("baro_next_us", "i8"),
        ("gps_next_us", "i8"),
        ("range_next_us", "i8"),
        ("battery_next_us", "i8"),
        ("queue_head", "i8"),  # index of the oldest fix in the queue
        ("queue_count", "i8"),
        ("queue_time_us", "i8", (GPS_QUEUE,)),  # µs, time stamp of the fix
        ("queue_due_us", "i8", (GPS_QUEUE,)),  # µs, time of delivery
        ("queue_position", "f8", (GPS_QUEUE, 3)),  # m, NED
        ("queue_velocity", "f8", (GPS_QUEUE, 3)),  # m/s, NED
    ],
    align=True,
)


def suite_record(suite: Suite, origin: tuple[float, float, float]) -> np.void:
    """Return `suite` as a SUITE record, with the map's origin (latitude, longitude in degrees, altitude in m)."""
    record: np.void = np.zeros(1, SUITE)[0]
    for name in Suite.__annotations__:
        record[name] = getattr(suite, name)
    declination, inclination = math.radians(suite.mag_declination_deg), math.radians(suite.mag_inclination_deg)
    horizontal = suite.mag_strength * math.cos(inclination)
    record["field_ned"] = (
        horizontal * math.cos(declination),
        horizontal * math.sin(declination),
        suite.mag_strength * math.sin(inclination),
    )
    record["origin_lat_deg"], record["origin_lon_deg"], record["origin_alt_m"] = origin
    return record


def fresh_memory(suite: Suite, stream: int) -> np.void:
    """Return the MEMORY record at boot: random turn-on errors, and the times of the sensors' first samples."""
    memory: np.void = np.zeros(1, MEMORY)[0]
    memory["rng"][0] = stream
    draw = np.random.Generator(np.random.PCG64(int(stream)))
    memory["accel_bias"] = suite.accel_bias * draw.standard_normal(3)
    memory["gyro_bias"] = suite.gyro_bias * draw.standard_normal(3)
    memory["accel_scale"] = 1.0 + suite.accel_scale * draw.standard_normal(3)
    memory["gyro_scale"] = 1.0 + suite.gyro_scale * draw.standard_normal(3)
    memory["mag_bias"] = suite.mag_bias * draw.standard_normal(3)
    memory["baro_drift"] = suite.baro_drift_hpa * draw.standard_normal()
    memory["gps_error"] = np.array([suite.gps_error_h, suite.gps_error_h, suite.gps_error_v]) * draw.standard_normal(3)
    multipath = (suite.gps_multipath_h, suite.gps_multipath_h, suite.gps_multipath_v)
    memory["gps_reflected"] = memory["gps_multipath"] = np.array(multipath) * draw.standard_normal(3)
    for i, name in enumerate(("imu", "mag", "baro", "gps", "range", "battery", "bias")):
        memory[f"{name}_next_us"] = STEP_US * (i + 1)  # at different steps, so that no step computes all of them
    return memory


def scale_slow_errors(memory: np.void, before: np.void, after: np.void) -> None:
    """Multiply each slow error by (1σ in the SUITE record `after`) / (1σ in `before`); by 1 if 1σ in `before` is 0."""
    for kind, wanders in (("gps_error", ("gps_error",)), ("gps_multipath", ("gps_reflected", "gps_multipath"))):
        for i, axis in enumerate("hhv"):
            for each in wanders:
                memory[each][i] *= _ratio(before[f"{kind}_{axis}"], after[f"{kind}_{axis}"])
    memory["baro_drift"] *= _ratio(before["baro_drift_hpa"], after["baro_drift_hpa"])


def _ratio(before: float, after: float) -> float:
    return after / before if before > 0.0 else 1.0


@njit(cache=True)
def _corrupt(faults: Record, row: int, value: Grid) -> None:
    """Add the bias of a fault to a vector."""
    for i in range(3):
        value[i] += faults.value[row, i]


@njit(cache=True)
def _integrate(suite: Record, memory: Record, state: Record) -> None:
    """Add one step's values, clipped to the ranges, to the sums for the next inertial sample."""
    accel_range, gyro_range = suite.accel_range, suite.gyro_range
    memory.imu_steps += 1
    for i in range(3):
        a = state.specific_force[i] * memory.accel_scale[i] + memory.accel_bias[i]
        w = state.mean_rates[i] * memory.gyro_scale[i] + memory.gyro_bias[i]
        memory.accel_sum[i] += min(max(a, -accel_range), accel_range)
        memory.gyro_sum[i] += min(max(w, -gyro_range), gyro_range)
        if abs(a) > accel_range:
            memory.accel_clipped += 1


@njit(cache=True)
def _inertial(suite: Record, memory: Record, faults: Record, state: Record, sensors: Record) -> None:
    """Write one inertial sample: the mean over the steps since the last sample, plus white noise for the period."""
    rng = memory.rng
    accel_fault, accel_row = active(faults, ACCEL, state.time_us)
    gyro_fault, gyro_row = active(faults, GYRO, state.time_us)
    share = 1.0 / memory.imu_steps
    memory.imu_steps = 0
    silent = accel_fault == FAIL or gyro_fault == FAIL
    bandwidth = 1.0 / math.sqrt(suite.imu_period_us * 1e-6)
    accel_noise, gyro_noise = suite.accel_noise_density * bandwidth, suite.gyro_noise_density * bandwidth
    accel_range, gyro_range = suite.accel_range, suite.gyro_range
    for i in range(3):
        a, w = memory.accel_sum[i] * share, memory.gyro_sum[i] * share
        memory.accel_sum[i] = memory.gyro_sum[i] = 0.0
        if silent:
            continue
        a += accel_noise * normal(rng)
        w += gyro_noise * normal(rng)
        if accel_fault == BIAS:
            a += faults.value[accel_row, i]
        if gyro_fault == BIAS:
            w += faults.value[gyro_row, i]
        if accel_fault != FREEZE:
            sensors.accel_frd[i] = min(max(a, -accel_range), accel_range)
        if gyro_fault != FREEZE:
            sensors.gyro_frd[i] = min(max(w, -gyro_range), gyro_range)
    if not silent:
        sensors.imu_time_us = sensors.time_us = state.time_us


@njit(cache=True)
def _advance_biases(suite: Record, memory: Record) -> None:
    """Advance the random walk of the inertial biases by BIAS_PERIOD_US."""
    root = math.sqrt(BIAS_PERIOD_US * 1e-6)
    for i in range(3):
        memory.accel_bias[i] += suite.accel_random_walk * root * normal(memory.rng)
        memory.gyro_bias[i] += suite.gyro_random_walk * root * normal(memory.rng)


@njit(cache=True)
def _magnetic(suite: Record, memory: Record, faults: Record, state: Record, attitude: Quat, sensors: Record) -> None:
    fault, row = active(faults, MAG, state.time_us)
    if fault == FAIL:
        return
    if fault != FREEZE:
        field = rotate_inverse(attitude, (suite.field_ned[0], suite.field_ned[1], suite.field_ned[2]))
        for i in range(3):
            sensors.mag_frd[i] = field[i] + memory.mag_bias[i] + suite.mag_noise * normal(memory.rng)
        if fault == BIAS:
            _corrupt(faults, row, sensors.mag_frd)
    sensors.mag_time_us = sensors.time_us = state.time_us


@njit(cache=True)
def _gauss_markov(value: float, sigma: float, share: float, rng: RandomStream) -> float:
    """Return the next value of a Gauss-Markov process with 1σ `sigma`. `share`: time step / correlation time."""
    keep = math.exp(-share)
    return keep * value + math.sqrt(1.0 - keep * keep) * sigma * normal(rng)


@njit(cache=True)
def _barometric(suite: Record, memory: Record, faults: Record, state: Record, sensors: Record) -> None:
    altitude = suite.origin_alt_m - state.position[2]
    share = suite.baro_period_us * 1e-6 / suite.baro_drift_time_s
    memory.baro_drift = _gauss_markov(memory.baro_drift, suite.baro_drift_hpa, share, memory.rng)
    fault, row = active(faults, BARO, state.time_us)
    if fault == FAIL:
        return
    if fault != FREEZE:
        bias = faults.value[row, 0] if fault == BIAS else 0.0
        noise = suite.baro_noise_hpa * normal(memory.rng)
        sensors.pressure_hpa = pressure(altitude) + memory.baro_drift + noise + bias
        sensors.temperature_c = TEMPERATURE_0 - KELVIN - LAPSE * altitude
    sensors.baro_time_us = sensors.time_us = state.time_us


@njit(cache=True)
def _satellite_fix(suite: Record, memory: Record, faults: Record, state: Record) -> None:
    """Compute a fix that is valid now and put it into the queue."""
    rng = memory.rng
    period_s = suite.gps_period_us * 1e-6
    smoothing = 1.0 - math.exp(-period_s / suite.gps_smoothing_s)
    for i in range(3):
        error, reflected = suite.gps_error_h, suite.gps_multipath_h
        if i == 2:
            error, reflected = suite.gps_error_v, suite.gps_multipath_v
        memory.gps_error[i] = _gauss_markov(memory.gps_error[i], error, period_s / suite.gps_error_time_s, rng)
        memory.gps_reflected[i] = _gauss_markov(
            memory.gps_reflected[i], reflected, period_s / suite.gps_multipath_time_s, rng
        )
        memory.gps_multipath[i] += (memory.gps_reflected[i] - memory.gps_multipath[i]) * smoothing
    fault, row = active(faults, GPS, state.time_us)
    if fault == FAIL or memory.queue_count == GPS_QUEUE:
        return
    slot = (memory.queue_head + memory.queue_count) % GPS_QUEUE
    last = (slot + GPS_QUEUE - 1) % GPS_QUEUE
    late = int(faults.value[row, 0] * 1e6 + 0.5) if fault == DELAY else 0
    due = state.time_us + suite.gps_latency_us + suite.gps_late_us + late
    if memory.queue_count > 0:
        due = max(due, memory.queue_due_us[last])  # fixes keep their order when a delay ends
    memory.queue_count += 1
    memory.queue_time_us[slot] = state.time_us + suite.gps_late_us
    memory.queue_due_us[slot] = due
    for i in range(3):
        if fault == FREEZE:
            memory.queue_position[slot, i] = memory.queue_position[last, i]
            memory.queue_velocity[slot, i] = memory.queue_velocity[last, i]
            continue
        noise = suite.gps_velocity_noise_h if i < 2 else suite.gps_velocity_noise_v
        bias = faults.value[row, i] if fault == BIAS else 0.0
        error = memory.gps_error[i] + memory.gps_multipath[i] + suite.gps_noise * normal(rng)
        memory.queue_position[slot, i] = state.position[i] + error + bias
        memory.queue_velocity[slot, i] = state.velocity[i] + noise * normal(rng)


@njit(cache=True)
def _satellite_delivery(suite: Record, memory: Record, now: int, sensors: Record) -> None:
    """Deliver the oldest fix in the queue."""
    slot = memory.queue_head
    memory.queue_head = (slot + 1) % GPS_QUEUE
    memory.queue_count -= 1
    lat, lon, alt = ned_to_geodetic(
        suite.origin_lat_deg,
        suite.origin_lon_deg,
        suite.origin_alt_m,
        memory.queue_position[slot, 0],
        memory.queue_position[slot, 1],
        memory.queue_position[slot, 2],
    )
    sensors.gps_lat_deg, sensors.gps_lon_deg, sensors.gps_alt_m = lat, lon, alt
    for i in range(3):
        sensors.gps_velocity_ned[i] = memory.queue_velocity[slot, i]
    sensors.gps_eph_m, sensors.gps_epv_m = suite.gps_eph_m, suite.gps_epv_m
    sensors.gps_speed_accuracy = suite.gps_speed_accuracy
    sensors.gps_fix_type = 3
    sensors.gps_satellites = suite.gps_satellites
    sensors.gps_time_us = memory.queue_time_us[slot]
    sensors.time_us = now


@njit(cache=True)
def _rangefinder(plant: Record, attitude: Quat, down: Grid, triangles: SolidTriangles) -> None:
    """Measure along the body's down axis, to the nearer of a solid and a level plane at the height of the ground."""
    suite, faults, state, solids, sensors = plant.suite, plant.faults, plant.state, plant.solids, plant.sensors
    fault, row = active(faults, RANGE, state.time_us)
    if fault == FAIL:
        return
    sensors.range_time_us = sensors.time_us = state.time_us
    if fault == FREEZE:
        return
    z, _, _ = surface(plant.params, down, state.position[0], state.position[1])
    tilt = 1.0 - 2.0 * (attitude[1] ** 2 + attitude[2] ** 2)  # cosine
    distance = (z - state.position[2]) / tilt if tilt > 0.1 else math.inf
    if solids.here != 0:
        eye, way = (state.position[0], state.position[1], state.position[2]), rotate(attitude, (0.0, 0.0, 1.0))
        distance = min(distance, first_solid(solids, triangles, state.time_us, eye, way, suite.range_max_m))
    noise = suite.range_noise_m * normal(plant.memory.rng) + (faults.value[row, 0] if fault == BIAS else 0.0)
    sensors.range_m = max(distance + noise, 0.0) if distance <= suite.range_max_m else math.nan


@njit(cache=True)
def sample(plant: Record, down: Grid, triangles: SolidTriangles) -> None:
    """Write every sample that is due at the vehicle's time into the plant's `sensors`."""
    suite, memory, faults, state, sensors = plant.suite, plant.memory, plant.faults, plant.state, plant.sensors
    now = state.time_us
    attitude = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    _integrate(suite, memory, state)
    if now >= memory.imu_next_us:
        memory.imu_next_us += suite.imu_period_us
        _inertial(suite, memory, faults, state, sensors)
    if now >= memory.bias_next_us:
        memory.bias_next_us += BIAS_PERIOD_US
        _advance_biases(suite, memory)
    if now >= memory.mag_next_us:
        memory.mag_next_us += suite.mag_period_us
        _magnetic(suite, memory, faults, state, attitude, sensors)
    if now >= memory.baro_next_us:
        memory.baro_next_us += suite.baro_period_us
        _barometric(suite, memory, faults, state, sensors)
    if now >= memory.gps_next_us:
        memory.gps_next_us += suite.gps_period_us
        _satellite_fix(suite, memory, faults, state)
    if memory.queue_count > 0 and now >= memory.queue_due_us[memory.queue_head]:
        _satellite_delivery(suite, memory, now, sensors)
    if now >= memory.range_next_us and suite.range_max_m > 0.0:
        memory.range_next_us += suite.range_period_us
        _rangefinder(plant, attitude, down, triangles)
    if now >= memory.battery_next_us:
        memory.battery_next_us += BATTERY_PERIOD_US
        sensors.battery_voltage = state.voltage
        sensors.battery_current = state.current
        sensors.battery_remaining = min(max(state.charge_ah / plant.params.capacity_ah, 0.0), 1.0)
        sensors.battery_time_us = now
        sensors.time_us = now
