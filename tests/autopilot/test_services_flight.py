"""Mission, follow-me, orbit, sticks and a geofence with simulated physics, sensors and the estimator."""

import math

import pytest

from foundation.frames import ned_to_geodetic, wrap_pi
from foundation.mavlink import dialect
from tests.autopilot.aircraft import Aircraft
from tests.autopilot.commander_bench import ORIGIN, Client
from tests.autopilot.plan_client import item, upload


@pytest.fixture(scope="module")
def landed_craft() -> Aircraft:
    """A vehicle that has just flown a short mission and landed at home."""
    craft = Aircraft("x500", seed=4)
    craft.until(lambda: not craft.commander.arming_failures(), 15.0)
    craft.autopilot.parameters.set("RTL_RETURN_ALT", 12.0)
    plan = [item(0, 22, z=8.0), item(1, north=35.0, z=10.0), item(2, 178, frame=2, p=(1, 8.0, -1, 0), z=0),
            item(3, north=35.0, east=25.0, z=10.0, p=(1.0, 1.0, 0, math.nan)), item(4, 20, frame=2)]  # fmt: skip
    assert upload(craft.client, plan) == 0
    assert craft.client.command(dialect.MAV_CMD_MISSION_START) == 0
    craft.until(lambda: craft.commander.mission.current == 3, 60.0)
    assert math.dist(craft.truth["position_ned"], (35.0, 0.0, -10.0)) < 12.0
    craft.until(lambda: craft.commander.mode == "RETURN", 60.0)
    assert math.dist(craft.truth["position_ned"][:2], (35.0, 25.0)) < 2.5
    craft.until(lambda: not craft.commander.armed, 90.0)
    return craft


def test_the_mission_ends_at_home(landed_craft: Aircraft) -> None:
    assert math.hypot(*landed_craft.truth["position_ned"][:2]) < 2.0
    assert [m.seq for m in landed_craft.client.of("MISSION_ITEM_REACHED")] == [0, 1, 2, 3, 4]
    assert not any("Failsafe" in text for text in landed_craft.client.texts())


