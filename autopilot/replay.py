"""Runs the estimator and the cascade again on the samples and setpoints of a recorded flight.

A recording has a row per inertial sample. `save` stores each sample once, with the row in which it arrived. Inertial
and magnetic samples are in single precision. Setpoints are stored when they change, the landed flag for every row.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autopilot.control.flight_core import FlightCore, update
from autopilot.records import SETPOINT
from foundation.errors import UsageError
from foundation.sensors import ACTUATORS, SENSORS

# sensor → field with the time of its sample, fields of a sample, whether they are stored in single precision
GROUPS = {
    "imu": ("imu_time_us", ("accel_frd", "gyro_frd"), True),
    "mag": ("mag_time_us", ("mag_frd",), True),
    "baro": ("baro_time_us", ("pressure_hpa", "temperature_c"), False),
    "gps": (
        "gps_time_us",
        ("gps_lat_deg", "gps_lon_deg", "gps_alt_m", "gps_velocity_ned", "gps_eph_m", "gps_epv_m",
         "gps_speed_accuracy", "gps_fix_type", "gps_satellites"),
        False,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The inputs of the inner loop (estimator and cascade) in one flight."""

    airframe: str
    sensors: NDArray[Any]  # (n,) SENSORS
    setpoints: NDArray[Any]  # (n,) SETPOINT
    landed: NDArray[np.bool_]  # (n,)


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedFlight:
    """The inner loop's outputs at m rows of a recording."""

    time_us: NDArray[np.int64]  # (m,)
    position_ned: NDArray[np.float64]  # (m, 3) m
    velocity_ned: NDArray[np.float64]  # (m, 3) m/s
    attitude: NDArray[np.float64]  # (m, 4) w, x, y, z, FRD → NED
    gyro_bias: NDArray[np.float64]  # (m, 3) rad/s
    accel_bias: NDArray[np.float64]  # (m, 3) m/s²
    rates_setpoint: NDArray[np.float64]  # (m, 3) rad/s
    thrust_setpoint: NDArray[np.float64]  # (m,) fraction of full thrust
    command: NDArray[np.float64]  # (m, 8) command of each actuator, 0 … 1


def save(recording: Recording, path: Path, **extra: NDArray[Any]) -> None:
    """Write a recording, and other arrays beside it, as a compressed npz file."""
    arrays: dict[str, Any] = {"airframe": np.array(recording.airframe), "time_us": recording.sensors["time_us"]}
    for name, (clock, fields, single) in GROUPS.items():
        times = recording.sensors[clock]
        rows = np.flatnonzero(np.diff(times, prepend=0) != 0)
        arrays[f"{name}.row"], arrays[f"{name}.{clock}"] = rows.astype(np.int32), times[rows]
        for field in fields:
            values = recording.sensors[field][rows]
            arrays[f"{name}.{field}"] = values.astype(np.float32) if single else values
    raw = recording.setpoints.view(np.uint8).reshape(len(recording.setpoints), -1)
    rows = np.flatnonzero(np.r_[True, (raw[1:] != raw[:-1]).any(axis=1)])
    arrays["setpoint.row"] = rows.astype(np.int32)
    for field in SETPOINT.names or ():
        arrays[f"setpoint.{field}"] = recording.setpoints[field][rows]
    arrays["landed"] = np.packbits(recording.landed)
    np.savez_compressed(path, **(arrays | extra))


def load(path: Path) -> tuple[Recording, dict[str, NDArray[Any]]]:
    """Return a recording and the other arrays of its file. Raises UsageError when the file is no recording."""
    try:
        with np.load(path) as file:
            arrays = dict(file)
        count = len(arrays["time_us"])
        sensors = np.zeros(count, SENSORS)
        sensors["time_us"], sensors["range_m"] = arrays.pop("time_us"), np.nan
        for name, (clock, fields, _) in GROUPS.items():
            held = _held(arrays.pop(f"{name}.row"), count)
            for field in (clock, *fields):
                values = arrays.pop(f"{name}.{field}")
                sensors[field][held >= 0] = values[held[held >= 0]]
        setpoints = np.zeros(count, SETPOINT)
        held = _held(arrays.pop("setpoint.row"), count)
        for field in SETPOINT.names or ():
            setpoints[field] = arrays.pop(f"setpoint.{field}")[held]
        landed = np.unpackbits(arrays.pop("landed"), count=count).astype(bool)
        return Recording(str(arrays.pop("airframe")), sensors, setpoints, landed), arrays
    except (OSError, KeyError, ValueError, EOFError) as error:
        raise UsageError(
            f"{path} is not a recording of a flight ({error}): make one with tests/autopilot/replay/record.py"
        ) from error


def replay(core: FlightCore, recording: Recording, every: int) -> ReplayedFlight:
    """Return the outputs of `core` at every `every`-th row of a recording. `core` must be new; its state changes."""
    sample, actuators = np.zeros(1, SENSORS), np.zeros(1, ACTUATORS)[0]
    arguments = core.kernel_args(sample[0], actuators)  # `sample[0]` is a view: it follows `sample`
    kept: dict[str, list[Any]] = {name: [] for name in ReplayedFlight.__slots__}
    for row in range(len(recording.sensors)):
        sample[0] = recording.sensors[row]
        for field in SETPOINT.names or ():
            core.setpoint[field] = recording.setpoints[field][row]
        core.state["landed"] = recording.landed[row]
        update(*arguments)
        if row % every == every - 1:
            for name, values in kept.items():
                source = actuators if name == "command" else core.estimate
                values.append(np.copy(source[name]))
    return ReplayedFlight(**{name: np.array(values) for name, values in kept.items()})


def _held(rows: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """Return, for each of `count` rows, the index in `rows` of the last entry at or before that row; -1: none."""
    return np.searchsorted(rows, np.arange(count), side="right") - 1
