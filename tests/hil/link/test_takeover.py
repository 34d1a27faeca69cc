"""Control of the vehicle: hand-over, takeover, and the messages that the link never sends after a takeover."""

import pytest

from foundation.mavlink import MODES, dialect
from foundation.setpoints import Hold, Velocity
from hil.link.envelope import Limits
from hil.link.link import Link, TakeoverError
from tests.hil.link.scripted_vehicle import ScriptedVehicle, flying


@pytest.fixture
def vehicle():
    return ScriptedVehicle()


@pytest.mark.parametrize("mode", ["POSCTL", "HOLD", "RETURN", "LAND", "ALTCTL"])
def test_nothing_is_sent_after_a_heartbeat_that_shows_a_takeover(vehicle, mode):
    link = flying(vehicle)
    vehicle.mode = mode
    vehicle.say(vehicle.heartbeat())
    sent, commands = len(vehicle.setpoints), len(vehicle.commands)
    with pytest.raises(TakeoverError, match=mode):
        link.wait(5.0)
    assert len(vehicle.setpoints) == sent
    for _ in range(3):  # the takeover is permanent
        with pytest.raises(TakeoverError):
            link.tick()
    link.fly(Velocity(1.0, None), 2.0)
    with pytest.raises(TakeoverError):
        link.start_offboard()
    link.give_up("land")
    assert len(vehicle.setpoints) == sent
    assert [c for c in vehicle.commands[commands:] if c[0] not in (511, 512)] == []
    assert vehicle.mode == mode


def test_a_mode_change_that_the_link_requests_is_not_a_takeover(vehicle):
    link = flying(vehicle)
    link.give_up("land")
    assert vehicle.mode == "LAND"
    modes = [c[2:] for c in vehicle.commands if c[0] == 176]
    assert modes == [(6, 0), (4, 3), (4, 6)]  # offboard, hold, land
    link.wait(2.0)


def test_a_person_can_arm_take_off_and_hand_over(vehicle):
    vehicle.armed, vehicle.landed, vehicle.mode = False, True, "POSCTL"
    link = Link(vehicle.transport())
    link.connect(10.0)
    steps = iter([("armed", True), ("landed", False), ("mode", "HOLD")])

    def person():
        if vehicle.time_ms % 3000 == 0 and (step := next(steps, None)):
            setattr(vehicle, *step)

    link.on_wait = person
    link.await_handover()
    assert vehicle.mode == "HOLD"
    assert {c[0] for c in vehicle.commands} <= {511, 512}  # no flight command


@pytest.mark.parametrize("mode", ["HOLD", "OFFBOARD"])
def test_the_hold_after_a_hand_over_keeps_the_height(vehicle, mode):
    vehicle.armed, vehicle.landed, vehicle.mode, vehicle.position = True, True, "POSCTL", [0.0, 0.0, 0.0]
    link = Link(vehicle.transport(), limits=Limits())
    link.connect(10.0)

    def person():
        if vehicle.landed and vehicle.time_ms > 4000:
            assert vehicle.setpoints == []  # no setpoints on the ground: Offboard cannot be armed there
            vehicle.landed = False
            vehicle.say(dialect.MAVLink_extended_sys_state_message(0, 2))
        elif not vehicle.landed and vehicle.position[2] > -8.0:
            vehicle.position[2] -= 0.1
        elif vehicle.mode == "POSCTL" and vehicle.position[2] <= -8.0:
            vehicle.mode = mode

    link.on_wait = person
    link.await_handover()
    link.fly(Hold())
    link.start_offboard()
    link.wait(3.0)
    assert vehicle.position[2] == pytest.approx(-8.0, abs=0.5)
    assert all(m.z < -7.0 for t, m in vehicle.setpoints if t > vehicle.time_ms - 2500)


def test_the_link_may_not_fly_a_vehicle_that_a_person_flies(vehicle):
    vehicle.mode = "POSCTL"
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.wait(1.0)
    assert link.state.armed
    assert not link.may_fly()


def test_nothing_is_sent_after_a_takeover_between_two_ticks(vehicle):
    link = flying(vehicle)
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())
    link.listen()
    sent = len(vehicle.setpoints)
    link.fly(Velocity(1.2, None), 2.5)  # the agent's next action, decided before the takeover
    with pytest.raises(TakeoverError):
        link.tick()
    assert len(vehicle.setpoints) == sent


def test_a_takeover_between_two_offboard_periods_prevents_the_second(vehicle):
    link = flying(vehicle)
    link.stop_offboard()
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())
    link.fly(Hold())
    with pytest.raises(TakeoverError, match="POSCTL"):
        link.start_offboard()
    assert vehicle.mode == "POSCTL"


