"""Stability margins of the designed gains of every airframe, checked against python-control."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from autopilot.control.loop_design import GAIN_MARGIN_MIN, PHASE_MARGIN_MIN, Gains, design, margin, margins_by_control
from foundation.errors import UsageError
from vehicles.airframe import load, names


@cache
def designed(name: str) -> Gains:
    """Return the gains of a shipped airframe."""
    return design(load(name))


@pytest.mark.parametrize("name", names())
def test_every_loop_keeps_its_margins(name):
    gains = designed(name)
    checked = margins_by_control(load(name), gains)
    assert set(gains.margins) == set(checked)
    assert len(checked) == 10
    for loop, margins in checked.items():
        assert margins.phase_deg >= PHASE_MARGIN_MIN, loop
        assert margins.gain_db >= GAIN_MARGIN_MIN, loop
        own = gains.margins[loop]
        assert own.phase_deg == pytest.approx(margins.phase_deg, abs=0.1), loop
        assert own.gain_db == pytest.approx(margins.gain_db, abs=0.1), loop
        assert own.crossover == pytest.approx(margins.crossover, rel=1e-3), loop


@pytest.mark.parametrize("name", names())
def test_outer_loops_are_slower_than_inner_ones(name):
    margins = designed(name).margins
    for axis in ("roll", "pitch", "yaw"):
        assert margins[f"{axis} attitude"].crossover < margins[f"{axis} rate"].crossover / 2
    assert margins["horizontal velocity"].crossover < margins["pitch attitude"].crossover / 2
    for axis in ("horizontal", "vertical"):
        assert margins[f"{axis} position"].crossover < margins[f"{axis} velocity"].crossover / 1.5


def test_margins_match_an_analytic_example():
    """k / (s (s + 1) (s + 2)) has its phase crossover at √2 rad/s, where its gain is k / 6."""
    margins = margin(lambda s: 1.0 / (s * (s + 1.0) * (s + 2.0)), np.geomspace(0.01, 100.0, 4000))
    assert margins.gain_db == pytest.approx(20.0 * math.log10(6.0), abs=0.01)
    assert margins.phase_deg == pytest.approx(53.41, abs=0.05)


def test_slow_rotors_get_slower_loops():
    x500 = load("x500")
    slow = replace(x500, name="slow", curve=replace(x500.curve, time_constant_up_s=0.05, time_constant_down_s=0.08))
    assert design(slow).rate_p[0] < 0.6 * design(x500).rate_p[0]
    assert design(slow).attitude_p[0] <= design(x500).attitude_p[0]


def test_an_airframe_that_cannot_hover_is_rejected():
    with pytest.raises(UsageError, match="lead"):
        design(replace(load("x500"), name="lead", mass_kg=4.0))
