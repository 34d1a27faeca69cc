"""The sentences of the study report, for studies with a known truth."""

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
def test_the_first_significant_level_is_the_one_nearest_to_the_reference(easiest, first):
    """Half of the levels succeed like the reference, the others fail. The report names the nearest failing level."""
    rate = replace(number_factor("rate", 0.25, 0.5, 1.0, 2.0, unit="Hz"), reference=easiest)
    law = (lambda hz: 50.0 if hz >= 1.0 else -50.0) if easiest == 2.0 else (lambda hz: 50.0 if hz < 1.0 else -50.0)
    sentences = summary(compute_findings(a_study([rate], [(hz,) for hz in rate.levels], law, episodes=10), "command"))
    assert any(re.search(rf"\b{first} .* {easiest:g} Hz", sentence) for sentence in sentences)


@pytest.mark.parametrize("more", [0, 4])  # further factors; from five factors on, the rest share one sentence
def test_a_level_significant_only_before_correction_is_reported_with_both_p_values(more):
    """Six of twelve flights fail, all at 4 s. p is 0.031, and 0.125 after correction for four levels."""
    latency = number_factor("latency", 0.0, 1.0, 2.0, 3.0, 4.0)
    others = [number_factor(name, 0.0) for name in ("wind", "gusts", "payload", "gps_delay")][:more]
    points = [(level, *(0.0,) * more) for level in latency.levels]
    study = a_study([latency, *others], points, lambda *levels: 99.0, episodes=12, flights=1)
    lost = {f"campus-tracking-{k:02}" for k in range(6)}
    flights = [
        replace(f, scored=an_episode(f.scored.run, f.scored.episode, values={"ne_m": 9.0}))
        if f.levels[0] == 4.0 and f.scored.episode in lost else f
        for f in study.flights
    ]  # fmt: skip
    sentences = summary(compute_findings(replace(study, flights=tuple(flights)), "command"))
    [corrected] = [sentence for sentence in sentences if "Holm" in sentence]
    assert re.search(r"4 s\b.*0\.031.*0\.125", corrected)


def test_an_interval_is_reported_outside_the_levels_only_if_all_of_it_is_outside():
    for low, high, scatter, ends in (
        (1.75, math.inf, 12.0, ["1.75 s", "2 s"]),  # without a best slope the interval still begins within
        (-math.inf, 1.25, 12.0, ["0.25 s", "1.25 s"]),
        (math.inf, -math.inf, None, []),  # all succeed: nothing is fitted
        (math.inf, -math.inf, 1.0, []),
        (1.75, -math.inf, 1.0, ["0.25 s", "1.75 s"]),  # no slope is possible, so the side is unknown
        (math.inf, 1.25, 1.0, ["1.25 s", "2 s"]),
        (math.inf, math.inf, 1.0, ["2 s"]),
        (-math.inf, -math.inf, 1.0, ["0.25 s"]),
    ):
        half = HalfSuccess(where="above all", value=None, low=low, high=high, slope=None, scatter=scatter, p_slope=0.01,
                           p_straight=None, groups=20, trials=40)  # fmt: skip
        assert re.findall(r"[\d.]+ s", half_interval(number_factor("latency", 0.25, 2.0), half)) == ends, (low, high)


def test_a_scatter_at_its_bound_is_shown_as_at_least_the_bound():
    half = HalfSuccess(where="within", value=1.0, low=0.5, high=1.5, slope=None, scatter=WIDEST, p_slope=0.01,
                       p_straight=None, groups=20, trials=40)  # fmt: skip
    assert scatter_value(half) == "≥ 12"
    assert scatter_value(replace(half, scatter=3.25)) == 3.25
    assert scatter_value(replace(half, scatter=None)) is None


def test_a_p_value_below_0_001_is_shown_as_less_than_0_001():
    """Twenty episodes all succeed at 0 s and all fail at 2 s. No p is 0, so 0.000 would be wrong."""
    latency = number_factor("latency", 0.0, 2.0)
    study = a_study([latency], [(0.0,), (2.0,)], lambda s: 50.0 - 50.0 * s, entrants=("vision", "oracle"))
    findings = compute_findings(study, "command")
    along = findings.factors[0]
    against, beside = tables.between_levels(findings, along), tables.between_entrants(findings, along)
    assert against
    assert beside
    for table, text in ((against, "< 0.001"), (beside, "1.000")):
        row = table.blocks[0].rows[0]
        cells = {column.name: cell.text(column) for column, cell in zip(table.columns, row.cells, strict=True)}
        assert (cells["success_p"], cells["success_p_holm"]) == (text, text)


def test_many_factors_without_a_significant_effect_share_one_sentence():
    factors = [number_factor(name, 0.0, 1.0) for name in ("latency", "wind", "gusts", "payload", "gps_delay")]
    base = (0.0,) * 5
    points = [base, *(tuple(float(k == place) for k in range(5)) for place in range(5))]
    study = a_study(factors, points, lambda *levels: 3.0 - 8.0 * levels[0], flights=1, scatter=0.1)
    half, cost, rest = summary(compute_findings(study, "command"))
    assert "latency" in half
    assert re.search(r"latency\b.*\b1 s .*\b0 s", cost)
    assert "wind, gusts, payload, gps delay" in rest
    assert "latency" not in rest