def test_after_a_takeover_during_take_off_the_link_does_not_land_the_vehicle(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.arm()
    vehicle.mode, vehicle.landed = "TAKEOFF", True
    link.wait(2.0)  # TAKEOFF is not a takeover
    vehicle.mode = "ALTCTL"
    with pytest.raises(TakeoverError, match="ALTCTL"):
        link.wait_for(lambda state: False, 5.0, "reaching take-off height")
    assert not link.may_fly()
    link.give_up("land")
    assert vehicle.mode == "ALTCTL"


def test_a_command_without_acknowledgement_is_not_repeated_after_a_takeover(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.fly(Hold())
    vehicle.silent = {dialect.MAVLINK_MSG_ID_COMMAND_ACK}
    asked_ms = vehicle.time_ms

    def pilot():
        if vehicle.mode == "OFFBOARD" and vehicle.time_ms > asked_ms + 300:
            vehicle.mode = "POSCTL"
            vehicle.say(vehicle.heartbeat())

    link.on_wait = pilot
    with pytest.raises(TakeoverError, match="POSCTL"):
        link.start_offboard()
    assert vehicle.mode == "POSCTL"


def test_a_takeover_between_hold_and_landing_cancels_the_landing(vehicle):
    link = flying(vehicle)
    taken_from: list[str] = []

    def pilot():
        if vehicle.mode == "HOLD" and not taken_from:
            taken_from.append(vehicle.mode)
            vehicle.mode = "POSCTL"
            vehicle.say(vehicle.heartbeat())

    link.on_wait = pilot
    with pytest.raises(TakeoverError):
        link.give_up("land")
    assert vehicle.mode == "POSCTL"


def test_a_vehicle_disarmed_in_flight_is_not_flown_after_it_is_armed_again(vehicle):
    link = flying(vehicle)
    vehicle.armed = False
    with pytest.raises(TakeoverError, match="disarmed"):
        link.wait(3.0)
    vehicle.armed, sent = True, len(vehicle.setpoints)
    for _ in range(40):
        with pytest.raises(TakeoverError):
            link.tick()
    assert len(vehicle.setpoints) == sent
    assert not link.may_fly()


def test_an_autopilot_that_restarts_in_flight_is_not_reported_as_disarmed_by_a_person_only(vehicle):
    link = flying(vehicle)
    vehicle.time_ms += 2000  # a PX4 in software has the simulator's clock, so the restart does not set it back
    vehicle.armed, vehicle.landed, vehicle.mode, vehicle.system_status = False, True, "MANUAL", 3
    with pytest.raises(TakeoverError, match="restart"):
        link.wait(5.0)


def test_a_failsafe_hold_or_a_brief_hold_is_not_a_hand_over(vehicle):
    vehicle.mode, vehicle.system_status = "POSCTL", 4
    link = Link(vehicle.transport())
    link.connect(10.0)
    # a failsafe hold of 5 s, a mode switch that passes through Hold, then a hand-over
    steps = {4000: ("HOLD", 5), 9000: ("POSCTL", 4), 12000: ("HOLD", 4), 12500: ("POSCTL", 4), 15000: ("HOLD", 4)}

    def person():
        if vehicle.time_ms in steps:
            vehicle.mode, vehicle.system_status = steps.pop(vehicle.time_ms)
            vehicle.say(vehicle.heartbeat())

    link.on_wait = person
    link.await_handover()
    assert 16_000 <= vehicle.time_ms < 18_000


def test_a_landing_that_ends_in_the_previous_mode_is_not_a_takeover(vehicle):
    link = flying(vehicle)
    link.set_mode("LAND")
    vehicle.mode = "OFFBOARD"  # PX4 sends this just before it reports that it is disarmed
    vehicle.say(vehicle.heartbeat())
    vehicle.armed = False
    link.wait_for(lambda state: not state.armed, 5.0, "landing")


@pytest.mark.parametrize("stays", [False, True])
def test_a_late_heartbeat_of_the_previous_mode_is_not_a_takeover_but_a_lasting_change_is(vehicle, stays):
    link = Link(vehicle.transport())
    link.connect(10.0)
    old = vehicle.heartbeat()
    link.fly(Hold())
    link.start_offboard()
    vehicle.say(old)
    link.wait(0.1)
    if not stays:
        vehicle.say(vehicle.heartbeat())  # PX4 sends the current mode ten times per second
        link.wait(2.0)
        assert link.taken_by is None
        return
    vehicle.mode = "HOLD"
    with pytest.raises(TakeoverError, match="HOLD"):
        link.wait(2.0)


def test_a_failsafe_of_a_real_vehicle_ends_the_flight_and_is_reported_as_a_failsafe(vehicle):
    link = flying(vehicle)
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(vehicle.heartbeat())
    with pytest.raises(TakeoverError, match=r"POSCTL.*failsafe"):
        link.wait(2.0)


@pytest.mark.parametrize(("intended", "whose"), [("OFFBOARD", "failsafe"), ("LAND", "person"), (None, "person")])
def test_current_mode_shows_a_failsafe_before_the_next_heartbeat(vehicle, intended, whose):
    """PX4 keeps the intended mode in a failsafe. An autopilot that does not know it sends 0."""
    link = flying(vehicle)
    vehicle.mode = "LAND"
    requested = MODES[intended].custom_mode if intended else 0
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["LAND"].custom_mode, requested))
    with pytest.raises(TakeoverError, match=f"LAND.*{whose}"):
        link.wait(0.1)


