"""A person arms the vehicle during the preflight check: the check gives no more orders."""

import pytest

from foundation.errors import UsageError
from foundation.mavlink import MODES, dialect
from hil.link.link import Link
from hil.preflight.check import Check, apply_changes, rehearse
from hil.preflight.observation import Change, Observation, Row
from tests.hil.link.scripted_vehicle import ScriptedVehicle


class ArmedByPerson(ScriptedVehicle):
    """A disarmed vehicle that a person arms as soon as `arms` returns true, in the mode `arms_in`, or in its mode."""

    def __init__(self, arms, arms_in=None):
        super().__init__()
        self.armed, self.landed = False, True
        self.arms, self.arms_in = arms, arms_in
        self.orders_while_armed, self.setpoints_while_armed = [], 0

    def step(self):
        super().step()
        if not self.armed and self.arms(self):
            self.armed, self.mode = True, self.arms_in or self.mode
            self.say(self.heartbeat())

    def give(self, data):
        before = len(self.setpoints)
        super().give(data)
        self.setpoints_while_armed += (len(self.setpoints) - before) * self.armed

    def command(self, message):
        super().command(message)
        if self.armed and message.command == dialect.MAV_CMD_DO_SET_MODE:
            self.orders_while_armed.append(message.param2)


def linked(vehicle):
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.wait(1.5)
    return link


def gets_setpoints(vehicle):
    return len(vehicle.setpoints) > 20


def is_in_offboard(vehicle):
    return vehicle.mode == "OFFBOARD"


@pytest.mark.parametrize("arms", [gets_setpoints, is_in_offboard])
@pytest.mark.parametrize("arms_in", ["POSCTL", None])
def test_a_vehicle_armed_during_the_rehearsal_gets_no_more_setpoints_and_mode_orders(arms, arms_in):
    vehicle = ArmedByPerson(arms, arms_in)
    link = linked(vehicle)
    on_wait = link.on_wait
    row = rehearse(link)
    assert row.passed is False
    assert "armed" in row.why
    assert vehicle.armed
    assert (vehicle.orders_while_armed, vehicle.setpoints_while_armed) == ([], 0)
    assert not link.streaming
    assert link.on_wait is on_wait


def test_a_rehearsal_that_fails_returns_a_disarmed_vehicle_to_hold():
    vehicle = ArmedByPerson(lambda vehicle: False)
    link = linked(vehicle)
    vehicle.silent.add(dialect.MAVLINK_MSG_ID_HEARTBEAT)
    row = rehearse(link)
    assert row.passed is False
    assert (vehicle.mode, vehicle.armed) == ("HOLD", False)


CHANGES = [Change("COM_OBL_RC_ACT", 0, 5, "because"), Change("COM_OF_LOSS_T", 1.0, 0.5, "because")]


def empty_check():
    return Check(Observation(), {}, None, Row("rehearsal", True, ""), ())


def test_no_parameter_is_set_on_a_vehicle_that_was_armed_since_the_last_message(meet):
    autopilot, link = meet()
    on_wait = link.on_wait
    link.wait(1.0)
    assert not link.state.armed
    autopilot.armed = True
    with pytest.raises(UsageError, match="armed"):
        apply_changes(link, empty_check(), CHANGES)
    assert "PARAM_SET" not in autopilot.message_types
    assert link.on_wait is on_wait


def test_no_more_parameters_are_set_on_a_vehicle_that_is_armed_after_the_first_one(meet):
    autopilot, link = meet()
    set_parameter = autopilot._set

    def set_and_arm(message):
        autopilot.armed = True
        autopilot._send(dialect.MAVLink_heartbeat_message(2, 12, 128, MODES["HOLD"].custom_mode, 3, 3))
        set_parameter(message)

    autopilot._set = set_and_arm
    with pytest.raises(UsageError, match="armed"):
        apply_changes(link, empty_check(), CHANGES)
    assert autopilot.parameters["COM_OF_LOSS_T"] == 1.0
    assert autopilot.message_types.count("PARAM_SET") == 1
