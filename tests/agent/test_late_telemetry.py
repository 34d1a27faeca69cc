"""A decision is relative to the vehicle's pose at the image's time, even if telemetry reports that pose late."""

import math

import pytest

from dronecats.agent.action import Go, Rotate
from dronecats.agent.controller import Drone
from dronecats.agent.steady.agent import SteadyDrone
from dronecats.agent.steady.leg import seen_place
from foundation.camera import CameraModel
from hil.link.course import PoseHistory

CAMERA = CameraModel(width=64, height=36)
TAKEN_US, TELLS_US = 1_000_000, 50_000
AHEAD, ASIDE = Go(500.0, 500.0, 20.0), Go(970.0, 500.0, 20.0)  # ASIDE needs a turn first


class TellsLate:
    """A vehicle that flies north and turns. It reports each pose half a second late."""

    def __init__(self):
        self.time_us, self.steady = TAKEN_US, True
        self.flown = []  # the pose that each setpoint's angles are relative to
        self._told_us = -TELLS_US
        self._track = PoseHistory()
        self.listen()

    def pose(self, time_us):
        return (2.0 * time_us / 1e6) ** 2, 0.8 * (time_us / 1e6) ** 2  # cannot be extrapolated

    def listen(self):
        while self._told_us <= self.time_us - 500_000 - TELLS_US:
            self._told_us += TELLS_US
            north, heading = self.pose(self._told_us)
            self._track.place(self._told_us, (north, 0.0, -2.0), (0.0, 0.0, 0.0))
            self._track.heading(self._told_us, heading, 0.0)

    def sight(self, time_us):
        return self._track.at(time_us)

    def fly(self, setpoint, seconds=None, seen=None):
        if seen is not None:
            self.flown.append(seen)

    def tick(self):
        self.pass_to(self.time_us + TELLS_US)

    def pass_to(self, time_us):
        self.time_us = time_us
        self.listen()


def where(sight):
    return sight.position_ned[0], sight.heading


@pytest.mark.parametrize("action", [AHEAD, ASIDE, Rotate(30.0)])
def test_a_decision_uses_the_pose_at_capture_although_telemetry_reports_it_later(action):
    vehicle = TellsLate()
    drone = Drone(0, vehicle, CAMERA)
    drone.see(TAKEN_US)
    assert where(vehicle.sight(TAKEN_US)) != pytest.approx(vehicle.pose(TAKEN_US), abs=0.1)  # not reported yet
    vehicle.pass_to(1_600_000)
    drone.plan(action)
    drone.begin(0.6)
    assert where(vehicle.flown[0]) == pytest.approx(vehicle.pose(TAKEN_US))


def test_telemetry_received_during_a_turn_is_used_for_the_next_move():
    vehicle = TellsLate()
    drone = Drone(0, vehicle, CAMERA)
    drone.see(TAKEN_US)
    vehicle.pass_to(1_100_000)
    drone.plan(ASIDE)
    drone.begin(0.1)
    vehicle.pass_to(4_100_000)
    drone.advance(3.1)
    assert [where(seen) == pytest.approx(vehicle.pose(TAKEN_US)) for seen in vehicle.flown] == [False, True]


def test_the_steady_drone_also_uses_the_pose_at_capture():
    vehicle = TellsLate()
    drone = SteadyDrone(0, vehicle, CAMERA)
    drone.see(TAKEN_US)
    vehicle.pass_to(1_600_000)
    drone.plan(AHEAD)
    assert drone._place is not None
    assert drone._place == seen_place(AHEAD, vehicle.sight(TAKEN_US), CAMERA)
    north, heading = vehicle.pose(TAKEN_US)
    assert drone._place.from_ned[0] == pytest.approx(north)
    bearing = math.atan2(drone._place.place_ned[1], drone._place.place_ned[0] - north)
    assert bearing == pytest.approx(heading, abs=0.01)


def test_the_pose_at_capture_is_available_after_the_slowest_reply():
    """The agent receives the image after 1 min, and the reply takes 5 min."""
    vehicle = TellsLate()
    drone = Drone(0, vehicle, CAMERA)
    drone.see(TAKEN_US)
    vehicle.pass_to(TAKEN_US + 360_000_000)
    drone.plan(AHEAD)
    drone.begin(360.0)
    assert where(vehicle.flown[0]) == pytest.approx(vehicle.pose(TAKEN_US))
