"""Triggers each failsafe and checks the vehicle's action, its time and its message."""

import math

import pytest

from autopilot.commander.supervision import Conditions, Failsafe, Reaction, evaluate, reaction
from autopilot.parameters import ParameterTable
from foundation.frames import quat_from_euler
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench, put, sticks
from tests.autopilot.plan_client import item, upload

HEARTBEAT = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
FENCE_BIT = 0x100000


def has_text(bench: Bench, *words: str) -> bool:
    return any(all(word in text for word in words) for text in bench.client.texts())


def fence_healthy(bench: Bench) -> bool:
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_SYS_STATUS)
    return bool(bench.client.of("SYS_STATUS")[-1].onboard_control_sensors_health & FENCE_BIT)


def after_delay(bench: Bench, mode: str, cause: str, name: str) -> None:
    """Assert that the vehicle holds for COM_FAIL_ACT_T, then acts, and that it reports both."""
    bench.until(lambda: bench.commander.in_failsafe, 3)
    began = bench.time_us
    assert bench.commander.mode == "HOLD"
    assert has_text(bench, f"Failsafe: {cause}, {name} in 5 s")
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HEARTBEAT)
    assert bench.client.of("HEARTBEAT")[-1].system_status == dialect.MAV_STATE_CRITICAL
    bench.until(lambda: bench.commander.mode == mode, 8)
    assert (bench.time_us - began) * 1e-6 == pytest.approx(5.0, abs=0.3)
    assert any(text == f"Failsafe: {cause}, {name}" for text in bench.client.texts())


@pytest.mark.parametrize(("choice", "mode", "name"), [(2, "RETURN", "Return"), (3, "LAND", "Land")])
def test_manual_control_loss_triggers_the_configured_action(bench: Bench, choice: int, mode: str, name: str) -> None:
    put(bench, NAV_RCL_ACT=choice)
    sticks(bench)
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.until(lambda: bench.commander.mode == "HOLD", 30, lambda: sticks(bench))
    after_delay(bench, mode, "manual control lost", name)
    bench.run(1.0, lambda: sticks(bench))
    assert bench.commander.mode == mode  # the action continues when the link is back
    assert bench.client.mode(4, 3) == 0
    bench.run(0.3, lambda: sticks(bench))
    assert bench.commander.mode == "HOLD"
    assert has_text(bench, "Failsafe over")


def test_a_loss_of_sticks_that_came_after_arming_is_noticed(bench: Bench) -> None:
    bench.fly()
    bench.run(1.0, lambda: sticks(bench))
    after_delay(bench, "RETURN", "manual control lost", "Return")


@pytest.mark.parametrize("exception", [{"COM_RCL_EXCEPT": 2}, {"COM_RC_IN_MODE": 4}, {"NAV_RCL_ACT": 0}])
def test_parameters_can_disable_the_manual_control_loss_failsafe(bench: Bench, exception: dict[str, float]) -> None:
    put(bench, **exception)
    sticks(bench)
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.run(15.0)
    assert bench.commander.mode == "HOLD"
    assert not bench.commander.in_failsafe


def test_manual_control_loss_acts_only_after_the_take_off(bench: Bench) -> None:
    put(bench, MIS_TAKEOFF_ALT=6)
    sticks(bench)
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.until(lambda: bench.commander.in_failsafe, 20)
    assert bench.height == pytest.approx(6.0, abs=0.4)
    assert has_text(bench, "manual control lost")


def test_a_vehicle_without_sticks_has_no_manual_control_loss(bench: Bench) -> None:
    bench.fly()
    bench.run(3.0)
    assert not bench.commander.in_failsafe


@pytest.mark.parametrize(("choice", "mode"), [(5, "TERMINATION"), (6, None)])
def test_termination_and_disarming_act_without_delay(bench: Bench, choice: int, mode: str | None) -> None:
    put(bench, NAV_DLL_ACT=choice)
    bench.fly()
    bench.client.send(HEARTBEAT)
    bench.run(11.0)
    if mode is None:
        assert not bench.commander.armed
        assert has_text(bench, "Disarmed by failsafe")
    else:
        assert bench.commander.mode == mode
        assert bench.core.setpoint["kind"] == 0


