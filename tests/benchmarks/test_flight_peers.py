"""The benchmark of other simulators: one that fails the task is not timed, and a missing one is reported."""

import json

import pytest

from benchmarks import flight_peers as peers
from tests.benchmarks.peer_environments import make_environments


class Vehicle:
    """A point that follows its target with a lag and a constant offset."""

    def __init__(self, dt, lag_s, offset=(0.0, 0.0, 0.0)):
        self.dt, self.share, self.offset = dt, dt / lag_s, offset
        self.place, self.calls = [0.0, 0.0, 0.0], []

    def step(self, number):
        self.calls.append(number)
        for axis, wish in enumerate(peers.target(number * self.dt)):
            self.place[axis] += self.share * (wish + self.offset[axis] - self.place[axis])
        return tuple(self.place)


def test_a_flight_is_stepped_without_a_gap_and_timed():
    vehicle = Vehicle(0.02, 0.3)
    timing = peers.timed(vehicle.step, 0.02, 8.0)
    assert vehicle.calls == list(range(round((peers.UNTIMED_S + peers.REPEAT * 8.0) / 0.02)))
    assert timing["control_hz"] == 50
    assert timing["rtf"] > 100.0
    assert timing["rtf_cpu"] > 100.0


@pytest.mark.parametrize(
    ("lag_s", "offset"), [(0.3, (0.0, 0.0, -1.0)), (0.3, (0.0, 0.8, 0.0)), (0.3, (0.8, 0.0, 0.0)), (20.0, (0.0,) * 3)]
)
def test_peers_that_fail_the_task_are_not_timed(lag_s, offset):
    with pytest.raises(RuntimeError, match=r"-?\d\.\d\d to -?\d\.\d\d m"):
        peers.timed(Vehicle(0.02, lag_s, offset).step, 0.02, 8.0)


def test_absent_or_broken_peers_get_a_note_and_the_others_get_ratios(tmp_path, monkeypatch):
    answer = {"rtf": 4.0, "rtf_cpu": 5.0, "control_hz": 100}
    monkeypatch.setattr(peers, "PEERS", dict.fromkeys(("works", "breaks", "absent")))
    scripts = {"works": f"print({json.dumps(json.dumps(answer))})", "breaks": "raise ValueError('no rotors')"}
    make_environments(tmp_path, scripts)
    comparison = peers.compare(tmp_path, 500.0, 600.0)
    assert comparison["absent"].keys() == {"note"}
    assert "no rotors" in comparison["breaks"]["note"]
    assert comparison["works"] == {**answer, "ours_over_it": 125.0, "ours_over_it_cpu": 120.0}
