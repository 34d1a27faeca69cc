"""A deliberately stalled simulator: the share is as requested, the seed sets the times, and it really stops."""

import time

import pytest

from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.pace import Staller
from dronecats.flight.sitl.simulator_process import Simulator
from dronecats.flight.spec.disturbances import VehicleFaults


def stalled_at(share: float, seed: int, seconds: int = 1000) -> list[int]:
    """Return the vehicle times (µs) of the stalls."""
    now, stops = [0], list[int]()
    staller = Staller(VehicleFaults(stalled=share, stall_s=0.7), seed, lambda seconds: stops.append(now[0]))
    staller.begin(500_000)
    for now[0] in range(0, seconds * 1_000_000, 10_000):
        staller.turn(now[0])
    assert staller.count == len(stops)
    return stops


def test_the_share_of_stalls_is_as_requested_and_the_seed_chooses_the_seconds() -> None:
    stops = stalled_at(0.2, 1)
    assert stops == stalled_at(0.2, 1) != stalled_at(0.2, 2)
    assert len(stops) == pytest.approx(200, abs=45)
    assert all((at - 500_000) % 1_000_000 == 0 for at in stops)
    assert set(stops) <= set(stalled_at(0.5, 1))  # a larger share adds stalls to these
    assert stalled_at(0.0, 1) == []
    assert len(stalled_at(1.0, 1, seconds=10)) == 10


def test_a_stall_stops_the_simulator_while_wall_time_passes() -> None:
    simulator = Simulator(
        SimulatorConfig(
            episode="residential-approaching-01", speed=100.0, disturbances=VehicleFaults(stalled=1.0, stall_s=0.4)
        )
    )
    try:
        simulator.ready()
        simulator.turn()
        simulator.do("begin", {"t0_us": simulator.simulation.time_us})
        began_s, began_us = time.monotonic(), simulator.simulation.time_us
        simulator.turn()
        assert time.monotonic() - began_s >= 0.4
        assert simulator.simulation.time_us - began_us == 10_000
        assert simulator.do("pace", {})["lag_max_s"] >= 0.39
    finally:
        simulator.close()