def test_ground_station_loss_triggers_return(bench: Bench) -> None:
    put(bench, NAV_DLL_ACT=2)
    bench.fly()
    bench.client.send(HEARTBEAT)
    bench.run(9.0)
    assert not bench.commander.in_failsafe
    after_delay(bench, "RETURN", "ground station lost", "Return")
    bench.client.command(dialect.MAV_CMD_NAV_LAND)
    bench.run(1.0)
    assert bench.commander.mode == "LAND"  # a landing vehicle continues


@pytest.mark.parametrize(
    ("choice", "level", "mode", "cause", "name"),
    [(2, 0.06, "LAND", "battery at critical level", "Land"), (3, 0.06, "RETURN", "battery at critical level", "Return"),
     (3, 0.04, "LAND", "battery at emergency level", "Land")],
)  # fmt: skip
def test_low_battery_triggers_the_configured_action(
    bench: Bench, choice: int, level: float, mode: str, cause: str, name: str
) -> None:
    put(bench, COM_LOW_BAT_ACT=choice)
    bench.fly()
    bench.sensors["battery_remaining"] = 0.12
    bench.run(0.5)
    assert has_text(bench, "Warning: battery low")
    assert not bench.commander.in_failsafe
    bench.sensors["battery_remaining"] = level
    after_delay(bench, mode, cause, name)


def test_the_flight_time_limit_triggers_return(bench: Bench) -> None:
    put(bench, COM_FLT_TIME_MAX=12)
    bench.fly()
    bench.until(lambda: bench.commander.in_failsafe, 15)
    assert (bench.time_us - bench.commander.takeoff_us) * 1e-6 == pytest.approx(12.0, abs=0.3)
    after_delay(bench, "RETURN", "flight time over", "Return")


@pytest.mark.parametrize("failsafe", [{"COM_OBL_RC_ACT": 5}, {"COM_OBL_RC_ACT": 0}, {"GF_ACTION": 3}])
def test_a_termination_during_a_failsafe_stops_the_rotors(bench: Bench, failsafe: dict[str, float]) -> None:
    put(bench, GF_MAX_HOR_DIST=20, COM_FAIL_ACT_T=0, **failsafe)
    bench.fly()
    bench.client.velocity(0.0, 0.0, 0.0)
    bench.client.mode(6)
    if "GF_ACTION" in failsafe:
        bench.core.estimate["position_ned"][0] = 25.0
    bench.run(1.5)
    assert bench.commander.in_failsafe
    assert bench.client.command(dialect.MAV_CMD_DO_FLIGHTTERMINATION, 1) == 0
    bench.run(1.0)
    assert bench.commander.mode == "TERMINATION"
    assert bench.core.setpoint["kind"] == 0


@pytest.mark.parametrize(("action", "mode"), [(2, "HOLD"), (3, "RETURN"), (5, "LAND"), (4, "TERMINATION")])
def test_leaving_the_geofence_distance_triggers_the_configured_action(bench: Bench, action: int, mode: str) -> None:
    put(bench, GF_ACTION=action, GF_MAX_HOR_DIST=20)
    bench.fly()
    assert fence_healthy(bench)
    bench.client.velocity(6.0, 0.0, 0.0)
    bench.client.mode(6)
    bench.until(lambda: bench.commander.in_failsafe, 15, lambda: bench.client.velocity(6.0, 0.0, 0.0))
    assert 20.0 < bench.core.estimate["position_ned"][0] < 23.0
    assert has_text(bench, "Failsafe: geofence breached")
    assert not fence_healthy(bench)
    bench.run(5.5, lambda: bench.client.velocity(6.0, 0.0, 0.0))
    assert bench.commander.mode == mode


