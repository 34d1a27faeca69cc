"""Each autopilot family has its own file with its details. The link is the same for all families."""

import pytest

from foundation.mavlink import dialect
from foundation.setpoints import Hold
from hil.link import conversation
from hil.link.autopilots import PX4, Px4
from hil.link.link import Link
from hil.link.offboard import PositionSetpoint, VelocitySetpoint
from tests.hil.link.scripted_vehicle import ScriptedVehicle

COPTER = int(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
NUMBERS = {"HOLD": 5, "OFFBOARD": 4}


class Guided(Px4):
    """A family with other mode numbers and another frame for setpoints."""

    name = "guided"
    autopilot = COPTER

    def mode_name(self, custom_mode):
        return {5: "HOLD", 4: "OFFBOARD"}.get(custom_mode, str(custom_mode))

    def mode_parameters(self, mode):
        return NUMBERS[mode], 0

    def setpoint_message(self, setpoint, time_boot_ms, system, component):
        message = PX4.setpoint_message(setpoint, time_boot_ms, system, component)
        message.coordinate_frame = dialect.MAV_FRAME_LOCAL_OFFSET_NED
        return message


class Foreign(ScriptedVehicle):
    """A scripted vehicle of the family `Guided`."""

    def __init__(self):
        super().__init__(autopilot=COPTER)

    def heartbeat(self):
        base = 1 | (128 if self.armed else 0)
        return dialect.MAVLink_heartbeat_message(2, self.autopilot, base, NUMBERS[self.mode], 4, 3)

    def command(self, message):
        if message.command == dialect.MAV_CMD_DO_SET_MODE:
            self.mode = next(name for name, number in NUMBERS.items() if number == message.param2)
            self.say(self.heartbeat())
        self.say(dialect.MAVLink_command_ack_message(message.command, 0, 0, 0, 245, 191))


def test_a_second_autopilot_family_works_with_the_same_link(monkeypatch):
    monkeypatch.setitem(conversation.FAMILIES, COPTER, Guided())
    vehicle = Foreign()
    link = Link(vehicle.transport())
    link.connect(10.0)
    assert link.family.name == "guided"
    link.fly(Hold())
    link.start_offboard()
    link.wait(0.5)
    assert link.state.mode == "OFFBOARD"
    assert {message.coordinate_frame for _, message in vehicle.setpoints} == {dialect.MAV_FRAME_LOCAL_OFFSET_NED}


@pytest.mark.parametrize(
    ("setpoint", "frame", "mask"),
    [
        (VelocitySetpoint((1.0, 0.0, -0.5), 0.2), dialect.MAV_FRAME_BODY_NED, 0x5C7),
        (PositionSetpoint((1.0, 2.0, -3.0), 0.2), dialect.MAV_FRAME_LOCAL_NED, 0x9F8),
    ],
)
def test_px4_setpoints_have_the_expected_frame_and_type_mask(setpoint, frame, mask):
    message = PX4.setpoint_message(setpoint, 5, 1, 1)
    assert (message.coordinate_frame, message.type_mask) == (frame, mask)
