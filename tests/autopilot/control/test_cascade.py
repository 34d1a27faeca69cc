"""The control cascade: step responses with the real physics, and reactions to invalid input."""

import itertools
import math

import numpy as np
import pytest
from numba import njit

from autopilot.control import cascade
from autopilot.control.flight_core import FlightCore, update
from autopilot.control.gains import read
from autopilot.records import ESTIMATE, KIND_ATTITUDE, KIND_IDLE, KIND_RATES, KIND_TRAJECTORY
from foundation.errors import UsageError
from foundation.frames import quat_from_euler
from foundation.sensors import ACTUATORS, SENSORS
from tests.autopilot.core_flight import Flight
from vehicles.airframe import load, names


@pytest.mark.parametrize("name", names())
def test_velocity_step_is_fast_and_well_damped(name):
    """0 → 2 m/s, close to a real PX4 (reference/px4.md: 1.4 at 0.5 s, 1.8 at 1 s, 1.95 at 3 s)."""
    flight = Flight(name).hover()
    flight.ask(velocity_ned=(2.0, 0.0, 0.0), yaw_rate=0.0)
    start = flight.run(8.0)
    v = flight.column("truth_velocity", start)
    assert 1.2 < v[24, 0] < 1.7
    assert 1.6 < v[49, 0] < 2.0
    assert v[149, 0] == pytest.approx(1.95, abs=0.06)
    assert v[:, 0].max() < 2.2
    assert v[300:, 0].mean() == pytest.approx(2.0, abs=0.04)
    assert np.abs(v[:, 1]).max() < 0.15
    assert np.abs(flight.column("truth_position", start)[:, 2] + 10.0).max() < 1.0  # no position for z: may drift
    flight.ask(velocity_ned=(0.0, 0.0, 0.0), yaw_rate=0.0)
    start = flight.run(4.0)
    v = flight.column("truth_velocity", start)
    assert v[:, 0].min() > -0.2
    assert abs(v[-1, 0]) < 0.15


@pytest.mark.parametrize("name", names())
def test_position_step_arrives_without_much_overshoot(name):
    flight = Flight(name).hover()
    goal = flight.estimate["position_ned"] + [8.0, -6.0, -4.0]
    flight.ask(position_ned=goal, yaw=1.0)
    start = flight.run(15.0)
    here = flight.column("position", start)
    assert (here[:, 0] - goal[0]).max() < 0.8
    assert (goal[2] - here[:, 2]).max() < 0.5
    assert np.linalg.norm(here[-100:] - goal, axis=1).max() < 0.3
    assert flight.column("euler")[-1, 2] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("angle", [30.0, -90.0, 90.0])
def test_yaw_rate_turns_by_rate_times_time(angle):
    flight = Flight().hover()
    before = flight.column("euler")[-1, 2]
    flight.ask(velocity_ned=(0.0, 0.0, 0.0), yaw_rate=math.copysign(math.radians(60.0), angle))
    flight.run(abs(angle) / 60.0)
    flight.ask(velocity_ned=(0.0, 0.0, 0.0), yaw_rate=0.0)
    start = flight.run(2.5)
    turned = np.degrees(flight.column("euler", start)[:, 2] - before)
    assert turned[-1] == pytest.approx(angle, abs=1.5)
    assert np.abs(turned).max() < abs(angle) + 3.0
    assert np.linalg.norm(flight.column("truth_velocity", start), axis=1).max() < 0.3


def test_speed_limits_of_mode_and_parameter():
    flight = Flight().hover()
    flight.ask(position_ned=(100.0, 0.0, -10.0), yaw=0.0, speed_limit_horizontal=4.0)
    flight.run(5.0)
    assert np.hypot(*flight.vehicle.truth["velocity_ned"][:2]) == pytest.approx(4.0, abs=0.3)
    flight.core.set_parameter("MPC_XY_VEL_MAX", 2.0)
    flight.run(5.0)
    assert np.hypot(*flight.vehicle.truth["velocity_ned"][:2]) == pytest.approx(2.0, abs=0.3)
    flight.ask(velocity_ned=(0.0, 0.0, -9.0), yaw=0.0)
    flight.run(3.0)
    assert flight.vehicle.truth["velocity_ned"][2] == pytest.approx(-3.0, abs=0.3)


