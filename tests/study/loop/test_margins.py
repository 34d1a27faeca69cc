"""Delay margins predicted by python-control, compared with delays injected into the simulated control cascade."""

import math

import numpy as np
import pytest

from dronecats.study.loop.hover import LOOPS, SAMPLE_S, Hover, StepResponse, select_loops
from dronecats.study.loop.margins import step_figures, study_loops
from foundation.errors import UsageError
from vehicles.airframe import load, names
from vehicles.sensors import Suite

WITHIN = 0.2
SMALL, LARGE = "nano", "hexa"


@pytest.fixture(scope="module")
def hovers():
    return {name: Hover(load(name)) for name in (SMALL, LARGE)}


@pytest.mark.parametrize("name", [SMALL, LARGE])
@pytest.mark.parametrize("loop", LOOPS, ids=lambda loop: loop.name)
def test_the_predicted_margin_equals_the_injected_one(hovers, name, loop):
    (margins,) = study_loops(hovers[name], (loop,))
    assert margins.injected.delay_s == pytest.approx(margins.predicted.delay_s, rel=WITHIN)
    assert margins.injected.frequency == pytest.approx(margins.predicted.frequency, rel=WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_predicted_margins_equal_injected_ones_for_every_airframe(name):
    for margins in study_loops(Hover(load(name))):
        assert abs(margins.prediction_error) < WITHIN, margins.loop.name


@pytest.mark.parametrize("loop", [LOOPS[0], LOOPS[3], LOOPS[6]], ids=lambda loop: loop.name)
def test_sensor_errors_do_not_change_the_margin(loop):
    """After twenty periods, the oscillation is within the noise at 0.9 of the margin, and has grown at 1.1."""
    (margins,) = study_loops(Hover(load("x500")), (loop,))
    noisy = Hover(load("x500"), suite=Suite())
    period_s = 2.0 * math.pi / margins.injected.frequency

    def left(share):
        value = noisy.step_response(loop, share * margins.injected.delay_s, 20.0 * period_s).value
        return np.ptp(value[-round(period_s / SAMPLE_S) :]) / loop.step

    assert left(0.9) < 1.0
    assert left(1.1) > 5.0


def test_step_figures_of_a_first_order_response_are_correct():
    time = np.linspace(1e-3, 10.0, 10_000)
    figures = step_figures(StepResponse(time, 0.2 * (1.0 - np.exp(-2.0 * time)), 0.2))  # T = 0.5 s
    assert figures.rise_s == pytest.approx(0.5 * math.log(9.0), abs=2e-3)
    assert figures.delay_s == pytest.approx(0.5 * math.log(2.0), abs=2e-3)
    assert figures.overshoot_percent == 0.0
    assert figures.settled_s == pytest.approx(0.5 * math.log(10.0), abs=2e-3)


def test_a_ringing_response_settles_only_when_it_stays_within_a_tenth():
    time = np.linspace(1e-3, 10.0, 10_000)
    value = 1.0 - np.exp(-time) * np.cos(12.0 * time)
    figures = step_figures(StepResponse(time, value, 1.0))
    assert figures.delay_s < 0.1
    assert 2.0 < figures.settled_s < math.log(10.0) + 0.01  # after ln 10 s, the envelope is within a tenth
    assert np.all(np.abs(value[time >= figures.settled_s] - 1.0) <= 0.1)
    assert math.isnan(step_figures(StepResponse(time[:100], value[:100], 1.0)).settled_s)


def test_loops_are_chosen_by_group_or_name():
    assert [loop.name for loop in select_loops(["velocity"])] == ["horizontal velocity", "vertical velocity"]
    assert [loop.group for loop in select_loops(["yaw rate", "attitude"])] == ["rate", *["attitude"] * 3]
    assert select_loops(None) == LOOPS
    with pytest.raises(UsageError, match=r"--loops position.*velocity"):
        select_loops(["position"])
