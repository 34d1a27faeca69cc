"""The estimator's records: its state and its parameters (noise figures, gates, timeouts)."""

import math

import numpy as np

from autopilot.records import TESTS

MOTION = 15  # attitude error (NED) 0-2, velocity 3-5, position 6-8, gyro bias 9-11, accelerometer bias 12-14
STATES = MOTION + 2  # plus the magnetometer's hard iron along the forward and right axes
HISTORY = 128  # entries of `history`: 512 ms at one entry every 4 ms

STATUS_ALIGNING = 0
STATUS_RUNNING = 1

# PX4-like noise figures and gates. The noise densities are for a vibrating frame: 4 times (gyro) and 17 times
# (accelerometer) the BMI088's data sheet.
DEFAULTS: dict[str, int | float] = {
    "declination": 0.0558,  # rad, magnetic, east positive (EKF2_MAG_DECL, which is in deg)
    "gyro_noise": 1.0e-3,  # rad/s/√Hz
    "accel_noise": 0.03,  # m/s²/√Hz
    "gyro_bias_walk": 1.0e-4,  # rad/s/√s
    "accel_bias_walk": 2.0e-3,  # m/s²/√s
    # m/s²; a larger sample is at the accelerometer's limit of ±16 g. PX4 calls samples above 0.999 of it clipped.
    "accel_clip": 0.99 * 156.9,
    "mag_noise": 0.02,  # gauss (EKF2_MAG_NOISE)
    "mag_bias_std": 0.01,  # gauss, σ of the hard iron after a calibration; 0: not estimated
    "mag_bias_walk": 5.0e-5,  # gauss/√s (EKF2_MAG_B_NOISE)
    "baro_noise": 1.0,  # m (EKF2_BARO_NOISE)
    "gps_velocity_noise": 0.15,  # m/s, least σ of a fix (EKF2_GPS_V_NOISE)
    "gps_position_noise": 0.5,  # m, least σ of a fix (EKF2_GPS_P_NOISE)
    # Number of consecutive fixes that share one position error: they weigh as one. 18 fixes take 1.8 s. With a larger
    # number, such as the fixes of a minute, GPS weighs less: moves of 3 m are more exact, but the estimate recovers too
    # slowly from an impact.
    "gps_fixes_alike": 18.0,
    "gate_mag": 3.0,  # σ, largest accepted innovation (EKF2_HDG_GATE)
    "gate_baro": 5.0,  # σ (EKF2_BARO_GATE)
    "gate_velocity": 5.0,  # σ (EKF2_GPS_V_GATE)
    "gate_position": 5.0,  # σ (EKF2_GPS_P_GATE)
    "gps_eph_max": 3.0,  # m, a worse fix is not used (EKF2_REQ_EPH)
    "gps_epv_max": 5.0,  # m (EKF2_REQ_EPV)
    "gps_speed_accuracy_max": 0.5,  # m/s (EKF2_REQ_SACC)
    "gps_fixes_required": 10,  # good fixes in a row before the origin is set
    "timeout_us": 5_000_000,  # µs without a fused sample until a quantity is invalid (EKF2_NOAID_TOUT)
    "reset_after_us": 7_000_000,  # µs of rejected samples until the state is reset to them
    "align_us": 1_000_000,  # µs of rest, whose mean samples give the initial attitude
}
ESTIMATOR_PARAMS = np.dtype(
    [(name, "i8" if isinstance(value, int) else "f8") for name, value in DEFAULTS.items()], align=True
)

ESTIMATOR_STATE = np.dtype(
    [
        ("status", "i8"),
        ("time_us", "i8"),  # newest IMU sample used
        ("mag_time_us", "i8"),
        ("baro_time_us", "i8"),
        ("gps_time_us", "i8"),
        ("attitude", "f8", (4,)),
        ("velocity", "f8", (3,)),  # m/s, NED
        ("position", "f8", (3,)),  # m, local NED
        ("gyro_bias", "f8", (3,)),
        ("accel_bias", "f8", (3,)),
        ("mag_bias", "f8", (2,)),  # gauss, forward and right
        ("impulse", "f8", (3,)),  # m/s, ∫ specific force (NED) since the covariance was last propagated
        ("impulse_dt", "f8"),  # s, integration time of `impulse`
        ("shocked", "i8"),  # 1: `impulse` contains an impact beyond the accelerometer's limit
        ("shock_us", "i8"),  # time of the last impact
        ("reckoned_velocity", "f8", (3,)),  # m/s, from the predictions alone, never corrected by fixes
        ("reckoned_position", "f8", (3,)),  # m, from predictions alone; its change since a fix is the predicted motion
        ("history_index", "i8"),  # next entry to write
        ("history_count", "i8"),
        ("work", "f8", (STATES,)),  # P·Hᵀ of the scalar update in progress
        ("align_since_us", "i8"),
        ("align_count", "i8"),
        ("align_accel", "f8", (3,)),  # this and the fields up to align_baro_count: sums over the alignment window
        ("align_gyro", "f8", (3,)),
        ("align_gyro_squared", "f8"),
        ("align_mag", "f8", (3,)),
        ("align_mag_count", "i8"),
        ("align_baro", "f8"),
        ("align_baro_count", "i8"),
        ("align_attempts", "i8"),
        ("baro_reference_m", "f8"),  # pressure altitude at z = 0
        ("gps_good_fixes", "i8"),
        ("origin_set", "i8"),
        ("origin_lat_deg", "f8"),
        ("origin_lon_deg", "f8"),
        ("origin_alt_m", "f8"),
        ("position_fused_us", "i8"),  # µs of the last accepted sample, 0 = never; likewise the next four fields
        ("velocity_fused_us", "i8"),
        ("baro_fused_us", "i8"),
        ("mag_fused_us", "i8"),
        ("still_fused_us", "i8"),
        ("innovation", "f8", (TESTS,)),  # of the newest samples, m/s, m and rad
        ("innovation_variance", "f8", (TESTS,)),
        ("test_ratio", "f8", (TESTS,)),  # innovation² over (gate² · variance), as in PX4's logs
        ("resets", "i8"),  # number of times that heading, height, velocity or position was set to the measured value
        ("rejected", "i8"),  # number of headings, heights, positions beyond their gate
        ("bad_samples", "i8"),  # samples that were not finite, and pressures out of range
        ("restarts", "i8"),  # number of alignments because the state was not finite
        ("published_us", "i8"),  # when deviations and ratios were last written to the ESTIMATE record
        ("looked_accel", "f8", (3,)),  # m/s², accel_frd at `published_us`
        ("looked_rates", "f8", (3,)),  # rad/s, rates_frd at `published_us`
    ],
    align=True,
)


def default_parameters() -> np.void:
    """Return ESTIMATOR_PARAMS with the values of DEFAULTS."""
    params: np.void = np.array([tuple(DEFAULTS.values())], ESTIMATOR_PARAMS)[0]
    return params


def initial_state() -> np.void:
    """Return the ESTIMATOR_STATE of a filter before its first sample: level, north, at rest."""
    state: np.void = np.zeros(1, ESTIMATOR_STATE)[0]
    state["attitude"] = (1.0, 0.0, 0.0, 0.0)
    state["baro_reference_m"] = math.nan
    return state