@pytest.mark.parametrize(("action", "mode"), [(2, "HOLD"), (3, "RETURN")])
def test_geofence_action_lasts_until_another_mode_is_chosen(bench: Bench, action: int, mode: str) -> None:
    def push() -> None:
        bench.client.velocity(6.0, 0.0, 0.0)

    put(bench, GF_ACTION=action, GF_MAX_HOR_DIST=20, RTL_RETURN_ALT=6)
    bench.fly()
    push()
    bench.client.mode(6)
    bench.until(lambda: bench.commander.mode == mode, 25, push)
    if mode == "HOLD":
        bench.core.estimate["position_ned"][0] = 14.0  # a gust
    bench.until(lambda: bench.core.estimate["position_ned"][0] < 15.0, 25, push)
    bench.run(1.0, push)
    assert bench.commander.mode == mode  # although it is inside again
    assert fence_healthy(bench)
    assert bench.client.mode(4, 5) == 0
    bench.run(1.0)
    assert not bench.commander.in_failsafe


def test_breaches_of_a_geofence_polygon_with_a_hole_are_detected(bench: Bench) -> None:
    put(bench, GF_ACTION=1)
    corners = [(-30, -30), (30, -30), (30, 30), (-30, 30)]
    plan = [item(i, 5001, p=(4, 0, 0, 0), north=n, east=e, kind=1) for i, (n, e) in enumerate(corners)]
    plan += [item(4, 5004, p=(5, 0, 0, 0), east=20.0, kind=1), item(5, 5003, p=(0, 0, 0, 0), north=4e6, kind=1)]
    assert upload(bench.client, plan, 1) == 0
    bench.fly()
    outside = {(0.0, 0.0): False, (29.0, 29.0): False, (31.0, 0.0): True, (0.0, -31.0): True, (0.0, 21.0): True,
               (0.0, 14.0): False}  # fmt: skip
    warned = False
    for (north, east), breached in outside.items():
        bench.core.estimate["position_ned"][:2] = north, east
        bench.run(0.2)
        assert bool(bench.commander.supervision.breach) is breached, (north, east)
        warned |= has_text(bench, "Warning: geofence breached")
        assert fence_healthy(bench) is not breached
    assert not bench.commander.in_failsafe  # GF_ACTION 1 warns
    assert warned


def test_arming_outside_the_geofence_is_rejected(bench: Bench) -> None:
    put(bench, GF_ACTION=3)
    assert upload(bench.client, [item(0, 5003, p=(10, 0, 0, 0), north=50.0, kind=1)], 1) == 0
    assert bench.client.arm() == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    assert has_text(bench, "outside the geofence")


@pytest.mark.parametrize(
    ("attitude", "axis"), [((0.0, 1.0, 0.0, 0.0), "roll"), ((0.8, 0.0, 0.6, 0.0), "pitch")], ids=["back", "nose"]
)
def test_a_vehicle_that_is_not_upright_cannot_arm(bench: Bench, attitude: tuple[float, ...], axis: str) -> None:
    bench.core.estimate["attitude"] = attitude
    bench.run(0.1)
    assert bench.client.arm() == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    assert has_text(bench, f"Attitude failure ({axis})")
    orbit = bench.client.command(dialect.MAV_CMD_DO_ORBIT, 10.0, 2.0, 0, math.nan, math.nan, math.nan, math.nan)
    assert orbit == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    assert not bench.commander.armed
    bench.core.estimate["attitude"] = (1.0, 0.0, 0.0, 0.0)
    bench.run(0.1)
    assert bench.client.arm() == 0


def test_position_loss_triggers_landing(bench: Bench) -> None:
    bench.fly()
    bench.core.estimate["position_valid"] = 0
    bench.run(0.5)
    assert bench.commander.mode == "LAND"
    assert has_text(bench, "Failsafe: position lost")


