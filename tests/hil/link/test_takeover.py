"""Control of the vehicle: hand-over, takeover, and messages that are never sent against a person."""

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
def test_nothing_is_sent_after_the_heartbeat_that_shows_another_hand(vehicle, mode):
    link = flying(vehicle)
    vehicle.mode = mode
    vehicle.say(vehicle.heartbeat())
    sent, commands = len(vehicle.setpoints), len(vehicle.commands)
    with pytest.raises(TakeoverError, match=mode):
        link.wait(5.0)
    assert len(vehicle.setpoints) == sent
    for _ in range(3):  # and it stays so, whatever is tried
        with pytest.raises(TakeoverError):
            link.tick()
    link.fly(Velocity(1.0, None), 2.0)
    with pytest.raises(TakeoverError):
        link.start_offboard()
    link.give_up("land")
    assert len(vehicle.setpoints) == sent
    assert [c for c in vehicle.commands[commands:] if c[0] not in (511, 512)] == []
    assert vehicle.mode == mode


def test_a_mode_that_we_ask_for_ourselves_is_no_takeover(vehicle):
    link = flying(vehicle)
    link.give_up("land")
    assert vehicle.mode == "LAND"
    modes = [c[2:] for c in vehicle.commands if c[0] == 176]
    assert modes == [(6, 0), (4, 3), (4, 6)]  # offboard, hold, land
    link.wait(2.0)


def test_a_person_arms_takes_off_and_hands_over(vehicle):
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
    assert {c[0] for c in vehicle.commands} <= {511, 512}  # no order was sent


@pytest.mark.parametrize("mode", ["HOLD", "OFFBOARD"])
def test_a_hand_over_high_up_holds_high_up(vehicle, mode):
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


def test_a_vehicle_that_a_person_has_in_hand_is_none_of_ours_to_land(vehicle):
    vehicle.mode = "POSCTL"
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.wait(1.0)
    assert link.state.armed
    assert not link.may_fly()


def test_nothing_is_sent_after_a_takeover_that_was_read_between_two_ticks(vehicle):
    link = flying(vehicle)
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())
    link.listen()
    sent = len(vehicle.setpoints)
    link.fly(Velocity(1.2, None), 2.5)  # the agent's next action, decided before the takeover
    with pytest.raises(TakeoverError):
        link.tick()
    assert len(vehicle.setpoints) == sent


def test_a_takeover_between_two_offboards_stays_one(vehicle):
    link = flying(vehicle)
    link.stop_offboard()
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())
    link.fly(Hold())
    with pytest.raises(TakeoverError, match="POSCTL"):
        link.start_offboard()
    assert vehicle.mode == "POSCTL"


