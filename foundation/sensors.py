"""Interface between a vehicle and its autopilot: sensor samples, actuator commands, and the vehicle's true state.

The fields are those of PX4's simulator interface. A vehicle owns one record of each dtype. They are numpy records
rather than dataclasses because compiled kernels read and write them a thousand times per simulated second. For a real
PX4, `hil.simulator` converts sensor samples to HIL_SENSOR and HIL_GPS, and HIL_ACTUATOR_CONTROLS to actuator commands.
A sample is new if its `*_time_us` has changed. A time of 0 means that there is no sample yet.
"""

import numpy as np

MAX_ROTORS = 8
RANGE_M = (0.1, 12.0)  # m, range of the rangefinder: TFmini Plus data sheet

# The time (µs since 1970, UTC) that a simulated GPS receiver reports at vehicle time 0: 2026-01-01. It is the same in
# each flight, so that a flight does not depend on the date.
CALENDAR_START_US = 1_767_225_600_000_000

SENSORS = np.dtype(
    [
        ("time_us", "i8"),  # µs, vehicle clock at which this record was last written
        ("imu_time_us", "i8"),
        ("accel_frd", "f8", (3,)),  # m/s², specific force
        ("gyro_frd", "f8", (3,)),  # rad/s
        ("mag_time_us", "i8"),
        ("mag_frd", "f8", (3,)),  # gauss
        ("baro_time_us", "i8"),
        ("pressure_hpa", "f8"),  # hPa, absolute
        ("temperature_c", "f8"),  # °C
        ("gps_time_us", "i8"),  # µs, time stamp of the fix; later than its validity if `gps_late_us` delays it
        ("gps_lat_deg", "f8"),
        ("gps_lon_deg", "f8"),
        ("gps_alt_m", "f8"),  # m, above mean sea level
        ("gps_velocity_ned", "f8", (3,)),  # m/s
        ("gps_eph_m", "f8"),  # m, 1σ of the horizontal position, as the receiver reports it
        ("gps_epv_m", "f8"),  # m, 1σ of the altitude, as reported
        ("gps_speed_accuracy", "f8"),  # m/s, 1σ, as reported
        ("gps_fix_type", "i8"),  # GPS_FIX_TYPE: 0 none … 3 = 3-D
        ("gps_satellites", "i8"),
        ("range_time_us", "i8"),
        ("range_m", "f8"),  # m, downward rangefinder; nan = out of range or not fitted
        ("battery_time_us", "i8"),
        ("battery_voltage", "f8"),  # V
        ("battery_current", "f8"),  # A
        ("battery_remaining", "f8"),  # 0 … 1
    ],
    align=True,
)

ACTUATORS = np.dtype(
    [
        ("time_us", "i8"),
        ("armed", "i8"),  # 0: rotors stop
        ("command", "f8", (MAX_ROTORS,)),  # 0 … 1, fraction of full rotor speed, in the airframe's rotor order
    ],
    align=True,
)

TRUTH = np.dtype(
    [
        ("time_us", "i8"),
        ("position_ned", "f8", (3,)),  # m, map frame
        ("velocity_ned", "f8", (3,)),  # m/s
        ("attitude", "f8", (4,)),  # (w, x, y, z), FRD → NED
        ("rates_frd", "f8", (3,)),  # rad/s
        ("accel_frd", "f8", (3,)),  # m/s², specific force
    ],
    align=True,
)