@pytest.mark.parametrize("name", names())
def test_full_tilt_and_full_climb_keep_the_vehicle_upright(name):
    flight = Flight(name).hover(20.0)
    for v in ((12.0, 12.0, -3.0), (-12.0, 12.0, 1.5), (12.0, -12.0, -3.0), (0.0, 0.0, 0.0)):
        flight.ask(velocity_ned=v, yaw_rate=2.0)
        start = flight.run(2.5)
        tilt = np.degrees(np.abs(flight.column("truth_euler", start)[:, :2]))
        assert tilt.max() < 55.0
    flight.ask(velocity_ned=(0.0, 0.0, 0.0), yaw_rate=0.0)
    flight.run(4.0)
    assert np.linalg.norm(flight.vehicle.truth["velocity_ned"]) < 0.4
    assert flight.core.state["not_finite"] == 0


def test_attitude_and_rates_setpoints():
    flight = Flight().hover()
    thrust = float(flight.estimate["thrust_setpoint"])
    flight.ask(KIND_ATTITUDE, attitude=quat_from_euler(0.1, -0.05, 0.5), thrust=thrust)
    start = flight.run(1.0)
    assert flight.column("euler", start)[-1] == pytest.approx([0.1, -0.05, 0.5], abs=0.05)
    flight.ask(KIND_RATES, rates_frd=(0.0, 0.0, 0.6), thrust=thrust)
    flight.run(1.0)
    assert flight.vehicle.truth["rates_frd"] == pytest.approx([0.0, 0.0, 0.6], abs=0.1)


def test_a_nan_velocity_setpoint_stops_the_vehicle():
    """As in a real PX4, a NaN vx does not end the mode. The vehicle brakes."""
    flight = Flight().hover()
    flight.ask(velocity_ned=(2.0, 1.0, 0.0), yaw=0.0)
    flight.run(3.0)
    flight.ask(velocity_ned=(np.nan, np.nan, 0.0), yaw=0.0)
    flight.run(4.0)
    assert np.linalg.norm(flight.vehicle.truth["velocity_ned"]) < 0.2


def test_the_hover_thrust_estimate_compensates_battery_sag():
    flight = Flight().hover()
    flight.run(10.0)
    assert flight.estimate["hover_thrust"] == pytest.approx(flight.estimate["thrust_setpoint"], rel=0.05)
    assert abs(flight.core.state["velocity_integral"][2]) < 0.5


def test_disarmed_and_idle_rotors_get_no_command():
    flight = Flight().hover()
    flight.ask(KIND_IDLE, armed=1)
    flight.run(0.02)
    assert flight.actuators["armed"] == 1
    assert not flight.actuators["command"].any()
    flight.ask(KIND_TRAJECTORY, armed=0, velocity_ned=(0.0, 0.0, -3.0))
    flight.run(0.02)
    assert flight.actuators["armed"] == 0
    assert not flight.actuators["command"].any()


def test_a_low_thrust_limit_keeps_the_vehicle_on_the_ground():
    flight = Flight()
    flight.run(10.0)
    flight.ask(velocity_ned=(0.0, 0.0, -1.0), yaw=0.0, thrust_limit=0.3)
    flight.run(1.0)
    assert flight.estimate["thrust_setpoint"] <= 0.3
    assert flight.vehicle.truth["velocity_ned"] == pytest.approx([0.0, 0.0, 0.0], abs=0.02)


@njit
def drive(milliseconds, params, state, setpoint, estimate, actuators):
    for _ in range(milliseconds):
        estimate.time_us += 1000
        cascade.update(params, state, setpoint, estimate, actuators)