def test_a_mission_from_mavproxy_is_completed(landed_craft: Aircraft) -> None:
    """Sends MAVProxy 1.8.75's messages for `wp load`, `arm throttle`, `long MISSION_START`. Item 0 is the home."""
    craft, client = landed_craft, Client(landed_craft.autopilot.open_port("gcs"), 255, 230)
    start = craft.truth["position_ned"].copy()
    zeros = (0.0, 0.0, 0.0, 0.0)  # MAVProxy sets the yaw of each item to north
    plan = [item(0, 16, frame=0, p=zeros, z=ORIGIN[2]), item(1, 22, frame=3, p=zeros, z=6.0),
            item(2, 16, frame=3, p=zeros, north=25.0, z=8.0),
            item(3, 16, frame=3, p=zeros, north=25.0, east=20.0, z=8.0),
            item(4, 21, frame=3, p=zeros, north=25.0, east=20.0, z=0.0)]  # fmt: skip
    assert upload(client, plan) == 0
    assert client.mode(4, 3) == 0
    craft.until(lambda: client.arm() == 0, 10.0)
    assert client.command(dialect.MAV_CMD_MISSION_START, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == 0
    places = []
    for _ in range(900):
        craft.run(0.1)
        places.append(craft.truth["position_ned"].copy())
        if not craft.commander.armed:
            break
    assert not craft.commander.armed
    radius = craft.autopilot.parameters["NAV_ACC_RAD"]
    for place in ((25.0, 0.0, -8.0), (25.0, 20.0, -8.0)):
        assert min(math.dist(place, p) for p in places) < radius
    assert max(start[2] - p[2] for p in places) == pytest.approx(8.0, abs=1.5)
    assert places[-1][:2] == pytest.approx((25.0, 20.0), abs=2.0)
    assert places[-1][2] == pytest.approx(start[2], abs=0.3)
    assert [m.seq for m in client.of("MISSION_ITEM_REACHED")] == [0, 1, 2, 3, 4]
    assert client.of("MISSION_CURRENT")[-1].mission_state == dialect.MISSION_STATE_COMPLETE
    craft.autopilot.close_port(client.port)


def test_orbit_follow_sticks_and_geofence_in_one_flight(landed_craft: Aircraft) -> None:
    craft, client = landed_craft, landed_craft.client
    craft.take_off(8.0)
    here = craft.truth["position_ned"][:2].copy()
    assert client.command(dialect.MAV_CMD_DO_ORBIT, 10.0, 3.0, 0, math.nan, math.nan, math.nan, math.nan) == 0
    craft.run(12.0)
    distances = []
    for _ in range(40):
        craft.run(0.25)
        distances.append(math.dist(craft.truth["position_ned"][:2], here))
    assert max(distances) < 11.5
    assert min(distances) > 8.5
    assert math.hypot(*craft.truth["velocity_ned"][:2]) == pytest.approx(3.0, abs=0.5)

    craft.autopilot.parameters.set("FLW_TGT_DST", 6.0)
    assert client.mode(4, 8) == 0
    place, ticks = [20.0, -5.0], iter(range(100_000))

    def walk() -> None:
        if next(ticks) % 20 == 0:  # once a second
            place[1] += 1.5
            lat, lon, alt = ned_to_geodetic(*ORIGIN, place[0], place[1], 0.0)
            client.send(dialect.MAVLink_follow_target_message(
                0, 3, round(lat * 1e7), round(lon * 1e7), alt, [0.0, 1.5, 0.0], [0] * 3, [1, 0, 0, 0], [0] * 3,
                [0] * 3, 0))  # fmt: skip

    craft.run(30.0, walk)
    n, e, _ = (float(x) for x in craft.truth["position_ned"])
    assert n == pytest.approx(place[0], abs=1.5)
    assert e == pytest.approx(place[1] - 6.0, abs=2.5)
    assert abs(wrap_pi(craft.autopilot.state.yaw - math.pi / 2)) < 0.4

    def stick(x: int) -> None:
        client.send(dialect.MAVLink_manual_control_message(1, x, 0, 500, 0, 0))

    craft.run(1.0, lambda: stick(0))
    assert craft.commander.mode == "FOLLOW"
    craft.run(3.0, lambda: stick(600))
    assert craft.commander.mode == "POSCTL"  # COM_RC_OVERRIDE
    assert craft.truth["velocity_ned"][1] == pytest.approx(3.25, abs=0.6)
    craft.run(5.0, lambda: stick(0))
    stopped = craft.truth["position_ned"].copy()
    craft.run(4.0, lambda: stick(0))
    assert math.dist(craft.truth["position_ned"], stopped) < 0.6

    craft.autopilot.parameters.set("COM_RCL_EXCEPT", 7)
    assert client.mode(4, 3) == 0
    n, e, _ = (float(x) for x in craft.truth["position_ned"])
    assert upload(client, [item(0, 5003, p=(12.0, 0, 0, 0), north=n, east=e, kind=1)], 1) == 0
    craft.autopilot.parameters.set("GF_ACTION", 5)

    def ahead() -> None:
        client.velocity(4.0, 0.0, 0.0)

    ahead()
    assert client.mode(6) == 0
    craft.until(lambda: craft.commander.in_failsafe, 10.0, ahead)
    craft.until(lambda: not craft.commander.armed, 40.0, ahead)
    assert 11.0 < math.dist(craft.truth["position_ned"][:2], (n, e)) < 18.0
    assert any("geofence breached" in text for text in client.texts())


def test_the_vehicle_flies_towards_a_setpoint_a_thousand_kilometres_away(landed_craft: Aircraft) -> None:
    craft, client = landed_craft, landed_craft.client
    craft.autopilot.parameters.set("GF_ACTION", 0)
    craft.take_off(8.0)

    def ask() -> None:
        client.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0x9F8, 3e6, -4e6, craft.autopilot.state.position_ned[2], 0, 0, 0, 0, 0, 0, 0.0, 0.0
            )
        )

    ask()
    assert client.mode(6) == 0
    craft.run(15.0, ask)
    north, east, down = craft.truth["velocity_ned"]
    assert 0.8 * craft.autopilot.parameters["MPC_XY_VEL_MAX"] < math.hypot(north, east)
    assert math.atan2(east, north) == pytest.approx(math.atan2(-4.0, 3.0), abs=0.05)
    assert abs(down) < 0.5
    assert client.mode(4, 3) == 0
    craft.run(8.0)
    assert math.hypot(*craft.truth["velocity_ned"]) < 0.5
