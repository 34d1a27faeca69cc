"""`TABLE`: the topics of a flight log, each with its rate, its fields and the function that returns their values.

Names, fields and units are PX4's (msg/*.msg of 1.15), so that PlotJuggler, pyulog and Flight Review can use the log.
PX4 fields that this autopilot does not compute are omitted. `Readings` reads all fields of a record in one step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from autopilot.estimator.estimated_state import EstimatedState, display
from autopilot.mavlink.motion_makers import estimator_flags
from autopilot.mavlink.status_makers import TelemetrySource
from autopilot.records import HEADING_TEST, HEIGHT_TEST, KIND_TRAJECTORY, POSITION_TEST, VELOCITY_TEST
from foundation.atmosphere import pressure_altitude
from foundation.frames import GRAVITY, rotate
from foundation.record_reader import reader
from foundation.sensors import RANGE_M


class Readings:
    """The fields of a record as attributes, scalars as numbers and arrays as tuples; `refresh` updates them."""

    def __init__(self, record: Any) -> None:
        self._read, self._as_fields = reader(record, *record.dtype.names), display(record.dtype, record.dtype.names)
        self.refresh()

    def __getattr__(self, name: str) -> Any:  # called for unknown names only
        raise AttributeError(f"the record has no field {name!r}")

    def refresh(self) -> None:
        """Read the record again."""
        self.__dict__ |= self._as_fields(self._read())


NAN = math.nan

# vehicle_status.nav_state of PX4 1.15
NAV_STATES = {
    "MANUAL": 0, "ALTCTL": 1, "POSCTL": 2, "MISSION": 3, "HOLD": 4, "RETURN": 5, "ACRO": 10, "TERMINATION": 13,
    "OFFBOARD": 14, "STABILIZED": 15, "TAKEOFF": 17, "LAND": 18, "FOLLOW": 19, "PRECLAND": 20, "ORBIT": 21,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Sources:
    """The inputs of `Topic.values`."""

    vehicle: TelemetrySource
    sensors: Readings
    actuators: Readings | None

    @property
    def state(self) -> EstimatedState:
        return self.vehicle.state


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of the log. `own_fields` omits the first field of every topic, the timestamp (vehicle time, µs)."""

    name: str
    rate_hz: float
    own_fields: str
    values: Callable[[Sources], tuple[Any, ...] | None]  # None: no values now
    stamp: str | None = None  # SENSORS field with the time of the sample; only new samples are logged

    @property
    def fields(self) -> str:
        return f"uint64_t timestamp;{self.own_fields}"


def _attitude_setpoint(s: Sources) -> tuple[Any, ...]:
    v = s.state
    yaw_rate = s.vehicle.commander.passed.yaw_rate
    return (yaw_rate if math.isfinite(yaw_rate) else 0.0, *v.attitude_setpoint, 0.0, 0.0, -v.thrust_setpoint)


def _local_position(s: Sources) -> tuple[Any, ...]:
    v = s.state
    ax, ay, az = rotate(v.attitude, v.accel_frd)
    distance = v.range_m()
    return (
        v.time_us, v.origin_lat_deg, v.origin_lon_deg, *v.position_ned, *v.velocity_ned, v.velocity_ned[2],
        ax, ay, az + GRAVITY, v.yaw, v.origin_alt_m, distance, v.position_std_h, v.position_std_v, v.velocity_std_h,
        v.velocity_std_v, bool(v.position_valid), bool(v.altitude_valid), bool(v.velocity_valid),
        bool(v.velocity_valid), bool(v.origin_set), bool(v.origin_set), math.isfinite(distance),
    )  # fmt: skip


def _trajectory(s: Sources) -> tuple[Any, ...] | None:
    d = s.vehicle.commander.passed
    if d.kind != KIND_TRAJECTORY:
        return None
    return (*d.position_ned, *d.velocity_ned, *d.acceleration_ned, d.yaw, d.yaw_rate)


def _local_position_setpoint(s: Sources) -> tuple[Any, ...] | None:
    d, v = s.vehicle.commander.passed, s.state
    if d.kind != KIND_TRAJECTORY:
        return None
    thrust = rotate(v.attitude_setpoint, (0.0, 0.0, -v.thrust_setpoint))
    return (*d.position_ned, *d.velocity_ned, *d.acceleration_ned, *thrust, d.yaw, d.yaw_rate)


def _global_position(s: Sources) -> tuple[Any, ...] | None:
    v = s.state
    if not v.global_valid:
        return None
    return (v.time_us, *v.geodetic(v.position_ned), v.position_std_h, v.position_std_v)


