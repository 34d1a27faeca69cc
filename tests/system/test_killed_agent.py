"""The vehicle's reaction to `kill -9` of its agent in flight, before and after `preflight --fix`.

The agent flies in its own process. In Offboard, the vehicle waits for the agent's setpoints until the agent is killed.
So the tests do not depend on when the machine runs the agent. They measure the true motion.
"""

import math
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.simulator_process import Simulator
from foundation.frames import Vec3
from hil.link.link import Link
from hil.link.transport import MemoryTransport
from hil.preflight.check import apply_changes, check
from tests.support.simulated_vehicle import EPISODE

AGENT = Path(__file__).with_name("streaming_agent.py")
STOPPED = 0.2  # m/s
WITHIN_S = 2.0
LEAD_US = 250_000  # µs that the vehicle may be ahead of the newest setpoint: five periods of the agent
AIRBORNE_S = 90.0  # s of vehicle time in which the agent must reach its speed


@dataclass(frozen=True, slots=True)
class Motion:
    """One sample of the truth."""

    time_us: int  # vehicle clock
    position_ned: Vec3  # m
    speed: float  # m/s


class Vehicle:
    """A simulated vehicle in this process, at most as fast as the wall clock."""

    def __init__(self):
        self._simulator = Simulator(SimulatorConfig(episode=EPISODE, count=1))
        self.url = f"udpout://127.0.0.1:{self._simulator.ready()['agent'][0]}"
        (self._vehicle,) = self._simulator.simulation.vehicles
        self._commander = self._vehicle.autopilot.commander
        self.samples = []

    def link(self):
        """Return a link that advances the vehicle while it waits."""
        port = self._vehicle.open_port("onboard")
        return Link(
            MemoryTransport("memory://", port.take, port.receive, self.turn, lambda: self._vehicle.time_us / 1e6)
        )

    def turn(self):
        """Advance by one tick."""
        self._simulator.turn()
        truth = self._vehicle.plant.truth
        position, speed = tuple(truth["position_ned"].tolist()), math.hypot(*truth["velocity_ned"])
        self.samples.append(Motion(self._vehicle.time_us, position, speed))

    def turn_with_agent(self):
        """Advance by one tick. In Offboard, wait instead while the newest setpoint is older than LEAD_US."""
        if self.is_offboard and self._vehicle.time_us >= self.setpoint_us + LEAD_US:
            self._simulator.ports.exchange(0.0)
            time.sleep(0.001)  # lets the agent run
        else:
            self.turn()

    @property
    def is_offboard(self):
        return self._commander.mode == "OFFBOARD"

    @property
    def setpoint_us(self):
        """The arrival of the newest setpoint, µs of the vehicle clock."""
        return self._commander.flight.offboard.time_us

    def close(self):
        self._simulator.close()


@pytest.fixture
def vehicle():
    vehicle = Vehicle()
    yield vehicle
    vehicle.close()


def killed_in_flight(vehicle):
    """Kill the agent in steady flight; return the sample at its last setpoint and all samples of the next 6 s."""
    vehicle.turn()
    end_us = vehicle.samples[-1].time_us + AIRBORNE_S * 1e6
    agent = subprocess.Popen([sys.executable, AGENT, vehicle.url])
    try:
        now = offboard = vehicle.samples[-1]
        while now.time_us < offboard.time_us + 2_500_000 or now.speed < 1.1:
            vehicle.turn_with_agent()
            now = vehicle.samples[-1]
            offboard = offboard if vehicle.is_offboard else now
            assert agent.poll() is None, "the agent ended"
            assert now.time_us < end_us, "the agent did not reach its speed"
    finally:
        agent.kill()  # SIGKILL: the agent cannot react
        agent.wait()
    vehicle.turn()  # receives the last setpoint
    last_us = vehicle.setpoint_us
    while vehicle.samples[-1].time_us < last_us + 6_000_000:
        vehicle.turn()
    after = [sample for sample in vehicle.samples if sample.time_us >= last_us]
    return after[0], after


@pytest.mark.slow
def test_after_fix_the_vehicle_stops_within_two_seconds(vehicle, tmp_path):
    link = vehicle.link()
    link.connect()
    result = check(link, seconds=1.0, folder=tmp_path)
    apply_changes(link, result, result.changes)
    link.close()
    killed, after = killed_in_flight(vehicle)
    profile = [f"{(s.time_us - killed.time_us) / 1e6:.2f} s {s.speed:.2f} m/s" for s in after[::20]]
    late = [sample for sample in after if sample.time_us > killed.time_us + WITHIN_S * 1e6]
    assert max(sample.speed for sample in late) < STOPPED, profile
    north, east, down = (a - b for a, b in zip(after[-1].position_ned, killed.position_ned, strict=True))
    assert 0.5 < math.hypot(north, east) < 2.0  # it flies on for half a second, then brakes; nothing else stops it
    assert abs(down) < 0.4


@pytest.mark.slow
def test_without_fix_the_vehicle_sinks(vehicle):
    killed, after = killed_in_flight(vehicle)
    assert after[-1].position_ned[2] - killed.position_ned[2] > 1.0  # docs/preflight.md warns of this
