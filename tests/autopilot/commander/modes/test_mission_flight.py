"""Missions with the kinematic stand-in for the vehicle."""

import math

import pytest

from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench
from tests.autopilot.plan_client import item, upload


def place(bench: Bench) -> tuple[float, float, float]:
    n, e, z = (float(x) for x in bench.core.estimate["position_ned"])
    return n, e, -z


def start(bench: Bench, items: list[dialect.MAVLink_message]) -> None:
    assert upload(bench.client, items) == 0
    bench.client.forget()
    assert bench.client.command(dialect.MAV_CMD_MISSION_START, 0, 0) == 0
    assert bench.commander.armed
    assert bench.commander.mode == "MISSION"


def reached(bench: Bench) -> list[int]:
    return [m.seq for m in bench.client.of("MISSION_ITEM_REACHED")]


def state(bench: Bench) -> int:
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)
    return int(bench.client.of("MISSION_CURRENT")[-1].mission_state)


def test_take_off_waypoints_and_landing(bench: Bench) -> None:
    start(bench, [item(0, 22, z=8.0), item(1, north=40.0, z=12.0, p=(2.0, 1.0, 0, 90.0)), item(2, 21, north=40.0, z=0)])
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    assert place(bench)[2] == pytest.approx(8.0, abs=1.0)
    assert abs(place(bench)[0]) < 1.0  # the climb is vertical
    assert bench.commander.mission.reached == []
    bench.until(lambda: bench.commander.mission.current == 2, 60)
    assert place(bench) == pytest.approx((40.0, 0.0, 12.0), abs=1.2)
    assert math.degrees(bench.autopilot.state.yaw) == pytest.approx(90.0, abs=12.0)
    bench.until(lambda: bench.commander.landed, 60)
    bench.run(0.2)
    assert reached(bench) == [0, 1, 2]
    bench.run(3.0)
    assert not bench.commander.armed
    assert state(bench) == dialect.MISSION_STATE_COMPLETE


def test_a_mission_that_begins_with_a_waypoint_takes_off_and_ends_with_a_return(bench: Bench) -> None:
    bench.autopilot.parameters.set("RTL_RETURN_ALT", 20.0)
    start(bench, [item(0, north=30.0, z=20.0), item(1, 178, frame=2, p=(1, 8.0, -1, 0), z=0),
                  item(2, east=30.0, z=20.0), item(3, 20, frame=2)])  # fmt: skip
    assert state(bench) == dialect.MISSION_STATE_ACTIVE
    bench.until(lambda: place(bench)[2] > 15.0, 30)
    assert abs(place(bench)[0]) < 1.0
    bench.until(lambda: bench.commander.mission.current == 2, 30)
    assert bench.commander.flight.cruise() == 8.0
    bench.until(lambda: bench.commander.mode == "RETURN", 40)
    bench.run(0.1)
    assert reached(bench) == [0, 1, 2, 3]
    assert state(bench) == dialect.MISSION_STATE_COMPLETE
    bench.until(lambda: not bench.commander.armed, 90)
    assert math.hypot(*place(bench)[:2]) < 1.5


def test_a_first_waypoint_below_the_take_off_height_is_flown_at_its_own_height(bench: Bench) -> None:
    bench.autopilot.parameters.set("MIS_TAKEOFF_ALT", 8.0)
    start(bench, [item(0, north=30.0, z=3.0)])
    bench.until(lambda: place(bench)[2] > 7.0, 30)
    assert abs(place(bench)[0]) < 1.0
    bench.until(lambda: bench.commander.mode == "HOLD", 60)
    bench.run(8.0)
    assert place(bench) == pytest.approx((30.0, 0.0, 3.0), abs=0.3)


def test_a_mission_without_an_end_item_holds_at_its_last_waypoint(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, north=25.0, z=5.0)])
    bench.until(lambda: bench.commander.mode == "HOLD", 60)
    bench.run(8.0)
    assert place(bench) == pytest.approx((25.0, 0.0, 5.0), abs=0.3)
    assert "Mission finished" in bench.client.texts()
    assert bench.client.mode(4, 4) == 0  # the mission starts again from the beginning
    assert bench.commander.mission.current == 0


def test_the_speed_of_a_mission_lasts_until_the_mode_changes(bench: Bench) -> None:
    flight, usual = bench.commander.flight, bench.commander.flight.cruise()
    slow, normal = (item(i, 178, frame=2, p=(1, speed, -1, 0), z=0) for i, speed in ((1, 3.0), (3, -1.0)))
    start(bench, [item(0, 22, z=5.0), slow, item(2, north=30.0, z=5.0), normal, item(4, north=60.0, z=5.0)])
    bench.until(lambda: bench.commander.mission.current == 2, 30)
    assert bench.client.mode(4, 4) == 0  # the mode does not change
    assert flight.cruise() == 3.0
    bench.core.estimate["position_valid"] = 0
    bench.run(0.2)
    assert bench.commander.mode == "LAND"
    assert flight.cruise() == usual
    bench.core.converge()
    bench.until(lambda: bench.commander.mode == "MISSION", 5)
    assert flight.cruise() == 3.0
    bench.until(lambda: bench.commander.mission.current == 4, 30)
    assert flight.cruise() == usual
    assert bench.client.command(dialect.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1) == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 30)
    assert flight.cruise() == usual


