"""One vehicle with its flight core in a compiled loop, and the record of its flight."""

import numpy as np
from numba import njit

from autopilot.control.flight_core import FlightCore, update
from autopilot.records import KIND_TRAJECTORY
from foundation.frames import quat_to_euler
from vehicles.airframe import load
from vehicles.multirotor import Multirotor, step

ORIGIN = (47.3977, 8.5456, 488.0)
UPSET = np.dtype([("gps_north_deg", "f8"), ("gps_fix_type", "i8"), ("imu_nan_until_us", "i8"), ("last_gps_us", "i8")])


@njit(cache=True)
def fly(milliseconds, vehicle, core, sensors, upset):
    """Advance plant and core together, with the sensor faults of `upset` in between."""
    for _ in range(milliseconds):
        step(*vehicle)
        if sensors.gps_time_us != upset.last_gps_us:
            upset.last_gps_us = sensors.gps_time_us
            sensors.gps_lat_deg += upset.gps_north_deg
            if upset.gps_fix_type >= 0:
                sensors.gps_fix_type = upset.gps_fix_type
        if sensors.time_us < upset.imu_nan_until_us:
            sensors.gyro_frd[1] = np.nan
        update(*core)


class Flight:
    """A vehicle on flat ground. `trace` rows every 20 ms: see `column`."""

    COLUMNS = ("time", "truth_position", "truth_velocity", "truth_euler", "position", "velocity", "euler")

    def __init__(self, name="x500", seed=1, *, milliseconds_per_row=20, **options):
        self.airframe = load(name)
        self.vehicle = Multirotor(self.airframe, seed=seed, origin=ORIGIN, **options)
        self.core = FlightCore(self.airframe)
        self.sensors, self.actuators = self.vehicle.sensors, self.vehicle.actuators
        self.upset = np.zeros(1, UPSET)[0]
        self.upset["gps_fix_type"] = -1
        self._args = (self.vehicle.kernel_args, self.core.kernel_args(self.sensors, self.actuators))
        self._row_ms = milliseconds_per_row
        self.rows = []

    @property
    def estimate(self):
        return self.core.estimate

    def run(self, seconds):
        """Let time pass; return the index of the first new row."""
        first = len(self.rows)
        for _ in range(round(1000 * seconds / self._row_ms)):
            fly(self._row_ms, *self._args, self.sensors, self.upset)
            truth, estimate = self.vehicle.truth, self.core.estimate
            self.rows.append(
                np.concatenate(
                    [
                        [truth["time_us"] * 1e-6],
                        truth["position_ned"],
                        truth["velocity_ned"],
                        quat_to_euler(tuple(truth["attitude"])),
                        estimate["position_ned"],
                        estimate["velocity_ned"],
                        quat_to_euler(tuple(estimate["attitude"])),
                    ]
                )
            )
        return first

    def column(self, name, start=0):
        """Return the recorded values of one of COLUMNS from a row on: (n,) or (n, 3)."""
        index = self.COLUMNS.index(name)
        table = np.array(self.rows[start:])
        return table[:, 0] if index == 0 else table[:, 3 * index - 2 : 3 * index + 1]

    def ask(self, kind=KIND_TRAJECTORY, armed=1, **fields):
        """Write a setpoint whose other fields are not controlled."""
        setpoint = self.core.setpoint
        for name in ("position_ned", "velocity_ned", "acceleration_ned", "yaw", "yaw_rate", "rates_frd", "thrust"):
            setpoint[name] = np.nan
        setpoint["kind"], setpoint["armed"] = kind, armed
        for name, value in fields.items():
            setpoint[name] = value

    def hover(self, height=10.0):
        """Boot, wait for the estimator, climb to `height` and settle there."""
        self.run(10.0)
        self.ask(velocity_ned=(0.0, 0.0, -1.5), yaw=0.0)
        self.run(height / 1.5)
        self.ask(position_ned=(0.0, 0.0, -height), yaw=0.0)
        self.run(7.0)
        return self
