"""A vehicle's tolerance of a disturbed setpoint stream, and one trace of a stream."""

import math

import numpy as np
import pytest

from dronecats.study.loop import trace
from dronecats.study.loop.stream import StreamedVehicle, StreamTrial, Tolerance
from foundation.errors import UsageError
from hil.impairment import Impairment
from vehicles.airframe import load


@pytest.fixture(scope="module")
def streamed():
    return StreamedVehicle(load("x500"))


def test_a_jittery_link_tracks_worse_and_a_dead_link_ends_offboard_after_the_timeout(streamed):
    perfect = streamed.trial(0.0, Impairment(), 1)
    late = streamed.trial(0.5, Impairment(jitter_s=0.5), 1)
    assert perfect.left_s is None
    assert late.left_s is None
    assert 0.2 < perfect.error < late.error < 1.2
    dead = streamed.trial(1.0, Impairment(loss=1.0), 1)
    timeout_s = streamed.vehicle.autopilot.parameters["COM_OF_LOSS_T"]
    assert dead.left_s == pytest.approx(timeout_s, abs=0.1)
    again = streamed.trial(0.0, Impairment(), 1)  # the vehicle is in offboard again, with a full battery
    assert again.left_s is None
    assert again.error == pytest.approx(perfect.error, rel=0.1)


def trials(level, error, *left):
    return tuple(StreamTrial(level, error, left_s) for left_s in left)


def test_the_tolerance_is_interpolated_between_levels():
    tolerance = Tolerance(
        "x500",
        "jitter",
        (trials(0.0, 0.3, None, None), trials(0.5, 0.5, None, None), trials(1.0, 0.9, None, None),
         trials(1.5, math.nan, 0.9, None)),
    )  # fmt: skip
    assert tolerance.perfect_error == 0.3
    assert tolerance.doubled_at == pytest.approx(0.625)
    assert tolerance.left_offboard_at == 1.5
    assert Tolerance("x500", "loss", tolerance.trials[:2]).doubled_at is None
    assert Tolerance("x500", "loss", tolerance.trials[:2]).left_offboard_at is None


def test_the_trace_contains_every_step_response():
    traced = trace.fly("x500")
    assert traced.autopilot == "ours"
    assert traced.time[-1] == pytest.approx(sum(step.seconds for step in trace.TRACE), abs=0.1)
    assert np.diff(traced.time) == pytest.approx(0.01, abs=1e-6)
    steps = dict(traced.steps())
    assert list(steps) == ["forward 1.2 m/s", "forward 0.5 m/s", "up 0.5 m/s", "yaw rate 1.05 rad/s"]
    for figures in steps.values():
        assert 0.1 < figures.delay_s < figures.rise_s < 2.0
        assert figures.overshoot_percent < 15.0


def test_a_missing_px4_and_an_airframe_that_px4_cannot_fly_are_reported():
    with pytest.raises(UsageError, match=r"--px4.*/nowhere/px4"):
        trace.fly("x500", px4="/nowhere/px4 -d -i {instance}")
    with pytest.raises(UsageError, match="hexa"):
        trace.fly("hexa", px4="/nowhere/px4 -d -i {instance}")