def test_a_takeover_during_the_take_off_is_not_landed_by_us(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.arm()
    vehicle.mode, vehicle.landed = "TAKEOFF", True
    link.wait(2.0)  # TAKEOFF is no takeover
    vehicle.mode = "ALTCTL"
    with pytest.raises(TakeoverError, match="ALTCTL"):
        link.wait_for(lambda state: False, 5.0, "reaching take-off height")
    assert not link.may_fly()
    link.give_up("land")
    assert vehicle.mode == "ALTCTL"


def test_an_order_whose_answer_is_lost_is_not_repeated_against_a_pilot(vehicle):
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


def test_a_takeover_between_the_hold_and_the_landing_is_not_landed(vehicle):
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


def test_a_vehicle_that_is_disarmed_in_flight_is_not_flown_when_somebody_arms_it_again(vehicle):
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


def test_neither_a_failsafes_hold_nor_a_passing_switch_hands_over(vehicle):
    vehicle.mode, vehicle.system_status = "POSCTL", 4
    link = Link(vehicle.transport())
    link.connect(10.0)
    # a failsafe's hold of five seconds; a switch that passes through Hold; and then a hand-over
    steps = {4000: ("HOLD", 5), 9000: ("POSCTL", 4), 12000: ("HOLD", 4), 12500: ("POSCTL", 4), 15000: ("HOLD", 4)}

    def person():
        if vehicle.time_ms in steps:
            vehicle.mode, vehicle.system_status = steps.pop(vehicle.time_ms)
            vehicle.say(vehicle.heartbeat())

    link.on_wait = person
    link.await_handover()
    assert 16_000 <= vehicle.time_ms < 18_000


def test_a_landing_that_ends_in_the_mode_before_it_is_no_takeover(vehicle):
    link = flying(vehicle)
    link.set_mode("LAND")
    vehicle.mode = "OFFBOARD"  # a PX4 sends it just before it reports that it is disarmed
    vehicle.say(vehicle.heartbeat())
    vehicle.armed = False
    link.wait_for(lambda state: not state.armed, 5.0, "landing")


@pytest.mark.parametrize("stays", [False, True])
def test_a_word_of_the_mode_before_that_comes_late_is_no_takeover_but_one_that_stays_is(vehicle, stays):
    link = Link(vehicle.transport())
    link.connect(10.0)
    old = vehicle.heartbeat()
    link.fly(Hold())
    link.start_offboard()
    vehicle.say(old)
    link.wait(0.1)
    if not stays:
        vehicle.say(vehicle.heartbeat())  # the present one, which had overtaken it, comes ten times a second from a PX4
        link.wait(2.0)
        assert link.taken_by is None
        return
    vehicle.mode = "HOLD"
    with pytest.raises(TakeoverError, match="HOLD"):
        link.wait(2.0)


def test_a_failsafe_of_a_real_vehicle_ends_the_flight_and_is_not_taken_for_a_person(vehicle):
    link = flying(vehicle)
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(vehicle.heartbeat())
    with pytest.raises(TakeoverError, match=r"POSCTL.*failsafe"):
        link.wait(2.0)


@pytest.mark.parametrize(("before_s", "whose"), [(0.1, "failsafe"), (20.0, "person")])
def test_old_status_texts_do_not_explain_a_mode_change(vehicle, before_s, whose):
    link = flying(vehicle)
    vehicle.say(dialect.MAVLink_statustext_message(2, b"Failsafe: offboard signal lost"))
    link.wait(before_s)
    vehicle.mode = "POSCTL"
    vehicle.say(vehicle.heartbeat())  # no failsafe is reported yet
    with pytest.raises(TakeoverError, match=whose):
        link.wait(2.0)


def test_a_failsafe_of_a_simulated_vehicle_is_part_of_its_flight(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(vehicle.heartbeat())
    sent = len(vehicle.setpoints)
    link.wait(3.0)
    assert len(vehicle.setpoints) > sent + 50  # PX4 returns to a stream that goes on
    vehicle.mode, vehicle.system_status = "OFFBOARD", 4
    link.wait(2.0)
    vehicle.mode, vehicle.armed, vehicle.system_status = "HOLD", False, 3  # and then it crashes for good
    link.wait(5.0)
    assert link.taken_by is None


def test_a_person_takes_over_a_simulated_vehicle_too(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.mode = "POSCTL"
    with pytest.raises(TakeoverError, match=r"POSCTL.*person"):
        link.wait(5.0)


@pytest.mark.parametrize("simulated", [False, True])
def test_a_takeover_is_noticed_within_a_second(vehicle, simulated):
    """With CURRENT_MODE, requested by a flight at 10 Hz; the next heartbeat shows that it was no failsafe."""
    link = flying(vehicle, simulated=simulated)
    vehicle.mode, changed_us = "POSCTL", vehicle.time_ms * 1000
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["POSCTL"].custom_mode, MODES["POSCTL"].custom_mode))
    with pytest.raises(TakeoverError):
        link.wait(5.0)
    assert link.time_us - changed_us <= (1_000_000 if simulated else 100_000)


def test_on_a_bad_wire_a_failsafe_of_a_simulated_vehicle_may_go_untold_for_long(vehicle):
    link = flying(vehicle, simulated=True)
    vehicle.silent.add(dialect.MAVLINK_MSG_ID_HEARTBEAT)  # lost, all of them
    vehicle.mode, vehicle.system_status = "POSCTL", 5
    vehicle.say(dialect.MAVLink_current_mode_message(0, MODES["POSCTL"].custom_mode, MODES["POSCTL"].custom_mode))
    link.wait(8.0)
    vehicle.silent.clear()
    link.wait(3.0)
    assert link.taken_by is None


class LateHold(ScriptedVehicle):
    """Acknowledges a hold before it shows it, and shows it with the next order, as a PX4 may."""

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


def test_our_own_hold_that_is_shown_after_the_order_to_land_is_no_takeover():
    vehicle = LateHold()
    link = flying(vehicle)
    link.give_up("land")
    link.wait(2.0)
    assert link.taken_by is None
    assert vehicle.mode == "LAND"


def test_a_takeover_has_no_text_of_long_before(vehicle):
    link = flying(vehicle)
    vehicle.say(dialect.MAVLink_statustext_message(4, b"Preflight Fail: something else"))
    link.wait(5.0)
    vehicle.mode = "POSCTL"
    vehicle.say(dialect.MAVLink_statustext_message(4, b"Pilot took over using sticks"))
    with pytest.raises(TakeoverError) as taken:
        link.wait(5.0)
    assert "sticks" in str(taken.value)
    assert "Preflight" not in str(taken.value)