def test_position_loss_with_sticks_falls_back_to_altctl_then_stabilized(bench: Bench) -> None:
    bench.fly()
    sticks(bench)
    assert bench.client.mode(3) == 0
    bench.core.estimate["position_valid"] = 0
    bench.run(0.5, lambda: sticks(bench))
    assert bench.commander.mode == "ALTCTL"
    assert has_text(bench, "Failsafe: position lost")
    bench.core.estimate["altitude_valid"] = 0
    bench.run(0.5, lambda: sticks(bench))
    assert bench.commander.mode == "STABILIZED"
    bench.core.converge()
    bench.run(1.3, lambda: sticks(bench))  # a regained estimate must be good for a second
    assert bench.commander.mode == "POSCTL"


def test_position_loss_in_offboard_with_sticks_falls_back_to_altctl(bench: Bench) -> None:
    def stream() -> None:
        bench.client.velocity(1.0, 0.0, 0.0)
        sticks(bench)

    bench.fly()
    stream()
    assert bench.client.mode(6) == 0
    bench.run(0.5, stream)
    bench.core.estimate["position_valid"] = bench.core.estimate["velocity_valid"] = 0
    bench.run(0.5, stream)
    assert bench.commander.mode == "ALTCTL"


def tilt(bench: Bench, degrees: float) -> None:
    bench.core.estimate["attitude"] = quat_from_euler(math.radians(degrees), 0.0, 0.0)
    holding = lambda time_us: bench.core.estimate.__setitem__("time_us", time_us)  # noqa: E731  nothing rights it
    bench.core.step = holding  # type: ignore[method-assign]


@pytest.mark.parametrize(("breaker", "outcome"), [(0, "TERMINATION"), (121212, "HOLD")])
def test_attitude_failure_in_flight_terminates_unless_the_breaker_is_set(
    bench: Bench, breaker: int, outcome: str
) -> None:
    put(bench, CBRK_FLIGHTTERM=breaker)
    bench.fly()
    tilt(bench, 70.0)
    bench.run(0.2)
    assert bench.commander.mode == "HOLD"  # FD_FAIL_R_TTRI
    bench.run(0.4)
    assert bench.commander.mode == outcome
    assert has_text(bench, "attitude failure")


def test_attitude_failure_on_take_off_disarms(bench: Bench) -> None:
    bench.client.arm()
    bench.client.command(dialect.MAV_CMD_NAV_TAKEOFF)
    bench.run(1.0)
    tilt(bench, -70.0)
    bench.run(0.6)
    assert not bench.commander.armed
    assert has_text(bench, "Disarmed by failsafe: attitude failure")


def test_a_failsafe_acts_at_once_with_zero_delay(bench: Bench) -> None:
    put(bench, COM_LOW_BAT_ACT=2, COM_FAIL_ACT_T=0)
    bench.fly()
    bench.sensors["battery_remaining"] = 0.06
    bench.run(0.3)
    assert bench.commander.mode == "LAND"


def test_a_failsafe_on_the_ground_never_takes_off(bench: Bench) -> None:
    put(bench, COM_LOW_BAT_ACT=3, COM_FAIL_ACT_T=0)
    bench.client.arm()
    bench.sensors["battery_remaining"] = 0.06
    bench.run(8.0)
    assert bench.height == 0.0
    bench.run(4.0)
    assert not bench.commander.armed


@pytest.mark.parametrize(("choice", "mode"), [(1, "POSCTL"), (0, "HOLD"), (2, "HOLD")])
def test_stick_movement_takes_over_only_if_enabled(bench: Bench, choice: int, mode: str) -> None:
    put(bench, COM_RC_OVERRIDE=choice)
    bench.fly()
    bench.run(1.0, lambda: sticks(bench, x=100))
    assert bench.commander.mode == "HOLD"
    bench.run(1.0, lambda: sticks(bench, x=250))
    assert bench.commander.mode == "HOLD"  # less than COM_RC_STICK_OV
    bench.run(1.0, lambda: sticks(bench, x=500))
    assert bench.commander.mode == mode
    assert has_text(bench, "Pilot took over") is (mode == "POSCTL")


