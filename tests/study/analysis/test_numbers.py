"""Results per level and per pair, compared with counts by hand and with the statistical tests."""

import random
import shutil
from dataclasses import replace
from fractions import Fraction

import pytest

from dronecats.judge.statistics.shares import holm
from dronecats.study.analysis.differences import between_entrants, between_levels
from dronecats.study.analysis.loading import load_results
from dronecats.study.analysis.steps import served_rates, target_motions
from dronecats.study.analysis.study_results import ALL, StudiedFactor, level_results, level_steps
from dronecats.study.analysis.success_fits import half_success_fits, heat_maps, main_effects
from tests.study.analysis.in_memory import a_study, number_factor
from tests.study.studies import APPROACHING, SPEED, TRACKING, falling, write_study
from tests.support.randomisation import randomised
from tests.support.scores import an_episode


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("study") / "s"
    write_study(out, {"latency": (0.0, 1.0, 2.0)}, falling(), pilots=("vision", "oracle"),
                episodes=(*TRACKING[:4], *APPROACHING[:3]), flights=2)  # fmt: skip
    return out


@pytest.fixture(scope="module")
def studied(folder):
    return load_results(folder)


def test_shares_and_means_equal_counts_over_the_flights(studied):
    for result in level_results(studied, 0):
        flights = [
            f.scored for f in studied.flights
            if f.entrant == result.entrant and f.levels == (result.step.at,) and result.cell in (ALL, f.scored.cell)
        ]  # fmt: skip
        assert (result.success.successes, result.success.trials) == (sum(f.success for f in flights), len(flights))
        ne = result.measures[0]
        assert ne.episodes == len({f.episode for f in flights})
        # every episode has two flights, so the mean over episodes is that over flights
        assert ne.mean == pytest.approx(sum(float(f.values["ne_m"] or 0) for f in flights) / len(flights))


def test_broken_flights_are_counted_and_not_scored(tmp_path):
    write_study(tmp_path, {"latency": (0.0, 1.0)}, falling(), episodes=TRACKING[:4], flights=3, errors=0.5)
    results = level_results(load_results(tmp_path), 0)
    assert all(result.not_scored + result.success.trials == 12 for result in results)
    assert sum(result.not_scored for result in results) > 2


def test_broken_flights_are_in_no_pair_and_no_fit():
    """A broken flight counts as missing. If it counted as a failure, its level would look worse."""
    latency, wind = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 8.0, unit="m/s")
    points = [(s, v) for s in latency.levels for v in wind.levels]
    study = a_study([latency, wind], points, lambda s, v: 1.5 - s, episodes=8, flights=1, entrants=("vision", "oracle"))
    broken = {k for k, flight in enumerate(study.flights) if flight.levels[0] == 1.0 and k % 3 == 0}
    lost = replace(study, flights=tuple(
        replace(f, scored=an_episode(f.scored.run, f.scored.episode, "error")) if k in broken else f
        for k, f in enumerate(study.flights)
    ))  # fmt: skip
    without = replace(study, flights=tuple(f for k, f in enumerate(study.flights) if k not in broken))
    assert broken
    for compare in (between_levels, between_entrants):
        assert compare(lost, 0) == compare(without, 0)
    assert [fit.half for fit in half_success_fits(lost, 0)] == [fit.half for fit in half_success_fits(without, 0)]
    assert (main_effects(lost), heat_maps(lost)) == (main_effects(without), heat_maps(without))


def test_every_flight_of_a_latin_hypercube_is_in_the_results_of_its_levels():
    """The levels of the other factors recur by chance, here only at the wind of 0 m/s."""
    latency, wind = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 4.0, 8.0, unit="m/s")
    study = a_study([latency, wind], [(0.0, 0.0), (1.0, 0.0), (2.0, 8.0), (1.0, 4.0)], lambda s, v: 1.5 - s, episodes=4,
                    design="Latin hypercube, 4 points, seed 0")  # fmt: skip
    for factor, trials in ((0, [8, 16, 8]), (1, [16, 8, 8])):
        assert [result.success.trials for result in level_results(study, factor)] == trials