class Bench:
    """The cascade of an X500 alone, with an estimate written by hand."""

    def __init__(self):
        self.core = FlightCore(load("x500"))
        self.estimate = np.zeros(1, ESTIMATE)[0]
        self.estimate["attitude"] = quat_from_euler(0.05, -0.1, 0.4)
        self.estimate["accel_frd"] = (0.1, 0.0, -9.8)
        self.estimate["position_ned"] = (3.0, -2.0, -8.0)
        self.estimate["velocity_ned"] = (0.5, 0.2, -0.1)
        for name in ("attitude", "velocity", "position", "altitude"):
            self.estimate[f"{name}_valid"] = 1
        self.actuators = np.zeros(1, ACTUATORS)[0]
        self.core.setpoint["armed"] = 1

    def run(self, milliseconds):
        drive(milliseconds, self.core.params, self.core.state, self.core.setpoint, self.estimate, self.actuators)
        return self.actuators["command"][:4]


def test_every_combination_of_uncontrolled_axes_gives_commands():
    """Position, velocity, acceleration per axis, yaw and yaw rate, each controlled or not: 2048 combinations."""
    values = {"position_ned": (5.0, 1.0, -9.0), "velocity_ned": (1.0, -0.5, 0.2), "acceleration_ned": (0.3, 0.2, -0.1)}
    bench = Bench()
    setpoint = bench.core.setpoint
    for controlled in itertools.product((False, True), repeat=11):
        setpoint["kind"] = KIND_IDLE
        bench.run(1)
        setpoint["kind"] = KIND_TRAJECTORY
        for k, (name, value) in enumerate(values.items()):
            setpoint[name] = np.where(controlled[3 * k : 3 * k + 3], value, np.nan)
        setpoint["yaw"] = 0.3 if controlled[9] else np.nan
        setpoint["yaw_rate"] = 0.2 if controlled[10] else np.nan
        command = bench.run(12)
        assert np.isfinite(command).all(), controlled
        assert (command > 0.1).all(), controlled
        assert (command <= 1.0).all(), controlled
    assert bench.core.state["not_finite"] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("kind", [KIND_TRAJECTORY, KIND_ATTITUDE, KIND_RATES])
def test_invalid_inputs_never_reach_a_rotor(kind, bad):
    """Each field is invalid in turn, then all at once. After each single fault, the commands return to normal."""
    fields = [("estimate", n) for n in ("attitude", "rates_frd", "accel_frd", "velocity_ned", "position_ned")]
    fields += [
        ("setpoint", n) for n in ("position_ned", "velocity_ned", "acceleration_ned", "yaw", "yaw_rate", "attitude")
    ]
    fields += [
        ("setpoint", n) for n in ("rates_frd", "thrust", "thrust_limit", "speed_limit_up", "speed_limit_horizontal")
    ]
    bench = Bench()
    records = {"estimate": bench.estimate, "setpoint": bench.core.setpoint}
    records["setpoint"]["kind"] = kind
    records["setpoint"]["thrust"] = 0.5
    records["setpoint"]["velocity_ned"] = (0.5, 0.2, -0.1)
    good = {name: record.copy() for name, record in records.items()}

    def settle():
        for name, record in records.items():
            for field in record.dtype.names:
                if field != "time_us":
                    record[field] = good[name][field]
        records["setpoint"]["kind"] = KIND_IDLE
        bench.run(300)  # resets the filters and the integrals
        records["setpoint"]["kind"] = kind
        return bench.run(20).copy()

    undisturbed = settle()
    for owner, field in fields:
        records[owner][field] = bad
        command = bench.run(25)
        assert np.isfinite(command).all(), field
        assert (command >= 0.0).all(), field
        assert (command <= 1.0).all(), field
        assert settle() == pytest.approx(undisturbed, abs=0.01), field
    for owner, field in fields:
        records[owner][field] = bad
    assert np.isfinite(bench.run(50)).all()


