"""The pilot gets a message if a landing does not end, or does not end upright."""

import math

import pytest

from foundation.frames import quat_from_euler
from tests.autopilot.commander_bench import Bench


def landing(monkeypatch, lean_deg, *, carried):
    """Return a bench that lands with a tilt of `lean_deg`. With `carried`, an obstacle keeps it at its height."""
    bench = Bench()
    bench.fly(3.0)
    step, height = bench.core.step, bench.core.estimate["position_ned"][2]

    def held(time_us):
        step(time_us)
        estimate = bench.core.estimate
        estimate["attitude"] = quat_from_euler(math.radians(lean_deg), 0.0, 0.0)
        if carried:
            estimate["position_ned"][2], estimate["velocity_ned"][2] = height, 0.0
            estimate["thrust_setpoint"] = estimate["hover_thrust"]

    monkeypatch.setattr(bench.core, "step", held)
    bench.client.mode(4, 6)
    return bench


def test_a_blocked_landing_is_reported_once(monkeypatch):
    bench = landing(monkeypatch, 40.0, carried=True)
    bench.run(30.0)
    assert bench.commander.armed
    texts = [text for text in bench.client.texts() if "Landing blocked" in text]
    assert len(texts) == 1
    assert "40" in texts[0]
    assert len(texts[0]) <= 50


@pytest.mark.parametrize(("lean_deg", "is_told"), [(0.0, False), (15.0, False), (45.0, True)])
def test_a_large_tilt_after_landing_is_reported(monkeypatch, lean_deg, is_told):
    bench = landing(monkeypatch, lean_deg, carried=False)
    bench.run(30.0)
    assert not bench.commander.armed
    texts = " ".join(bench.client.texts())
    assert ("not upright" in texts) == is_told
    assert not is_told or "45" in texts
    assert "Landing blocked" not in texts
