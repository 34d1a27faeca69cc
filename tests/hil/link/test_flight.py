"""The messages that the link sends to its own vehicle, and the end of that control."""

from typing import Any

import pytest

from foundation.errors import LinkError
from foundation.frames import quat_from_euler
from foundation.mavlink import dialect
from foundation.setpoints import Hold, Velocity
from hil.link.envelope import Limits
from hil.link.link import EnvelopeError, Link
from tests.hil.link.scripted_vehicle import ScriptedVehicle, flying


@pytest.fixture
def vehicle():
    return ScriptedVehicle()


def test_a_setpoint_is_streamed_before_the_mode_is_asked_for(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    link.start_offboard()
    mode_index = next(i for i, c in enumerate(vehicle.commands) if c[0] == 176)
    assert vehicle.commands[mode_index][1:] == (1, 6, 0)
    assert vehicle.setpoints, "PX4 refuses offboard without a setpoint"


def test_a_picture_is_bound_to_how_the_vehicle_leaned_when_it_was_taken(vehicle):
    vehicle.lean = (0.1, -0.2)
    link = flying(vehicle)
    taken_us = link.time_us
    vehicle.lean = (0.0, 0.3)
    link.wait(1.0)
    sight = link.sight(taken_us)
    assert (sight.roll, sight.pitch) == pytest.approx((0.1, -0.2), abs=1e-6)


def test_a_gimbal_between_two_reports_of_the_vehicle_is_of_its_own_time(vehicle):
    link = flying(vehicle)
    for pitch in (-0.2, -0.4):
        turned = quat_from_euler(0.0, pitch, 0.0)
        vehicle.say(
            dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, vehicle.time_ms + 10, 0, turned, 0, 0, 0, 0)
        )
        link.wait(0.1)
    newest_us = vehicle.time_ms * 1000 - 100_000 + 10_000
    assert link.track.at(newest_us).gimbal_pitch == pytest.approx(-0.4)
    assert link.track.at(newest_us - 50_000).gimbal_pitch == pytest.approx(-0.3, abs=0.005)


def test_telemetry_that_newer_has_overtaken_is_of_its_own_time(vehicle):
    """On a wire that reorders messages, an old one reports an earlier position, not the current one."""
    link = flying(vehicle)
    late_ms, (north, east, down) = vehicle.time_ms + 20, vehicle.position
    position = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    vehicle.silent.add(position)
    link.wait(0.06)
    vehicle.silent.clear()
    link.wait(0.06)
    here, told_us = link.state.position_ned, link.state.position_us
    vehicle.say(dialect.MAVLink_local_position_ned_message(late_ms, north - 7.0, east, down, 0, 0, 0))
    link.listen()
    assert (link.state.position_ned, link.state.position_us) == (here, told_us)
    assert link.sight(late_ms * 1000).position_ned[0] == pytest.approx(north - 7.0)
    assert link.sight(link.time_us).position_ned[0] == pytest.approx(here[0], abs=0.05)


def test_offboard_is_requested_again_until_the_stream_has_arrived(vehicle):
    vehicle.refuses[176] = (1, "Mode OFFBOARD refused: no offboard signal")
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    link.on_setpoint = lambda target: vehicle.refuses.clear() if len(vehicle.setpoints) > 5 else None
    link.start_offboard()
    assert vehicle.mode == "OFFBOARD"
    assert sum(c[0] == 176 for c in vehicle.commands) > 1


@pytest.mark.parametrize(("result", "attempts"), [(1, range(3, 20)), (2, range(1, 2))])
def test_a_lasting_refusal_of_offboard_is_reported_in_the_autopilots_words(vehicle, result, attempts):
    vehicle.refuses[176] = (result, "no valid position")
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    with pytest.raises(LinkError, match=r"OFFBOARD.*no valid position"):
        link.start_offboard()
    assert sum(c[0] == 176 for c in vehicle.commands) in attempts


def test_the_stream_runs_at_twenty_hertz_of_vehicle_time(vehicle):
    link = flying(vehicle)
    before = len(vehicle.setpoints)
    link.wait(2.0)
    assert len(vehicle.setpoints) - before == pytest.approx(40, abs=1)


def test_giving_up_stands_still_before_anything_else(vehicle):
    link = flying(vehicle)
    began = vehicle.time_ms
    link.give_up("hold")
    after = [m for t, m in vehicle.setpoints if t > began]
    assert after
    assert all(m.coordinate_frame == 1 for m in after)  # a place to hold, no velocity any more
    assert vehicle.mode == "HOLD"


def test_a_decision_that_is_over_leaves_no_velocity(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 2.5)
    link.start_offboard()
    link.wait(6.0)  # no new decisions come
    assert vehicle.setpoints[-1][1].coordinate_frame == 1
    moving = [t for t, m in vehicle.setpoints if m.coordinate_frame == 8]
    assert (moving[-1] - moving[0]) / 1000 <= 2.75