@pytest.mark.parametrize("field", ["position_ned", "velocity_ned", "acceleration_ned", "yaw", "yaw_rate"])
def test_an_infinite_setpoint_does_not_crash_the_vehicle(field):
    flight = Flight().hover()
    flight.ask(**{"velocity_ned": (0.0, 0.0, 0.0), field: np.inf})
    start = flight.run(1.0)
    assert np.degrees(np.abs(flight.column("truth_euler", start)[:, :2])).max() < 50.0
    flight.ask(position_ned=(0.0, 0.0, -10.0), yaw=0.0)
    flight.run(8.0)
    assert np.linalg.norm(flight.estimate["position_ned"] - [0.0, 0.0, -10.0]) < 0.5


def test_parameters_are_set_and_read_by_their_px4_names():
    core = FlightCore(load("x500"))
    core.set_parameter("MPC_XY_VEL_MAX", 5.0)
    defaults = core.parameter_defaults()
    assert defaults["MPC_XY_VEL_MAX"] == 12.0
    assert read(core.params, "MPC_XY_VEL_MAX") == 5.0
    assert defaults["MPC_TILTMAX_AIR"] == pytest.approx(45.0)
    for name, value in defaults.items():
        assert core.set_parameter(name, value) == pytest.approx(value), name
        assert read(core.params, name) == pytest.approx(value), name
    assert core.set_parameter("MPC_TILTMAX_AIR", 500.0) == 80.0
    with pytest.raises(UsageError, match="NO_SUCH"):
        core.set_parameter("NO_SUCH", 1.0)
    with pytest.raises(UsageError, match="finite"):
        core.set_parameter("MPC_XY_P", math.nan)


def test_fast_flight_is_not_reported_as_an_obstacle():
    """Drag grows with speed, so the integral grows, and the error does not fall meanwhile."""
    flight = Flight().hover()
    blocked = 0
    for speed in (5.0, -5.0, 0.0, 5.0):
        flight.ask(velocity_ned=(speed, 0.0, 0.0), yaw=0.0)
        for _ in range(60):
            flight.run(0.1)
            blocked += flight.core.state["blocked_s"] > 0.0
    assert blocked == 0


def pushed(flight, force, rise_s, seconds=1.0):
    """Let a force (N, NED) rise within `rise_s` and hold it; return whether the autopilot reports an obstacle."""
    steps = round(seconds / 0.02)
    taken = False
    for k in range(steps):
        flight.vehicle.state["external_force"] = np.array(force) * min(0.02 * (k + 1) / rise_s, 1.0)
        flight.run(0.02)
        taken |= bool(flight.core.state["blocked_s"] > 0.0)
    return taken


@pytest.mark.parametrize("way", [(-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)])
def test_a_collision_is_distinguished_from_a_gust(way):
    force = 25.0 * np.array(way)  # N, 1.3 times the weight: stops 1.2 m/s within 0.1 s
    flight = Flight().hover()
    flight.ask(velocity_ned=(0.0, 0.0, 0.0), yaw=0.0)
    assert not pushed(flight, 0.2 * force, 0.5)
    flight.run(3.0)
    assert pushed(flight, force, 0.02, 0.1)


def test_the_rotors_stop_on_command_without_inertial_samples():
    core, sensors, actuators = FlightCore(load("x500")), np.zeros(1, SENSORS)[0], np.zeros(1, ACTUATORS)[0]
    sensors["gyro_frd"] = math.nan
    for armed, kind, command in ((1, KIND_TRAJECTORY, 0.5), (1, KIND_IDLE, 0.0), (0, KIND_TRAJECTORY, 0.0)):
        actuators["command"], actuators["armed"] = 0.5, 1
        core.setpoint["armed"], core.setpoint["kind"] = armed, kind
        update(*core.kernel_args(sensors, actuators))
        assert np.all(actuators["command"] == command)
        assert actuators["armed"] == armed