def test_pause_and_resume(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, north=60.0, z=5.0), item(2, north=60.0, east=60.0, z=5.0)])
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    bench.run(2.0)
    assert bench.client.mode(4, 3) == 0
    assert state(bench) == dialect.MISSION_STATE_PAUSED
    bench.run(5.0)
    there = place(bench)[0]
    assert there < 50.0
    assert bench.client.mode(4, 4) == 0
    assert bench.commander.mission.current == 1
    bench.until(lambda: bench.commander.mission.current == 2, 30)
    assert place(bench)[0] > 48.0


def test_delays_loiters_and_jumps(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, 93, frame=2, p=(3.0, -1, -1, -1)), item(2, north=5.0, z=5.0),
                  item(3, 177, frame=2, p=(1, 1, 0, 0)), item(4, 19, z=5.0, p=(4.0, 0, 0, math.nan)),
                  item(5, 17, z=5.0)])  # fmt: skip
    began: dict[int, tuple[int, int]] = {}

    def watch() -> None:
        for seq in reached(bench):
            began.setdefault(len(began), (seq, bench.time_us))
        bench.client.forget()

    bench.until(lambda: bench.commander.mission.current == 5, 90, watch)
    assert [seq for seq, _ in began.values()] == [0, 1, 2, 3, 1, 2, 3, 4]
    assert (began[1][1] - began[0][1]) * 1e-6 == pytest.approx(3.0, abs=0.2)
    bench.run(20.0)
    assert bench.commander.mode == "MISSION"  # an unlimited loiter never ends
    assert bench.client.of("HEARTBEAT")[-1].custom_mode == 0x04040000


def test_set_current_in_flight_turns_to_that_item(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, north=200.0, z=5.0), item(2, east=40.0, z=5.0)])
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    bench.client.send(dialect.MAVLink_mission_set_current_message(1, 1, 2))
    bench.until(lambda: bench.commander.mode == "HOLD", 40)
    bench.run(5.0)
    assert place(bench)[:2] == pytest.approx((0.0, 40.0), abs=2.0)


def test_a_mission_cleared_in_flight_holds(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, north=200.0, z=5.0)])
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    bench.client.send(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
    bench.run(0.5)
    assert bench.commander.mode == "HOLD"
    assert bench.client.mode(4, 4) == dialect.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_vehicle_that_cannot_fly_its_new_mission_returns(bench: Bench) -> None:
    start(bench, [item(0, 22, z=5.0), item(1, north=200.0, z=5.0)])
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    assert upload(bench.client, [item(0, north=11_000.0)]) == 0
    assert any("first waypoint too far" in text for text in bench.client.texts())
    bench.run(1.0)
    assert bench.commander.mode == "RETURN"


@pytest.mark.parametrize("far", [True, False])
def test_missions_too_far_away_or_outside_the_geofence_are_rejected(bench: Bench, far: bool) -> None:
    if far:
        bench.autopilot.parameters.set("MIS_DIST_1WP", 50.0)
    else:
        bench.autopilot.parameters.set("GF_MAX_HOR_DIST", 60.0)
    assert upload(bench.client, [item(0, north=80.0)]) == 0
    assert bench.client.command(dialect.MAV_CMD_MISSION_START) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    assert not bench.commander.armed
    assert any(("too far" if far else "geofence") in text for text in bench.client.texts())


def test_a_mission_sets_home_and_returns_there(bench: Bench) -> None:
    home = item(1, dialect.MAV_CMD_DO_SET_HOME, frame=5, p=(0, 0, 0, 0), north=30.0, z=488.0)
    start(bench, [item(0, 22, z=5.0), home, item(2, north=20.0, z=5.0), item(3, 20, frame=2, z=0)])
    bench.until(lambda: bench.commander.mode == "RETURN", 60)
    assert bench.commander.flight.home is not None
    assert bench.commander.flight.home.position_ned[:2] == pytest.approx((30.0, 0.0), abs=0.5)


def test_an_item_without_autocontinue_holds_until_another_item_is_commanded(bench: Bench) -> None:
    items = [item(0, 22, z=5.0), item(1, north=10.0, z=5.0), item(2, north=30.0, z=5.0)]
    items[1].autocontinue = 0
    start(bench, items)
    bench.run(40.0)
    assert (bench.commander.mode, reached(bench)) == ("MISSION", [0, 1])
    assert place(bench)[0] == pytest.approx(10.0, abs=1.0)
    assert bench.client.command(dialect.MAV_CMD_DO_SET_MISSION_CURRENT, 2, 0) == 0
    bench.until(lambda: bench.commander.mode == "HOLD", 60)
    bench.run(15.0)
    assert place(bench)[0] == pytest.approx(30.0, abs=1.0)


def test_commands_select_the_mission_item_that_they_name(bench: Bench) -> None:
    assert upload(bench.client, [item(k, north=20.0 * k) for k in range(4)]) == 0
    current, begin = dialect.MAV_CMD_DO_SET_MISSION_CURRENT, dialect.MAV_CMD_MISSION_START
    for command, numbers, there in (
        (current, (3, 0), 3), (current, (-1, 1), 3), (current, (2, 1), 2),
        (begin, (math.nan, 0), 2), (begin, (0, 0), 0),
    ):  # fmt: skip
        assert bench.client.command(command, *numbers) == 0
        assert bench.commander.mission.current == there