def test_a_heartbeat_with_a_new_mode_ends_an_overridden_mode(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode, vehicle.system_status = "LAND", 5
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["LAND"].custom_mode, MODES["OFFBOARD"].custom_mode))
    link.wait(2.0)
    assert link.state.overridden_mode == "OFFBOARD"
    vehicle.mode, vehicle.system_status = "OFFBOARD", 4
    link.wait(2.0)
    assert link.state.overridden_mode == ""


@pytest.mark.parametrize(("before_s", "whose"), [(0.1, "failsafe"), (20.0, "person")])
def test_old_status_texts_do_not_explain_a_mode_change(vehicle, before_s, whose):
    link = flying(vehicle)
    vehicle.say(dialect.MAVLink_statustext_message(2, b"Failsafe: offboard signal lost"))
    link.wait(before_s)
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())  # no failsafe is reported yet
    with pytest.raises(TakeoverError, match=whose):
        link.wait(2.0)


def test_a_failsafe_of_a_simulated_vehicle_does_not_end_the_flight(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(vehicle.heartbeat())
    sent = len(vehicle.setpoints)
    link.wait(3.0)
    assert len(vehicle.setpoints) > sent + 50  # PX4 returns to offboard if the stream continues
    vehicle.mode, vehicle.system_status = "OFFBOARD", 4
    link.wait(2.0)
    vehicle.mode, vehicle.armed, vehicle.system_status = "HOLD", False, 3  # then it crashes
    link.wait(5.0)
    assert link.taken_by is None


def test_a_person_can_take_over_a_simulated_vehicle(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode = "POSCTL"
    with pytest.raises(TakeoverError, match=r"POSCTL.*person"):
        link.wait(5.0)


def test_a_person_can_take_over_a_simulated_vehicle_after_a_failsafe(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    link.wait(3.0)
    vehicle.mode, vehicle.system_status = "OFFBOARD", 4
    link.wait(2.0)
    vehicle.mode = "POSCTL"
    with pytest.raises(TakeoverError, match=r"POSCTL.*person"):
        link.wait(5.0)


@pytest.mark.parametrize("simulated", [False, True])
def test_a_takeover_is_detected_within_a_second(vehicle, simulated):
    """CURRENT_MODE (10 Hz) shows the change. In simulation, the next heartbeat shows that it is not a failsafe."""
    link = flying(vehicle, simulated=simulated)
    vehicle.mode, changed_us = "POSCTL", vehicle.time_ms * 1000
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["POSCTL"].custom_mode, MODES["POSCTL"].custom_mode))
    with pytest.raises(TakeoverError):
        link.wait(5.0)
    assert link.time_us - changed_us <= (1_000_000 if simulated else 100_000)


def test_lost_heartbeats_during_a_failsafe_of_a_simulated_vehicle_are_not_a_takeover(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.silent.add(dialect.MAVLINK_MSG_ID_HEARTBEAT)  # all heartbeats are lost
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["POSCTL"].custom_mode, MODES["POSCTL"].custom_mode))
    link.wait(8.0)
    vehicle.silent.clear()
    link.wait(3.0)
    assert link.taken_by is None


class LateHold(ScriptedVehicle):
    """Acknowledges a hold at once, but sends its heartbeat only with the next command, as PX4 may do."""

    def __init__(self):
        super().__init__()
        self.late = b""

    def command(self, message):
        before = self.out
        super().command(message)
        shown = self.out.removeprefix(before)
        if message.command == 176 and self.mode == "HOLD":
            beat = self.packer.pack(self.heartbeat())
            self.late, self.out = beat, before + shown[len(beat) :]
        elif message.command == 176:
            self.out = before + self.late + shown


def test_a_late_heartbeat_of_the_requested_hold_is_not_a_takeover():
    vehicle = LateHold()
    link = flying(vehicle)
    link.give_up("land")
    link.wait(2.0)
    assert link.taken_by is None
    assert vehicle.mode == "LAND"


def test_a_takeover_is_not_reported_with_old_status_texts(vehicle):
    link = flying(vehicle)
    vehicle.say(dialect.MAVLink_statustext_message(4, b"Preflight Fail: something else"))
    link.wait(5.0)
    vehicle.mode = "POSCTL"
    vehicle.say(dialect.MAVLink_statustext_message(4, b"Pilot took over using sticks"))
    with pytest.raises(TakeoverError) as taken:
        link.wait(5.0)
    assert "sticks" in str(taken.value)
    assert "Preflight" not in str(taken.value)
