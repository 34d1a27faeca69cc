"""Take-off, landing, return, sticks and failsafes with the kinematic stand-in for the vehicle."""

import itertools
import math

import pytest

from foundation.mavlink import MODES, dialect
from tests.autopilot.commander_bench import Bench, sticks


def landed_state(bench: Bench) -> int:
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
    return int(bench.client.of("EXTENDED_SYS_STATE")[-1].landed_state)


def test_a_flight_from_arming_to_disarming(bench: Bench) -> None:
    client = bench.client
    bench.autopilot.parameters.set("MIS_TAKEOFF_ALT", 4.0)
    assert landed_state(bench) == dialect.MAV_LANDED_STATE_ON_GROUND
    client.arm()
    bench.run(0.5)
    assert bench.core.setpoint["armed"] == 1
    assert bench.core.setpoint["kind"] == 0  # idle on the ground, although HOLD has a target
    client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.until(lambda: not bench.commander.landed, 10)
    assert landed_state(bench) == dialect.MAV_LANDED_STATE_TAKEOFF
    bench.until(lambda: bench.commander.mode == "HOLD", 20)
    bench.run(3.0)
    assert bench.height == pytest.approx(4.0, abs=0.1)
    assert landed_state(bench) == dialect.MAV_LANDED_STATE_IN_AIR
    client.command(dialect.MAV_CMD_NAV_LAND)
    bench.run(1.0)
    assert landed_state(bench) == dialect.MAV_LANDED_STATE_LANDING
    assert bench.velocity[2] == pytest.approx(0.7, abs=0.05)
    bench.until(lambda: bench.commander.landed, 20)
    touch_down = bench.time_us
    bench.until(lambda: not bench.commander.armed, 5)
    assert (bench.time_us - touch_down) * 1e-6 == pytest.approx(2.0, abs=0.2)
    assert client.arm() == 0  # the next flight needs no mode change: arming leaves LAND for HOLD
    assert bench.commander.mode == "HOLD"


def test_the_thrust_limit_rises_gradually_at_take_off(bench: Bench) -> None:
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    limits: list[float] = []
    while bench.commander.landed and len(limits) < 500:
        bench.tick()
        if bench.core.setpoint["kind"] == 1:
            limits.append(float(bench.core.setpoint["thrust_limit"]))
    assert limits[0] < 0.2
    assert limits == sorted(limits)
    assert max(b - a for a, b in itertools.pairwise(limits)) < 0.02


def test_take_off_uses_the_height_of_the_command(bench: Bench) -> None:
    bench.client.arm()
    assert bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF, *[math.nan] * 6, 488.0 + 7.0) == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 20)
    bench.run(2.0)
    assert bench.height == pytest.approx(7.0, abs=0.2)


def test_a_repeated_take_off_keeps_its_target(bench: Bench) -> None:
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.until(lambda: bench.height > 1.0, 10)
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.run(8.0)
    assert bench.height == pytest.approx(2.5, abs=0.2)


def test_a_take_off_directly_after_a_landing_is_flown(bench: Bench) -> None:
    bench.fly()
    assert bench.client.command(dialect.MAV_CMD_NAV_LAND) == 0
    bench.until(lambda: bench.commander.landed, 30)
    bench.run(1.0)
    assert bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF) == 0
    bench.run(4.0)
    assert bench.commander.armed
    assert bench.height > 1.0


def test_high_landings_begin_fast_and_end_slowly(bench: Bench) -> None:
    bench.fly(25.0)
    bench.client.command(dialect.MAV_CMD_NAV_LAND)
    bench.run(3.0)
    assert bench.velocity[2] == pytest.approx(1.5, abs=0.05)
    bench.until(lambda: bench.height < 4.0, 30)
    bench.run(0.5)
    assert bench.velocity[2] == pytest.approx(0.7, abs=0.05)


def test_hold_cancels_a_landing(bench: Bench) -> None:
    bench.fly(10.0)
    bench.client.command(dialect.MAV_CMD_NAV_LAND)
    bench.run(2.0)
    bench.client.mode(4, 3)
    bench.run(2.0)
    height = bench.height
    bench.run(3.0)
    assert bench.height == pytest.approx(height, abs=0.05)


