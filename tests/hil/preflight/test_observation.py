"""The observation of a check contains requested messages in full, and leaves the vehicle's streams as they were."""

import time

import pytest

from foundation.mavlink import dialect
from hil.link.link import Link
from hil.preflight.observation import STREAM_HZ, Watch
from tests.hil.link.scripted_vehicle import ScriptedVehicle


class OnRequest(ScriptedVehicle):
    """Sends its estimator's state and the date only on request."""

    def command(self, message):
        super().command(message)
        if message.command == dialect.MAV_CMD_REQUEST_MESSAGE:
            if message.param1 == dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
                self.say(dialect.MAVLink_estimator_status_message(0, 0x3F, 1.4, 0.1, 0.1, 0.1, 0, 0, 0.5, 0.5))
            elif message.param1 == dialect.MAVLINK_MSG_ID_SYSTEM_TIME:
                self.say(dialect.MAVLink_system_time_message(0, self.time_ms))


def test_messages_that_arrive_on_request_are_observed_like_those_of_a_stream():
    link = Link(OnRequest().transport())
    link.connect(10.0)
    observation = Watch(link).listen(1.0)
    assert observation.worst_ratio["vel_ratio"] == pytest.approx(1.4)
    assert observation.unix_s == pytest.approx(time.time(), abs=60.0)


def test_closing_the_link_after_a_check_resets_the_streams_of_the_check():
    vehicle = ScriptedVehicle()
    link = Link(vehicle.transport())
    link.connect(10.0)
    Watch(link).listen(1.0)
    vehicle.commands.clear()
    link.close()
    reset = {int(p1) for command, p1, p2, _ in vehicle.commands if (command, p2) == (511, 0)}
    assert reset >= STREAM_HZ.keys()