def test_after_a_gap_nothing_is_sent_until_the_mode_is_known_again(vehicle):
    link = flying(vehicle)
    vehicle.time_ms += 4010  # the cable was out; events of that time are unknown
    vehicle.silent = {dialect.MAVLINK_MSG_ID_HEARTBEAT}
    sent = len(vehicle.setpoints)
    link.wait(2.0)
    assert len(vehicle.setpoints) == sent
    vehicle.silent = set()
    vehicle.say(vehicle.heartbeat())
    link.wait(1.0)
    assert len(vehicle.setpoints) > sent


def test_a_reboot_is_noticed(vehicle):
    vehicle.time_ms = 400_000
    link = flying(vehicle)
    vehicle.time_ms, vehicle.mode, vehicle.armed = 1_000, "HOLD", False
    with pytest.raises(LinkError, match="rebooted"):
        link.wait(5.0)
    link.connect(10.0)
    assert not link.state.armed
    assert link.time_us < 10_000_000


def test_a_refusal_has_the_autopilots_words(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    vehicle.refuses[22] = (1, "Takeoff denied! No valid position")
    with pytest.raises(LinkError, match=r"take-off.*No valid position"):
        link.order("take-off", 22)


def test_old_status_texts_do_not_explain_a_refusal(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    vehicle.say(dialect.MAVLink_statustext_message(2, b"Old trouble"))
    link.wait(1.0)
    vehicle.refuses[22] = (2, "New trouble")
    with pytest.raises(LinkError) as refused:
        link.order("take-off", 22)
    assert "New trouble" in str(refused.value)
    assert "Old trouble" not in str(refused.value)


def test_an_ardupilot_is_refused_by_name():
    link = Link(ScriptedVehicle(autopilot=3).transport())
    with pytest.raises(LinkError, match="ArduPilot"):
        link.connect(5.0)


def test_a_mute_link_moves_nothing_and_tells_what_it_would(vehicle):
    link = Link(vehicle.transport(), dry=True)
    would: list[Any] = []
    link.on_setpoint = would.append
    link.connect(10.0)
    link.arm()
    link.fly(Velocity(1.2, None), 10.0)
    link.start_offboard()
    link.set_mode("LAND")
    link.wait(2.0)
    link.give_up()
    assert vehicle.setpoints == []
    assert {c[0] for c in vehicle.commands} <= {511, 512}
    assert would[0].velocity_body == pytest.approx((1.2, 0.0, 0.0))


def test_the_envelope_stops_the_vehicle_before_its_limits(vehicle):
    limits_hit: list[Any] = []
    link = Link(vehicle.transport(), limits=Limits(radius_m=10.0, ceiling_m=5.0))
    link.on_limit = limits_hit.append
    link.connect(10.0)
    link.fly(Velocity(1.2, 0.8), 60.0)
    link.start_offboard()
    link.wait(30.0)
    assert 8.0 < vehicle.position[0] <= 10.0
    assert 3.5 < -vehicle.position[2] <= 5.0
    assert {name for names in limits_hit for name in names} == {"radius", "ceiling"}


def test_an_empty_battery_ends_the_flight_once(vehicle):
    link = flying(vehicle, limits=Limits(battery_min=0.3))
    vehicle.battery = 29
    with pytest.raises(EnvelopeError, match="29%"):
        link.wait(5.0)
    link.give_up("land")
    assert vehicle.mode == "LAND"


def test_a_position_that_stands_still_in_time_is_not_believed(vehicle):
    link = flying(vehicle, limits=Limits())
    vehicle.silent = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED}
    link.wait(1.0)
    last = vehicle.setpoints[-1][1]
    assert (last.vx, last.vy, last.vz, last.yaw_rate) == (0.0, 0.0, 0.0, 0.0)


def test_limits_stay_where_they_are_when_home_is_moved_in_flight(vehicle):
    link = Link(vehicle.transport(), limits=Limits(radius_m=10.0))
    link.connect(10.0)
    link.wait(1.0)
    link.settle_envelope()
    vehicle.silent = {dialect.MAVLINK_MSG_ID_HOME_POSITION}
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    for _ in range(30):  # a ground station sets home to the vehicle's position
        here = dialect.MAVLink_home_position_message(0, 0, 0, *vehicle.position, [1, 0, 0, 0], 0, 0, 0)
        vehicle.out += vehicle.packer.pack(here)
        link.wait(1.0)
    assert 8.0 < vehicle.position[0] <= 10.0


def test_a_home_that_is_no_number_switches_no_limit_off(vehicle):
    vehicle.silent = {dialect.MAVLINK_MSG_ID_HOME_POSITION}
    bad = dialect.MAVLink_home_position_message(0, 0, 0, float("nan"), 0, 0, [1, 0, 0, 0], 0, 0, 0)
    link = Link(vehicle.transport(), limits=Limits(radius_m=10.0))
    vehicle.out += vehicle.packer.pack(bad)
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(30.0)
    assert 8.0 < vehicle.position[0] <= 10.0