def test_each_level_is_compared_with_the_reference_over_paired_flights(studied):
    rows = [e for e in between_levels(studied, 0) if (e.first, e.cell, e.metric) == ("vision", "tracking", "success")]
    assert [(row.at.title, row.against.title) for row in rows] == [("1 s", "0 s"), ("2 s", "0 s")]
    for row in rows:
        sides: list[list[list[bool]]] = []
        for level in (row.at.at, 0.0):
            flights = [f for f in studied.of("vision", "tracking") if f.levels == (level,)]
            names = sorted({f.scored.episode for f in flights})
            sides.append([[f.scored.success for f in flights if f.scored.episode == name] for name in names])
        by_hand = [Fraction(sum(a) - sum(b), 2) for a, b in zip(*sides, strict=True)]
        assert row.difference.mean == pytest.approx(float(sum(by_hand) / 4))
        assert row.difference.p == pytest.approx(randomised(by_hand))
        assert row.pairs == 8
    assert [row.p_holm for row in rows] == holm([row.difference.p for row in rows])
    assert rows[1].difference.mean < 0  # success falls with latency


@pytest.mark.parametrize("episodes", [3, 9, 20])
def test_intervals_contain_only_possible_values_and_agree_with_their_tests(episodes):
    """One distance in ten is an outlier. No bound is outside the data. Intervals exclude 0 exactly if p ≤ 0.05."""
    latency = number_factor("latency", 0.0, 1.0, 2.0)
    points = [(level,) for level in latency.levels]
    rng, study = random.Random(episodes), a_study([latency], points, lambda s: 1.0 - s, episodes=episodes)
    far = []
    for flight in study.flights:
        delay = float(flight.levels[0])
        values = {
            "ne_m": 90.0 if rng.random() < 0.1 else 3.0 + delay,
            "dwell_s": rng.random() * delay,
            "longest_loss_s": rng.expovariate(1.0),
        }
        far.append(replace(flight, scored=replace(flight.scored, values=values)))
    study = replace(study, flights=tuple(far))
    for at in level_results(study, 0):
        for metric, measure in zip(("ne_m", "dwell_s", "longest_loss_s"), at.measures, strict=True):
            there = [float(f.scored.values[metric] or 0.0) for f in study.flights if f.levels == (at.step.at,)]
            ends = [end for end in (measure.low, measure.high) if end is not None]
            assert all(min(there) <= end <= max(there) for end in ends)
    compared = between_levels(study, 0)
    for pair in compared:
        low, high = pair.difference.low, pair.difference.high
        excludes_zero = low is not None and high is not None and not low <= 0 <= high
        assert excludes_zero == (pair.difference.p <= 0.05), pair
    assert episodes < 6 or any(pair.difference.p <= 0.05 for pair in compared)


def test_many_levels_are_grouped_but_the_reference_level_stays_alone():
    """Flights succeed only at 0 s. Every other level is equally worse, for any grouping of levels."""
    many = number_factor("latency", *(k / 4 for k in range(13)))
    study = a_study([many], [(level,) for level in many.levels], lambda s: 50.0 if s == 0.0 else -50.0, episodes=10)
    rows = [row for row in between_levels(study, 0) if row.metric == "success"]
    assert [row.at.title for row in rows] == [step.title for step in level_steps(many)[1:]]
    for row in rows:
        assert (row.against.title, row.against.members) == ("0 s", frozenset({0.0}))
        assert row.difference.mean == -1.0
        assert row.pairs == 10 * 2 * len(row.at.members)


def test_equal_levels_in_one_group_add_no_evidence():
    """The group has twice as many pairs as a single level, but the same difference, interval and p value."""
    many = number_factor("latency", *(float(k) for k in range(13)))
    study = a_study([many], [(level,) for level in many.levels], lambda s: 0.0, episodes=12, flights=1)
    first = {f.scored.episode: f.scored for f in study.flights if f.levels == (2.0,)}
    alike = tuple(f if f.levels == (0.0,) else replace(f, scored=first[f.scored.episode]) for f in study.flights)
    two_levels = number_factor("latency", 0.0, 2.0)
    alone = replace(study, factors=(two_levels,), flights=tuple(f for f in alike if f.levels in ((0.0,), (2.0,))))
    grouped, single = between_levels(replace(study, flights=alike), 0)[0], between_levels(alone, 0)[0]
    assert (grouped.pairs, single.pairs) == (24, 12)
    assert grouped.difference == single.difference


