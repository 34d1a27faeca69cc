"""The vehicle's reaction to `kill -9` of its agent in flight, before and after `preflight --fix`.

The simulator runs in real time, and the agent in its own process. The tests measure the true motion.
"""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from hil.link.link import Link
from hil.link.transport import connect
from hil.preflight.check import apply_changes, check
from tests.support.simulated_vehicle import simulated_vehicle
from tests.system.truth_watch import TruthWatch

AGENT = Path(__file__).with_name("streaming_agent.py")
STOPPED = 0.2  # m/s
WITHIN_S = 2.0


@pytest.fixture
def simulator(tmp_path):
    with simulated_vehicle(tmp_path) as ports:
        yield f"udpout://127.0.0.1:{ports['agent'][0]}", TruthWatch(ports["truth"])


def killed_in_flight(url, truth):
    """Kill the agent in steady flight; return the last truth sample and all samples of the next 6 s."""
    agent = subprocess.Popen([sys.executable, AGENT, url], stdout=subprocess.PIPE)
    try:
        assert agent.stdout is not None
        assert agent.stdout.readline() == b"streaming\n"
        began_s = truth.newest().time_s
        truth.until(lambda now: now.time_s > began_s + 2.5 and now.speed > 1.1, 10.0)
        killed = truth.newest()
    finally:
        agent.kill()  # SIGKILL: the agent cannot react
        agent.wait()
    truth.until(lambda now: now.time_s > killed.time_s + 6.0, 7.0)
    truth.close()
    return killed, [sample for sample in truth.samples if sample.time_s >= killed.time_s]


@pytest.mark.slow
def test_after_fix_the_vehicle_stops_within_two_seconds(simulator, tmp_path):
    url, truth = simulator
    link = Link(connect(url))
    link.connect()
    result = check(link, seconds=1.0, folder=tmp_path)
    apply_changes(link, result, result.changes)
    link.close()
    killed, after = killed_in_flight(url, truth)
    profile = [f"{s.time_s - killed.time_s:.2f} s {s.speed:.2f} m/s" for s in after[::10]]
    late = [sample for sample in after if sample.time_s > killed.time_s + WITHIN_S]
    assert max(sample.speed for sample in late) < STOPPED, profile
    gone = math.hypot(after[-1].north - killed.north, after[-1].east - killed.east)
    assert 0.5 < gone < 2.0  # it flies on for half a second, then brakes; nothing else stops it
    assert abs(after[-1].height - killed.height) < 0.4


@pytest.mark.slow
def test_without_fix_the_vehicle_sinks(simulator):
    url, truth = simulator
    killed, after = killed_in_flight(url, truth)
    assert killed.height - after[-1].height > 1.0  # docs/preflight.md warns of this