def test_return_climbs_goes_home_and_lands(bench: Bench) -> None:
    bench.fly(5.0)
    bench.autopilot.parameters.set("RTL_RETURN_ALT", 15.0)
    bench.client.velocity(8.0, 0.0, 0.0)
    bench.client.mode(6)
    bench.run(6.0, lambda: bench.client.velocity(8.0, 0.0, 0.0))
    assert bench.core.estimate["position_ned"][0] > 30.0
    assert bench.client.command(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    bench.until(lambda: bench.height > 14.0, 20)
    bench.until(lambda: not bench.commander.armed, 90)
    assert math.hypot(*bench.core.estimate["position_ned"][:2]) < 1.5
    assert bench.commander.landed


def test_position_control_by_sticks(bench: Bench) -> None:
    bench.fly()
    assert bench.client.mode(3) == dialect.MAV_RESULT_TEMPORARILY_REJECTED  # no stick input yet
    sticks(bench)
    assert bench.client.mode(3) == 0
    bench.run(3.0, lambda: sticks(bench, x=550))  # half way beyond the deadzone: 0.4·0.5 + 0.6·0.5³ of 10 m/s
    assert bench.velocity[0] == pytest.approx(2.75, abs=0.1)
    bench.run(3.0, lambda: sticks(bench, z=1000))
    assert bench.velocity[2] == pytest.approx(-3.0, abs=0.1)
    bench.run(4.0, lambda: sticks(bench))
    assert bench.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    assert bench.client.of("HEARTBEAT")[-1].base_mode & 64


def test_loss_of_the_sticks_in_flight_causes_a_return() -> None:
    bench = Bench(profile="minimal")
    sticks(bench)
    assert bench.client.arm() == 0
    assert bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF) == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 20, lambda: sticks(bench))
    bench.run(1.0)
    assert bench.commander.mode == "HOLD"  # COM_FAIL_ACT_T
    assert bench.commander.in_failsafe
    bench.run(5.0)
    assert bench.commander.mode == "RETURN"  # NAV_RCL_ACT 2
    bench.autopilot.parameters.set("COM_RCL_EXCEPT", 2)
    assert bench.client.mode(4, 3) == 0
    bench.run(0.5)
    assert bench.commander.mode == "HOLD"


@pytest.mark.parametrize(
    ("choice", "level", "mode"),
    [(0, 0.04, "HOLD"), (2, 0.06, "LAND"), (3, 0.06, "RETURN"), (3, 0.04, "LAND"), (3, 0.10, "HOLD")],
)
def test_battery_failsafe(bench: Bench, choice: int, level: float, mode: str) -> None:
    bench.autopilot.parameters.set("COM_LOW_BAT_ACT", choice)
    bench.fly()
    bench.client.forget()
    bench.sensors["battery_remaining"] = level
    bench.run(0.5)
    assert bench.commander.mode == "HOLD"  # COM_FAIL_ACT_T
    bench.run(5.0)
    assert bench.commander.mode == mode
    assert any("battery" in text for text in bench.client.texts())


def test_the_pilot_overrides_a_battery_failsafe(bench: Bench) -> None:
    bench.autopilot.parameters.set("COM_LOW_BAT_ACT", 2)
    bench.fly()
    bench.sensors["battery_remaining"] = 0.06
    bench.run(0.5)
    assert bench.client.mode(4, 3) == 0
    bench.run(1.0)
    assert bench.commander.mode == "HOLD"
    bench.sensors["battery_remaining"] = 0.04  # a worse level triggers the failsafe again
    bench.run(5.5)
    assert bench.commander.mode == "LAND"


def test_position_loss_causes_a_landing(bench: Bench) -> None:
    bench.fly()
    bench.core.estimate["position_valid"] = bench.core.estimate["velocity_valid"] = 0
    bench.run(1.5)
    assert bench.commander.mode == "LAND"
    assert bench.velocity[2] == pytest.approx(0.7, abs=0.05)
    assert bench.commander.in_failsafe
    bench.core.converge()
    bench.run(1.3)  # a regained estimate must be valid for 1 s
    assert bench.commander.mode == "HOLD"


def test_ground_station_loss_causes_the_configured_landing(bench: Bench) -> None:
    bench.autopilot.parameters.set("NAV_DLL_ACT", 3)
    bench.fly()
    bench.run(12.0)
    assert bench.commander.mode == "HOLD"  # a link that never existed cannot be lost
    bench.client.send(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    bench.run(9.5)
    assert not bench.commander.in_failsafe
    bench.run(1.0)
    assert bench.commander.in_failsafe
    bench.run(5.0)
    assert bench.commander.mode == "LAND"


def test_modes_have_px4s_custom_mode_numbers() -> None:
    assert MODES["HOLD"].custom_mode == 50593792
    assert MODES["OFFBOARD"].custom_mode == 393216


def test_a_take_off_height_does_not_carry_over_to_the_next_flight(bench: Bench) -> None:
    nan = math.nan
    assert bench.client.arm() == 0
    for height in (518.0, 518.0):  # m above sea level (30 m of height); repeated, as after a lost answer
        assert bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, height) == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 60)
    assert bench.height == pytest.approx(30.0, abs=1.0)
    bench.client.command(dialect.MAV_CMD_NAV_LAND)
    bench.until(lambda: not bench.commander.armed, 120)
    bench.client.mode(4, 2)
    assert bench.client.arm() == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 60)
    assert bench.height == pytest.approx(2.5, abs=0.5)


def test_a_negative_speed_command_restores_the_default_cruise_speed(bench: Bench) -> None:
    bench.fly()
    usual = bench.commander.flight.cruise()
    for speed, cruise in ((3.0, 3.0), (-2.0, usual), (3.0, 3.0), (-1.0, usual)):
        assert bench.client.command(dialect.MAV_CMD_DO_CHANGE_SPEED, 1, speed, -1) == 0
        assert bench.commander.flight.cruise() == cruise
