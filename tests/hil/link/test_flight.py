"""The messages that the link sends to its vehicle, and how it ends control."""

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


def test_setpoints_are_streamed_before_offboard_mode_is_requested(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    link.start_offboard()
    mode_index = next(i for i, c in enumerate(vehicle.commands) if c[0] == 176)
    assert vehicle.commands[mode_index][1:] == (1, 6, 0)
    assert vehicle.setpoints, "PX4 refuses offboard without a setpoint"


def test_an_image_has_the_roll_and_pitch_of_its_capture_time(vehicle):
    vehicle.lean = (0.1, -0.2)
    link = flying(vehicle)
    taken_us = link.time_us
    vehicle.lean = (0.0, 0.3)
    link.wait(1.0)
    sight = link.sight(taken_us)
    assert (sight.roll, sight.pitch) == pytest.approx((0.1, -0.2), abs=1e-6)


def test_a_gimbal_angle_is_stored_at_its_own_timestamp_and_interpolated(vehicle):
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


def test_late_telemetry_updates_the_history_but_not_the_current_state(vehicle):
    """If the wire reorders messages, a late message reports an earlier position, not the current one."""
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
def test_a_permanent_rejection_of_offboard_is_reported_with_the_autopilots_text(vehicle, result, attempts):
    vehicle.refuses[176] = (result, "no valid position")
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    with pytest.raises(LinkError, match=r"OFFBOARD.*no valid position"):
        link.start_offboard()
    assert sum(c[0] == 176 for c in vehicle.commands) in attempts


def test_setpoints_are_sent_at_20_hz_of_vehicle_time(vehicle):
    link = flying(vehicle)
    before = len(vehicle.setpoints)
    link.wait(2.0)
    assert len(vehicle.setpoints) - before == pytest.approx(40, abs=1)


def test_give_up_sends_hold_positions_only_and_changes_the_mode(vehicle):
    link = flying(vehicle)
    began = vehicle.time_ms
    link.give_up("hold")
    after = [m for t, m in vehicle.setpoints if t > began]
    assert after
    assert all(m.coordinate_frame == 1 for m in after)  # MAV_FRAME_LOCAL_NED: a position to hold, not a velocity
    assert vehicle.mode == "HOLD"


def test_an_expired_velocity_becomes_a_position_hold(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 2.5)
    link.start_offboard()
    link.wait(6.0)  # no new decisions come
    assert vehicle.setpoints[-1][1].coordinate_frame == 1
    moving = [t for t, m in vehicle.setpoints if m.coordinate_frame == 8]
    assert (moving[-1] - moving[0]) / 1000 <= 2.75


def test_after_a_telemetry_gap_no_setpoint_is_sent_before_the_next_heartbeat(vehicle):
    link = flying(vehicle)
    vehicle.time_ms += 4010  # the cable was out; the link knows no events of this time
    vehicle.silent = {dialect.MAVLINK_MSG_ID_HEARTBEAT}
    sent = len(vehicle.setpoints)
    link.wait(2.0)
    assert len(vehicle.setpoints) == sent
    vehicle.silent = set()
    vehicle.say(vehicle.heartbeat())
    link.wait(1.0)
    assert len(vehicle.setpoints) > sent


def test_a_reboot_raises_an_error_and_resets_the_state(vehicle):
    vehicle.time_ms = 400_000
    link = flying(vehicle)
    vehicle.time_ms, vehicle.mode, vehicle.armed = 1_000, "HOLD", False
    with pytest.raises(LinkError, match="rebooted"):
        link.wait(5.0)
    link.connect(10.0)
    assert not link.state.armed
    assert link.time_us < 10_000_000


def test_a_vehicle_that_reboots_during_connect_gets_setpoints(vehicle):
    vehicle.time_ms = 3_600_000
    vehicle.silent = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED}  # it is still starting, so `connect` waits
    link = Link(vehicle.transport())
    reboots: list[bool] = []

    def reboot():
        if not reboots and vehicle.time_ms > 3_602_000:
            reboots.append(True)
            vehicle.time_ms, vehicle.silent = 1_000, set()

    link.on_wait = reboot
    link.connect(20.0)
    assert reboots
    link.fly(Hold())
    link.wait(1.0)
    assert vehicle.setpoints


def test_a_rejected_command_is_reported_with_the_autopilots_text(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    vehicle.refuses[22] = (1, "Takeoff denied! No valid position")
    with pytest.raises(LinkError, match=r"take-off.*No valid position"):
        link.order("take-off", 22)


def test_a_rejection_is_not_reported_with_old_status_texts(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    vehicle.say(dialect.MAVLink_statustext_message(2, b"Old trouble"))
    link.wait(1.0)
    vehicle.refuses[22] = (2, "New trouble")
    with pytest.raises(LinkError) as refused:
        link.order("take-off", 22)
    assert "New trouble" in str(refused.value)
    assert "Old trouble" not in str(refused.value)


def test_ardupilot_is_rejected_by_name():
    link = Link(ScriptedVehicle(autopilot=3).transport())
    with pytest.raises(LinkError, match="ArduPilot"):
        link.connect(5.0)


def test_a_dry_link_sends_no_setpoints_and_reports_those_it_would_send(vehicle):
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


def test_a_low_battery_raises_an_envelope_error_and_landing_remains_possible(vehicle):
    link = flying(vehicle, limits=Limits(battery_min=0.3))
    vehicle.battery = 29
    with pytest.raises(EnvelopeError, match="29%"):
        link.wait(5.0)
    link.give_up("land")
    assert vehicle.mode == "LAND"


def test_without_new_positions_the_vehicle_stops(vehicle):
    link = flying(vehicle, limits=Limits())
    vehicle.silent = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED}
    link.wait(1.0)
    last = vehicle.setpoints[-1][1]
    assert (last.vx, last.vy, last.vz, last.yaw_rate) == (0.0, 0.0, 0.0, 0.0)


def test_a_change_of_home_in_flight_does_not_move_the_limits(vehicle):
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


def test_a_home_position_with_nan_does_not_disable_the_limits(vehicle):
    vehicle.silent = {dialect.MAVLINK_MSG_ID_HOME_POSITION}
    bad = dialect.MAVLink_home_position_message(0, 0, 0, float("nan"), 0, 0, [1, 0, 0, 0], 0, 0, 0)
    link = Link(vehicle.transport(), limits=Limits(radius_m=10.0))
    vehicle.out += vehicle.packer.pack(bad)
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(30.0)
    assert 8.0 < vehicle.position[0] <= 10.0
