"""What the report says in sentences, held to studies whose truth is known."""

import math
import re
from dataclasses import replace

import pytest

from dronecats.judge.statistics.half import HalfSuccess
from dronecats.judge.statistics.mixed_logit import WIDEST
from dronecats.study.report import tables
from dronecats.study.report.findings import compute_findings, half_interval, scatter_value
from dronecats.study.report.sections import summary
from tests.study.analysis.in_memory import a_study, number_factor
from tests.support.scores import an_episode


@pytest.mark.parametrize(("easiest", "first"), [(2.0, "0.5 Hz"), (0.25, "1 Hz")])
def test_the_first_level_told_apart_is_the_one_nearest_to_the_reference(easiest, first):
    """Half of the levels are as good as the reference, the others fail: the first of these is told, from either end."""
    rate = replace(number_factor("rate", 0.25, 0.5, 1.0, 2.0, unit="Hz"), reference=easiest)
    law = (lambda hz: 50.0 if hz >= 1.0 else -50.0) if easiest == 2.0 else (lambda hz: 50.0 if hz < 1.0 else -50.0)
    said = summary(compute_findings(a_study([rate], [(hz,) for hz in rate.levels], law, episodes=10), "command"))
    assert any(re.search(rf"\b{first} .* {easiest:g} Hz", each) for each in said)


@pytest.mark.parametrize("more", [0, 4])  # factors, of more than four of which the rest is one sentence
def test_a_level_that_only_the_correction_keeps_from_being_told_apart_is_named_with_it(more):
    """Six of twelve fail at 4 s and nowhere else: p = 0.031 by itself, 0.125 corrected for four levels."""
    latency = number_factor("latency", 0.0, 1.0, 2.0, 3.0, 4.0)
    others = [number_factor(name, 0.0) for name in ("wind", "gusts", "payload", "gps_delay")][:more]
    points = [(level, *(0.0,) * more) for level in latency.levels]
    flown = a_study([latency, *others], points, lambda *levels: 99.0, episodes=12, flights=1)
    lost = {f"campus-tracking-{k:02}" for k in range(6)}
    flights = [
        replace(f, scored=an_episode(f.scored.run, f.scored.episode, values={"ne_m": 9.0}))
        if f.levels[0] == 4.0 and f.scored.episode in lost else f
        for f in flown.flights
    ]  # fmt: skip
    said = summary(compute_findings(replace(flown, flights=tuple(flights)), "command"))
    [told] = [each for each in said if "Holm" in each]
    assert re.search(r"Holm", told)
    assert re.search(r"4 s\b.*0\.031.*0\.125", told)


def test_an_interval_is_outside_of_the_levels_only_where_all_of_it_is():
    for low, high, scatter, ends in (
        (1.75, math.inf, 12.0, ["1.75 s", "2 s"]),  # no slope is the best, and yet the interval begins within
        (-math.inf, 1.25, 12.0, ["0.25 s", "1.25 s"]),
        (math.inf, math.inf, None, []),  # all succeed: nothing is fitted
        (math.inf, math.inf, 1.0, ["2 s"]),
        (-math.inf, -math.inf, 1.0, ["0.25 s"]),
    ):
        told = HalfSuccess(where="above all", value=None, low=low, high=high, slope=None, scatter=scatter, p_slope=0.01,
                           p_straight=None, groups=20, trials=40)  # fmt: skip
        assert re.findall(r"[\d.]+ s", half_interval(number_factor("latency", 0.25, 2.0), told)) == ends, (low, high)


def test_a_scatter_at_its_bound_is_told_as_that_or_more():
    told = HalfSuccess(where="within", value=1.0, low=0.5, high=1.5, slope=None, scatter=WIDEST, p_slope=0.01,
                       p_straight=None, groups=20, trials=40)  # fmt: skip
    assert scatter_value(told) == "≥ 12"
    assert scatter_value(replace(told, scatter=3.25)) == 3.25
    assert scatter_value(replace(told, scatter=None)) is None


def test_a_p_below_a_thousandth_is_only_said_to_be_so():
    """Twenty episodes that all succeed at 0 s and all fail at 2 s: no p is 0, and 0.000 would say so."""
    latency = number_factor("latency", 0.0, 2.0)
    flown = a_study([latency], [(0.0,), (2.0,)], lambda s: 50.0 - 50.0 * s, entrants=("vision", "oracle"))
    found = compute_findings(flown, "command")
    along = found.factors[0]
    against, beside = tables.between_levels(found, along), tables.between_entrants(found, along)
    assert against
    assert beside
    for table, said in ((against, "< 0.001"), (beside, "1.000")):
        row = table.blocks[0].rows[0]
        told = {column.name: cell.text(column) for column, cell in zip(table.columns, row.cells, strict=True)}
        assert (told["success_p"], told["success_p_holm"]) == (said, said)


def test_of_many_factors_what_is_told_apart_is_told_and_the_rest_in_one_sentence():
    factors = [number_factor(name, 0.0, 1.0) for name in ("latency", "wind", "gusts", "payload", "gps_delay")]
    base = (0.0,) * 5
    points = [base, *(tuple(float(k == place) for k in range(5)) for place in range(5))]
    told = a_study(factors, points, lambda *levels: 3.0 - 8.0 * levels[0], flights=1, scatter=0.1)
    half, cost, rest = summary(compute_findings(told, "command"))
    assert "latency" in half
    assert re.search(r"latency\b.*\b1 s .*\b0 s", cost)
    assert "wind, gusts, payload, gps delay" in rest
    assert "latency" not in rest