def test_a_flight_without_its_partner_is_in_no_pair(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "s")
    shutil.rmtree(copy / "vision-latency-0-f1" / TRACKING[0])
    rows = between_levels(load_results(copy), 0)
    pairs = {(e.first, e.at.title): e.pairs for e in rows if e.cell == "tracking" and e.metric == "success"}
    assert pairs["vision", "1 s"] == 7
    assert pairs["oracle", "1 s"] == 8


def test_entrants_are_compared_at_every_level(studied):
    rows = [e for e in between_entrants(studied, 0) if (e.cell, e.metric) == (ALL, "ne_m")]
    assert [(row.first, row.second, row.at.title) for row in rows] == [
        ("oracle", "vision", title) for title in ("0 s", "1 s", "2 s")
    ]
    means = {
        (result.entrant, result.step.title): result.measures[0].mean
        for result in level_results(studied, 0)
        if result.cell == ALL
    }
    for row in rows:
        difference = means["oracle", row.at.title] - means["vision", row.at.title]
        assert row.difference.mean == pytest.approx(difference)


def test_a_target_moves_by_its_speed_times_the_period(studied):
    motions = [motion for motion in target_motions(studied, 0) if motion.entrant == "vision"]
    assert {motion.cell for motion in motions} == {ALL, "tracking"}  # approached targets stand still
    for motion in motions:
        period = 2.5 + float(motion.step.at or 0.0)
        assert motion.period_s.at == pytest.approx([period] * 5)
        assert motion.moved_m.at == pytest.approx([SPEED * period] * 5)
        assert motion.episodes == 4
        # the camera sees 90°, so the view is twice as wide as deep; the depth begins at 20 m
        assert motion.width_m.at[-1] == pytest.approx(2 * (20.0 - 1.5 * 0.1), rel=0.01)
        assert motion.share.at[0] >= SPEED * period / 40.0


def test_served_rates_and_latencies_are_those_of_the_logs(studied):
    for served in served_rates(studied, 0):
        assert served.rate_hz.at == pytest.approx([1 / (2.5 + float(served.step.at or 0.0))] * 5)
        assert served.latency_s.at == pytest.approx([served.step.at] * 5)


def test_the_half_success_point_of_a_known_law_is_recovered():
    """The interval contains the true value. The order and the entrant of the flights have no effect."""
    latency = number_factor("latency", 0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
    points = [(level,) for level in latency.levels]
    study = a_study([latency], points, lambda s: -1.5 * (s - 1.2), episodes=40, seed=3)
    [fitted] = half_success_fits(study, 0)
    assert fitted.half.where == "within"
    assert fitted.half.low < 1.2 < fitted.half.high
    mixed = replace(study, flights=tuple(reversed(study.flights)), entrants=("other",))
    mixed = replace(mixed, flights=tuple(replace(flight, entrant="other") for flight in mixed.flights))
    [again] = half_success_fits(mixed, 0)
    assert again.half.value == pytest.approx(fitted.half.value, abs=1e-3)


def test_each_level_of_another_factor_has_its_own_half_success_point():
    latency, wind = number_factor("latency", 0.0, 1.0, 2.0, 4.0), number_factor("wind", 0.0, 8.0, unit="m/s")
    points = [(s, v) for s in latency.levels for v in wind.levels]
    study = a_study([latency, wind], points, lambda s, v: -2.0 * (s - 2.0 + float(v) / 8.0), episodes=60)
    still, blown = half_success_fits(study, 0)
    assert (still.beside, blown.beside) == ((0.0,), (8.0,))
    assert still.half.value == pytest.approx(2.0, abs=0.5)
    assert blown.half.value == pytest.approx(1.0, abs=0.5)


def test_many_levels_are_grouped_and_words_are_not():
    many = number_factor("latency", *(k / 7 for k in range(20)))
    steps = level_steps(many)
    assert len(steps) == 6
    assert {level for step in steps for level in step.members} == set(many.levels)
    assert steps[0].title == "0–0.286 s"
    words = StudiedFactor(name="latency_policy", unit="", levels=("fixed:1", "stall"), reference="fixed:1")
    assert [(step.title, step.at) for step in level_steps(words)] == [("fixed:1", None), ("stall", None)]
