"""The cascade's gains and limits, and what it remembers between two milliseconds."""

import numpy as np

from foundation.sensors import MAX_ROTORS

CONTROL_PARAMS = np.dtype(
    [
        ("position_p", "f8", (3,)),  # 1/s
        ("velocity_p", "f8", (3,)),  # m/s² per m/s
        ("velocity_i", "f8", (3,)),  # m/s² per m
        ("velocity_d", "f8", (3,)),  # m/s² per m/s²
        ("speed_max_horizontal", "f8"),  # m/s
        ("speed_max_up", "f8"),  # m/s
        ("speed_max_down", "f8"),  # m/s
        ("acceleration_horizontal", "f8"),  # m/s², towards a position
        ("acceleration_horizontal_max", "f8"),  # m/s², towards a velocity
        ("acceleration_up", "f8"),  # m/s²
        ("acceleration_down", "f8"),  # m/s²
        ("jerk_position", "f8"),  # m/s³, towards a position
        ("jerk_velocity", "f8"),  # m/s³, towards a velocity
        ("tilt_max", "f8"),  # rad
        ("thrust_min", "f8"),  # 0 … 1, collective, in the air
        ("thrust_max", "f8"),  # 0 … 1
        ("thrust_horizontal_margin", "f8"),  # 0 … 1, kept for the horizontal when thrust saturates
        ("hover_thrust", "f8"),  # 0 … 1, from the airframe's constants
        ("yaw_rate_auto_max", "f8"),  # rad/s, while turning to a yaw setpoint
        ("velocity_lag", "f8", (3,)),  # s, how late an acceleration follows its setpoint
        ("yaw_lag", "f8"),  # s, how late the yaw rate follows its setpoint
        ("attitude_p", "f8", (3,)),  # 1/s, roll pitch yaw
        ("yaw_weight", "f8"),  # 0 … 1
        ("rate_max", "f8", (3,)),  # rad/s
        ("torque_acceleration", "f8", (3,)),  # rad/s² of a normalised torque of 1
        ("rate_p", "f8", (3,)),  # normalised torque per rad/s
        ("rate_i", "f8", (3,)),  # normalised torque per rad
        ("rate_d", "f8", (3,)),  # normalised torque per rad/s²
        ("rate_integral_limit", "f8", (3,)),  # normalised torque
        ("gyro_cutoff_hz", "f8"),  # first-order low-pass of the rates
        ("gyro_derivative_cutoff_hz", "f8"),  # first-order low-pass of their derivative
        ("airmode", "i8"),  # 1: thrust may rise to keep roll and pitch
        ("rotors", "i8"),
        ("mix", "f8", (MAX_ROTORS, 4)),  # rotor thrust fraction per normalised roll, pitch, yaw torque and thrust
        ("rotor_thrust_min", "f8"),  # 0 … 1, fraction of a rotor's full thrust it gives at idle
    ],
    align=True,
)

CONTROL_STATE = np.dtype(
    [
        ("landed", "i8"),  # input: 1 lets the integrals rest while armed rotors stand on the ground
        ("time_us", "i8"),  # inertial sample last acted on
        ("outer_time_us", "i8"),  # when the position and velocity loops last ran
        ("attitude_time_us", "i8"),
        ("kind", "i8"),  # setpoint kind of the last tick
        ("velocity_reference", "f8", (3,)),  # m/s, smoothed velocity setpoint
        ("acceleration_reference", "f8", (3,)),  # m/s², its derivative
        ("velocity_expected", "f8", (3,)),  # m/s, what the reference makes of a vehicle with the lag it has
        ("acceleration_expected", "f8", (3,)),  # m/s², its derivative
        ("velocity_integral", "f8", (3,)),  # m/s²
        ("free_integral", "f8", (3,)),  # m/s², that it took while the velocity followed
        ("tried_integral", "f8", (3,)),  # m/s², when the push that is being tried began
        ("tried_error", "f8"),  # m/s, velocity error then
        ("blocked_s", "f8"),  # s since pushing was found to do nothing; 0: it does
        ("blocked_way", "f8", (3,)),  # unit, NED, where that push pointed
        ("unexplained", "f8", (6,)),  # m/s², rad/s², FRD, accelerations without those that the rotors make, filtered
        ("unexplained_slow", "f8", (6,)),  # what of it is slow, such as wind
        ("torque_filtered", "f8", (3,)),  # normalised, as the rotors follow it
        ("untouched_s", "f8"),  # s since the last knock
        ("acceleration_filtered", "f8", (3,)),  # m/s², NED, measured
        ("yaw_reference", "f8"),  # rad, with the lag of the yaw rate in it
        ("yaw_rate_expected", "f8"),  # rad/s, its derivative
        ("yaw_rate_reference", "f8"),  # rad/s
        ("attitude_setpoint", "f8", (4,)),
        ("thrust_setpoint", "f8"),
        ("rates_setpoint", "f8", (3,)),
        ("rates_filtered", "f8", (3,)),
        ("rates_derivative", "f8", (3,)),
        ("rate_integral", "f8", (3,)),
        ("torque", "f8", (3,)),  # normalised, what the mixer achieved
        ("torque_scale", "f8", (3,)),  # 0 … 1, achieved over wanted
        ("hover_thrust", "f8"),  # 0 … 1, running estimate
        ("thrust_filtered", "f8"),  # 0 … 1, collective as the rotors follow it
        ("not_finite", "i8"),  # times a result was not a number and the fallback flew
    ],
    align=True,
)