def _gps(s: Sources) -> tuple[Any, ...]:
    r = s.sensors
    vn, ve, vd = r.gps_velocity_ned
    return (
        r.gps_time_us, r.gps_lat_deg, r.gps_lon_deg, r.gps_alt_m, r.gps_alt_m, r.gps_speed_accuracy, r.gps_eph_m,
        r.gps_epv_m, math.hypot(vn, ve), vn, ve, vd, math.atan2(ve, vn), r.gps_fix_type, True, r.gps_satellites,
    )  # fmt: skip


def _air_data(s: Sources) -> tuple[Any, ...]:
    r = s.sensors
    pressure = max(r.pressure_hpa, 1.0)
    density = pressure * 100.0 / (287.05 * (r.temperature_c + 273.15))
    return (r.baro_time_us, pressure_altitude(pressure), r.temperature_c, r.pressure_hpa * 100.0, density)


def _distance(s: Sources) -> tuple[Any, ...]:
    # type 0: laser; orientation 25: downward
    distance = s.sensors.range_m
    return (*RANGE_M, distance, 100 if math.isfinite(distance) else 0, 0, 25)


def _battery(s: Sources) -> tuple[Any, ...]:
    r, p, pack = s.sensors, s.vehicle.parameters, s.vehicle.airframe.battery
    remaining = r.battery_remaining
    warning = sum(remaining < p[name] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
    used_mah = (1.0 - remaining) * pack.capacity_ah * 1000.0
    return (True, r.battery_voltage, r.battery_current, r.battery_current, used_mah, remaining, pack.cells, warning)


def _motors(s: Sources) -> tuple[Any, ...] | None:
    a = s.actuators
    if a is None:
        return None
    count = len(s.vehicle.airframe.rotors)
    shown = a.command[:count] if a.armed else (NAN,) * count  # NaN: stopped
    return (s.state.time_us, 0, *shown, *(NAN,) * (12 - count))


def _outputs(s: Sources) -> tuple[Any, ...] | None:
    a = s.actuators
    if a is None:
        return None
    count = len(s.vehicle.airframe.rotors)
    pulses = [1000.0 + 1000.0 * u if a.armed else 900.0 for u in a.command[:count]]
    return (count, *pulses, *(0.0,) * (16 - count))


def _status(s: Sources) -> tuple[Any, ...]:
    c, v = s.vehicle.commander, s.vehicle
    return (
        c.takeoff_us, 2 if c.armed else 1, NAV_STATES.get(c.mode, 31),
        NAV_STATES.get(c.intended, 31), c.in_failsafe, 1, False, False, False, v.airframe.mav_type,
        int(v.parameters["MAV_SYS_ID"]), 1,
    )  # fmt: skip


def _land(s: Sources) -> tuple[Any, ...]:
    landed = s.vehicle.commander.landed
    return (landed, landed, landed, False)


def _estimator(s: Sources) -> tuple[Any, ...]:
    v = s.state
    return (
        v.time_us, v.position_std_h, v.position_std_v, v.innovation_over_gate(HEADING_TEST),
        v.innovation_over_gate(VELOCITY_TEST, 3), v.innovation_over_gate(POSITION_TEST, 2),
        v.innovation_over_gate(HEIGHT_TEST), estimator_flags(v), 0,
    )  # fmt: skip


def _home(s: Sources) -> tuple[Any, ...] | None:
    home = s.vehicle.commander.flight.home
    if home is None:
        return None
    return (home.lat_deg, home.lon_deg, home.alt_m, *home.position_ned, home.yaw, True, True, True)


_SAMPLE = "uint64_t timestamp_sample;"
_INNOVATIONS = _SAMPLE + "float[2] gps_hvel;float gps_vvel;float[2] gps_hpos;float baro_vpos;float heading"
TABLE: tuple[Topic, ...] = (
    Topic(
        "vehicle_attitude", 50, _SAMPLE + "float[4] q",
        lambda s: (s.state.time_us, *s.state.attitude) if s.state.attitude_valid else None,
    ),
    Topic("vehicle_angular_velocity", 50, _SAMPLE + "float[3] xyz", lambda s: (s.state.time_us, *s.state.rates_frd)),
    Topic(
        "vehicle_rates_setpoint", 50, "float roll;float pitch;float yaw;float[3] thrust_body",
        lambda s: (*s.state.rates_setpoint, 0.0, 0.0, -s.state.thrust_setpoint),
    ),
    Topic(
        "vehicle_attitude_setpoint", 50, "float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body", _attitude_setpoint
    ),
    Topic(
        "sensor_combined", 50,
        "float[3] gyro_rad;int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2",
        lambda s: (*s.sensors.gyro_frd, 0, *s.sensors.accel_frd), "imu_time_us",
    ),
    Topic(
        "vehicle_local_position", 25,
        _SAMPLE + "double ref_lat;double ref_lon;float x;float y;float z;float vx;float vy;float vz;float z_deriv;"
        "float ax;float ay;float az;float heading;float ref_alt;float dist_bottom;float eph;float epv;float evh;"
        "float evv;bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;bool xy_global;bool z_global;"
        "bool dist_bottom_valid",
        _local_position,
    ),
    Topic(
        "vehicle_local_position_setpoint", 25,
        "float x;float y;float z;float vx;float vy;float vz;float[3] acceleration;float[3] thrust;float yaw;"
        "float yawspeed",
        _local_position_setpoint,
    ),
    Topic(
        "trajectory_setpoint", 25,
        "float[3] position;float[3] velocity;float[3] acceleration;float yaw;float yawspeed", _trajectory,
    ),
    Topic("actuator_motors", 25, _SAMPLE + "uint16_t reversible_flags;float[12] control", _motors),
    Topic("actuator_outputs", 10, "uint32_t noutputs;float[16] output", _outputs),
    Topic(
        "vehicle_global_position", 10, _SAMPLE + "double lat;double lon;float alt;float eph;float epv",
        _global_position,
    ),
    Topic(
        "vehicle_gps_position", 10,
        _SAMPLE + "double latitude_deg;double longitude_deg;double altitude_msl_m;double altitude_ellipsoid_m;"
        "float s_variance_m_s;float eph;float epv;float vel_m_s;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;"
        "float cog_rad;uint8_t fix_type;bool vel_ned_valid;uint8_t satellites_used",
        _gps, "gps_time_us",
    ),
    Topic(
        "vehicle_air_data", 10,
        _SAMPLE + "float baro_alt_meter;float baro_temp_celcius;float baro_pressure_pa;float rho",
        _air_data, "baro_time_us",
    ),
    Topic(
        "vehicle_magnetometer", 10, _SAMPLE + "float[3] magnetometer_ga",
        lambda s: (s.sensors.mag_time_us, *s.sensors.mag_frd), "mag_time_us",
    ),
    Topic(
        "distance_sensor", 10,
        "float min_distance;float max_distance;float current_distance;int8_t signal_quality;uint8_t type;"
        "uint8_t orientation",
        _distance, "range_time_us",
    ),
    Topic(
        "battery_status", 5,
        "bool connected;float voltage_v;float current_a;float current_average_a;float discharged_mah;"
        "float remaining;uint8_t cell_count;uint8_t warning",
        _battery, "battery_time_us",
    ),
    Topic(
        "estimator_status", 5,
        _SAMPLE + "float pos_horiz_accuracy;float pos_vert_accuracy;float mag_test_ratio;float vel_test_ratio;"
        "float pos_test_ratio;float hgt_test_ratio;uint16_t solution_status_flags;uint32_t filter_fault_flags",
        _estimator,
    ),
    Topic("estimator_innovations", 10, _INNOVATIONS, lambda s: (s.state.time_us, *s.state.innovation)),
    Topic(
        "estimator_innovation_variances", 10, _INNOVATIONS,
        lambda s: (s.state.time_us, *s.state.innovation_variance),
    ),
    Topic("estimator_innovation_test_ratios", 10, _INNOVATIONS, lambda s: (s.state.time_us, *s.state.test_ratio)),
    Topic(
        "estimator_sensor_bias", 1, _SAMPLE + "float[3] gyro_bias;float[3] accel_bias",
        lambda s: (s.state.time_us, *s.state.gyro_bias, *s.state.accel_bias),
    ),
    Topic(
        "hover_thrust_estimate", 1, _SAMPLE + "float hover_thrust;bool valid",
        lambda s: (s.state.time_us, s.state.hover_thrust, True),
    ),
    Topic(
        "home_position", 1,
        "double lat;double lon;float alt;float x;float y;float z;float yaw;bool valid_alt;bool valid_hpos;"
        "bool valid_lpos",
        _home,
    ),
    Topic(
        "vehicle_status", 2,
        "uint64_t takeoff_time;uint8_t arming_state;uint8_t nav_state;"
        "uint8_t nav_state_user_intention;bool failsafe;uint8_t vehicle_type;bool is_vtol;bool is_vtol_tailsitter;"
        "bool in_transition_mode;uint8_t system_type;uint8_t system_id;uint8_t component_id",
        _status,
    ),
    Topic(
        "vehicle_land_detected", 2, "bool landed;bool maybe_landed;bool ground_contact;bool freefall", _land
    ),
)  # fmt: skip