def test_stick_movement_is_ignored_during_the_failsafe_delay(bench: Bench) -> None:
    put(bench, COM_LOW_BAT_ACT=3)
    bench.fly()
    bench.run(0.5, lambda: sticks(bench))
    bench.sensors["battery_remaining"] = 0.06
    bench.run(1.0, lambda: sticks(bench, x=900))
    assert bench.commander.mode == "HOLD"
    bench.run(5.0, lambda: sticks(bench))
    assert bench.commander.mode == "RETURN"
    bench.run(0.5, lambda: sticks(bench, x=900))
    assert bench.commander.mode == "POSCTL"
    bench.run(1.0, lambda: sticks(bench))
    assert not bench.commander.in_failsafe


QUIET = Conditions(
    mode="HOLD", offboard_signal=True, sticks=False, sticks_lost_s=math.nan, station_lost_s=math.nan, battery=0.9,
    battery_at_arming=0.9, position_valid=True, velocity_valid=True, altitude_valid=True, flight_time_s=1.0,
    fence_breach="", attitude_failed=False, just_armed=False,
)  # fmt: skip


def test_the_more_severe_action_wins() -> None:
    p = ParameterTable()
    for name, value in {"COM_LOW_BAT_ACT": 3, "NAV_DLL_ACT": 1, "GF_ACTION": 5, "CBRK_FLIGHTTERM": 0}.items():
        p.set(name, value)
    assert evaluate(QUIET, p).action == Reaction.NONE
    c = QUIET._replace(battery=0.1)
    assert evaluate(c, p).action == Reaction.WARN
    c = c._replace(station_lost_s=11.0)
    assert evaluate(c, p).action == Reaction.HOLD
    c = c._replace(battery=0.06)
    assert evaluate(c, p).action == Reaction.RETURN
    c = c._replace(fence_breach="area")
    assert evaluate(c, p).action == Reaction.LAND
    c = c._replace(attitude_failed=True)
    assert evaluate(c, p).action == Reaction.TERMINATE
    assert evaluate(c._replace(just_armed=True), p).action == Reaction.DISARM


def test_impossible_failsafe_actions_fall_back() -> None:
    back = Failsafe("x", Reaction.RETURN)
    assert reaction(back, "HOLD", sticks=False, position=True, home=True) == ("RETURN", "RETURN")
    assert reaction(back, "HOLD", sticks=False, position=True, home=False) == ("LAND", "LAND")
    assert reaction(back, "HOLD", sticks=False, position=False, home=True) == ("LAND", "DESCEND")
    hold = Failsafe("x", Reaction.HOLD)
    assert reaction(hold, "OFFBOARD", sticks=False, position=False, home=True) == ("LAND", "DESCEND")


def test_sticks_at_rest_do_not_end_the_next_mode(bench: Bench) -> None:
    bench.fly()
    bench.run(1.0, lambda: sticks(bench))
    bench.run(1.0, lambda: sticks(bench, z=1000))
    assert bench.commander.mode == "POSCTL"
    bench.run(0.5, lambda: sticks(bench, z=900))
    bench.client.mode(4, 3)
    bench.run(1.0, lambda: sticks(bench, z=900))
    assert bench.commander.mode == "HOLD"
    bench.run(1.0, lambda: sticks(bench, z=200))
    assert bench.commander.mode == "POSCTL"


def test_a_missing_throttle_neither_climbs_nor_descends(bench: Bench) -> None:
    bench.fly(20.0)
    sticks(bench, z=32767)
    bench.client.mode(3, 0)
    height = bench.height
    bench.run(3.0, lambda: sticks(bench, z=32767))
    assert bench.commander.mode == "POSCTL"
    assert bench.height == pytest.approx(height, abs=0.3)
