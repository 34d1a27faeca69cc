"""A person arms the vehicle during the preflight check: the check gives no more orders."""

import pytest

from foundation.mavlink import dialect
from hil.link.link import Link
from hil.preflight.check import rehearse
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
