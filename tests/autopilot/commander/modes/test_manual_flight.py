"""The effect of the sticks in each manual mode."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.commander.modes.manual import shaped, super_expo, throttle_thrust, within_circle
from autopilot.parameters import ParameterTable
from autopilot.records import KIND_ATTITUDE, KIND_RATES
from foundation.frames import quat_to_euler
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench

P = ParameterTable()


def fly_mode(bench: Bench, main: int, seconds: float = 1.0, **axes: int) -> None:
    """Fly the mode with these stick positions."""
    values = {"x": 0, "y": 0, "z": 500, "r": 0} | axes

    def send() -> None:
        bench.client.send(dialect.MAVLink_manual_control_message(1, *(values[k] for k in "xyzr"), 0))

    send()
    assert bench.client.mode(main) == 0
    bench.run(seconds, send)


def test_position_control_directions_and_speeds(bench: Bench) -> None:
    bench.autopilot.parameters.set("MPC_VEL_MAN_BACK", 4.0)
    bench.autopilot.parameters.set("MPC_VEL_MAN_SIDE", 6.0)
    bench.fly(10.0)
    fly_mode(bench, 3, 3.0, x=1000)
    assert bench.velocity[0] == pytest.approx(10.0, abs=0.2)
    fly_mode(bench, 3, 3.0, x=-1000)
    assert bench.velocity[0] == pytest.approx(-4.0, abs=0.2)
    fly_mode(bench, 3, 3.0, y=1000)
    assert bench.velocity[1] == pytest.approx(6.0, abs=0.2)
    fly_mode(bench, 3, 2.0, z=0)
    assert bench.velocity[2] == pytest.approx(1.5, abs=0.1)


def test_centred_sticks_hold_the_position(bench: Bench) -> None:
    bench.fly(10.0)
    fly_mode(bench, 3, 3.0, x=1000)
    fly_mode(bench, 3, 3.0)
    held = tuple(bench.core.setpoint["position_ned"])
    assert all(math.isfinite(x) for x in held)
    fly_mode(bench, 3, 3.0, x=60, y=-60)  # within MPC_HOLD_DZ
    assert tuple(bench.core.setpoint["position_ned"]) == held
    fly_mode(bench, 3, 0.5, z=800)
    held = bench.core.setpoint["position_ned"]
    assert math.isfinite(held[0])
    assert math.isnan(held[2])


def test_altitude_control_tilts_and_keeps_the_height(bench: Bench) -> None:
    bench.fly(10.0)
    fly_mode(bench, 2, 1.0, x=1000)
    wanted = 9.80665 * math.tan(math.radians(35.0))
    assert bench.core.setpoint["acceleration_ned"][0] == pytest.approx(wanted, rel=1e-3)
    assert math.isnan(bench.core.setpoint["velocity_ned"][0])
    assert math.isfinite(bench.core.setpoint["position_ned"][2])
    fly_mode(bench, 2, 1.0, z=1000)
    assert bench.core.setpoint["velocity_ned"][2] == pytest.approx(-3.0)


def test_stabilized_mode_commands_attitude_and_thrust(bench: Bench) -> None:
    bench.fly(10.0)
    fly_mode(bench, 7, 0.5, x=500, y=-500)
    assert bench.core.setpoint["kind"] == KIND_ATTITUDE
    roll, pitch, _ = quat_to_euler(tuple(bench.core.setpoint["attitude"]))
    assert math.degrees(roll) == pytest.approx(-17.5, abs=0.5)
    assert math.degrees(pitch) == pytest.approx(-17.5, abs=0.5)
    assert bench.core.setpoint["thrust"] == pytest.approx(0.5)


def test_acro_mode_commands_rates(bench: Bench) -> None:
    bench.fly(10.0)
    fly_mode(bench, 5, 0.5, x=1000, y=500, r=-1000, z=1000)
    s = bench.core.setpoint
    assert s["kind"] == KIND_RATES
    assert [math.degrees(x) for x in s["rates_frd"]] == pytest.approx([50.0, -100.0, -100.0])
    assert s["thrust"] == pytest.approx(1.0)


def test_take_off_and_landing_by_hand(bench: Bench) -> None:
    fly_mode(bench, 3, 0.2)
    assert bench.client.arm() == 0
    fly_mode(bench, 3, 6.0, z=900)
    assert bench.height > 1.0
    fly_mode(bench, 3, 12.0, z=0)
    assert bench.commander.landed
    fly_mode(bench, 3, 3.0, z=0)
    assert not bench.commander.armed


@given(st.floats(-1, 1))
def test_stick_curves_are_odd_bounded_and_increasing(x: float) -> None:
    for curve in (lambda v: shaped(v, P, "MPC_XY_MAN_EXPO"), lambda v: super_expo(v, 0.69, 0.7)):
        y = curve(x)
        assert abs(y) <= 1.0 + 1e-12
        assert curve(-x) == pytest.approx(-y)
        assert curve(min(x + 0.01, 1.0)) >= y - 1e-12
    assert super_expo(1.0, 0.0, 1.0) == super_expo(1.0, 0.0, 5.0) == pytest.approx(1.0)  # extra is limited
    assert shaped(1.0, P, "MPC_YAW_EXPO") == pytest.approx(1.0)
    assert shaped(0.1, P, "MPC_YAW_EXPO") == 0.0


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_diagonal_stick_input_is_limited_to_the_unit_circle(x: float, y: float) -> None:
    a, b = within_circle(x, y)
    assert math.hypot(a, b) <= 1.0 + 1e-12
    assert a * y == pytest.approx(b * x, abs=1e-12)


def test_throttle_curve() -> None:
    assert throttle_thrust(0.0, 0.4, P) == pytest.approx(0.08)
    assert throttle_thrust(0.5, 0.4, P) == pytest.approx(0.4)
    assert throttle_thrust(1.0, 0.4, P) == pytest.approx(1.0)
