"""What is told at each level and of pairs, counted by hand and held to the tests of the statistics."""

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


def test_shares_and_means_are_those_of_the_flights(studied):
    for each in level_results(studied, 0):
        flown = [
            f.scored for f in studied.flights
            if f.entrant == each.entrant and f.levels == (each.step.at,) and each.cell in (ALL, f.scored.cell)
        ]  # fmt: skip
        assert (each.success.successes, each.success.trials) == (sum(f.success for f in flown), len(flown))
        ne = each.measures[0]
        assert ne.episodes == len({f.episode for f in flown})
        # of two flights an episode, as many of each, the mean over episodes is that over flights
        assert ne.mean == pytest.approx(sum(float(f.values["ne_m"] or 0) for f in flown) / len(flown))


def test_what_broke_is_counted_and_not_scored(tmp_path):
    write_study(tmp_path, {"latency": (0.0, 1.0)}, falling(), episodes=TRACKING[:4], flights=3, errors=0.5)
    told = level_results(load_results(tmp_path), 0)
    assert all(each.not_scored + each.success.trials == 12 for each in told)
    assert sum(each.not_scored for each in told) > 2


def test_what_broke_is_in_no_pair_and_no_fit():
    """As if it had never been flown: nobody's failure, which would make the level it broke at worse."""
    latency, wind = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 8.0, unit="m/s")
    points = [(s, v) for s in latency.levels for v in wind.levels]
    told = a_study([latency, wind], points, lambda s, v: 1.5 - s, episodes=8, flights=1, entrants=("vision", "oracle"))
    broken = {k for k, each in enumerate(told.flights) if each.levels[0] == 1.0 and k % 3 == 0}
    lost = replace(told, flights=tuple(
        replace(f, scored=an_episode(f.scored.run, f.scored.episode, "error")) if k in broken else f
        for k, f in enumerate(told.flights)
    ))  # fmt: skip
    without = replace(told, flights=tuple(f for k, f in enumerate(told.flights) if k not in broken))
    assert broken
    for found in (between_levels, between_entrants):
        assert found(lost, 0) == found(without, 0)
    assert [each.half for each in half_success_fits(lost, 0)] == [each.half for each in half_success_fits(without, 0)]
    assert (main_effects(lost), heat_maps(lost)) == (main_effects(without), heat_maps(without))


def test_levels_are_against_the_reference_on_the_same_flights(studied):
    told = [e for e in between_levels(studied, 0) if (e.first, e.cell, e.metric) == ("vision", "tracking", "success")]
    assert [(each.at.title, each.against.title) for each in told] == [("1 s", "0 s"), ("2 s", "0 s")]
    for each in told:
        sides: list[list[list[bool]]] = []
        for level in (each.at.at, 0.0):
            flown = [f for f in studied.of("vision", "tracking") if f.levels == (level,)]
            names = sorted({f.scored.episode for f in flown})
            sides.append([[f.scored.success for f in flown if f.scored.episode == name] for name in names])
        by_hand = [Fraction(sum(a) - sum(b), 2) for a, b in zip(*sides, strict=True)]
        assert each.difference.mean == pytest.approx(float(sum(by_hand) / 4))
        assert each.difference.p == pytest.approx(randomised(by_hand))
        assert each.pairs == 8
    assert [each.p_holm for each in told] == holm([each.difference.p for each in told])
    assert told[1].difference.mean < 0  # success falls with latency


@pytest.mark.parametrize("episodes", [3, 9, 20])
def test_intervals_hold_only_what_can_be_and_agree_with_the_tests_beside_them(episodes):
    """Distances of which one in ten is far off: none is below 0, and 0 is outside of an interval where p tells it."""
    latency = number_factor("latency", 0.0, 1.0, 2.0)
    points = [(level,) for level in latency.levels]
    rng, flown = random.Random(episodes), a_study([latency], points, lambda s: 1.0 - s, episodes=episodes)
    far = []
    for each in flown.flights:
        delay = float(each.levels[0])
        values = {
            "ne_m": 90.0 if rng.random() < 0.1 else 3.0 + delay,
            "dwell_s": rng.random() * delay,
            "longest_loss_s": rng.expovariate(1.0),
        }
        far.append(replace(each, scored=replace(each.scored, values=values)))
    flown = replace(flown, flights=tuple(far))
    for at in level_results(flown, 0):
        for metric, told in zip(("ne_m", "dwell_s", "longest_loss_s"), at.measures, strict=True):
            there = [float(f.scored.values[metric] or 0.0) for f in flown.flights if f.levels == (at.step.at,)]
            ends = [end for end in (told.low, told.high) if end is not None]
            assert all(min(there) <= end <= max(there) for end in ends)
    compared = between_levels(flown, 0)
    for pair in compared:
        low, high = pair.difference.low, pair.difference.high
        tells = low is not None and high is not None and not low <= 0 <= high
        assert tells == (pair.difference.p <= 0.05), pair
    assert episodes < 6 or any(pair.difference.p <= 0.05 for pair in compared)


def test_of_many_levels_the_reference_stays_one():
    """Only 0 s is flown well: every later level is as much worse, however levels are told together."""
    many = number_factor("latency", *(k / 4 for k in range(13)))
    flown = a_study([many], [(level,) for level in many.levels], lambda s: 50.0 if s == 0.0 else -50.0, episodes=10)
    told = [each for each in between_levels(flown, 0) if each.metric == "success"]
    assert [each.at.title for each in told] == [step.title for step in level_steps(many)[1:]]
    for each in told:
        assert (each.against.title, each.against.members) == ("0 s", frozenset({0.0}))
        assert each.difference.mean == -1.0
        assert each.pairs == 10 * 2 * len(each.at.members)


def test_a_reference_flight_beside_several_is_one_pair():
    """Two levels told together, alike in every episode, are no more evidence than one of them."""
    many = number_factor("latency", *(float(k) for k in range(13)))
    flown = a_study([many], [(level,) for level in many.levels], lambda s: 0.0, episodes=12, flights=1)
    first = {f.scored.episode: f.scored for f in flown.flights if f.levels == (2.0,)}
    alike = tuple(f if f.levels == (0.0,) else replace(f, scored=first[f.scored.episode]) for f in flown.flights)
    one = number_factor("latency", 0.0, 2.0)
    alone = replace(flown, factors=(one,), flights=tuple(f for f in alike if f.levels in ((0.0,), (2.0,))))
    grouped, single = between_levels(replace(flown, flights=alike), 0)[0], between_levels(alone, 0)[0]
    assert (grouped.pairs, single.pairs) == (24, 12)
    assert grouped.difference == single.difference


def test_a_flight_without_its_partner_is_in_no_pair(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "s")
    shutil.rmtree(copy / "vision-latency-0-f1" / TRACKING[0])
    told = between_levels(load_results(copy), 0)
    pairs = {(e.first, e.at.title): e.pairs for e in told if e.cell == "tracking" and e.metric == "success"}
    assert pairs["vision", "1 s"] == 7
    assert pairs["oracle", "1 s"] == 8


def test_entrants_are_beside_one_another_at_every_level(studied):
    told = [e for e in between_entrants(studied, 0) if (e.cell, e.metric) == (ALL, "ne_m")]
    assert [(each.first, each.second, each.at.title) for each in told] == [
        ("oracle", "vision", title) for title in ("0 s", "1 s", "2 s")
    ]
    means = {
        (each.entrant, each.step.title): each.measures[0].mean for each in level_results(studied, 0) if each.cell == ALL
    }
    for each in told:
        difference = means["oracle", each.at.title] - means["vision", each.at.title]
        assert each.difference.mean == pytest.approx(difference)


def test_a_target_moves_by_its_speed_times_the_period(studied):
    told = [each for each in target_motions(studied, 0) if each.entrant == "vision"]
    assert {each.cell for each in told} == {ALL, "tracking"}  # what is approached stands still
    for each in told:
        period = 2.5 + float(each.step.at or 0.0)
        assert each.period_s.at == pytest.approx([period] * 5)
        assert each.moved_m.at == pytest.approx([SPEED * period] * 5)
        assert each.episodes == 4
        # 90° across: as wide as twice the depth, from 20 m on
        assert each.width_m.at[-1] == pytest.approx(2 * (20.0 - 1.5 * 0.1), rel=0.01)
        assert each.share.at[0] >= SPEED * period / 40.0


def test_the_rate_is_the_one_that_was_served(studied):
    for each in served_rates(studied, 0):
        assert each.rate_hz.at == pytest.approx([1 / (2.5 + float(each.step.at or 0.0))] * 5)
        assert each.latency_s.at == pytest.approx([each.step.at] * 5)


def test_the_half_of_a_known_law_is_found():
    """The place of a law is in the interval, whatever the order and the names of the flights."""
    latency = number_factor("latency", 0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
    points = [(level,) for level in latency.levels]
    told = a_study([latency], points, lambda s: -1.5 * (s - 1.2), episodes=40, seed=3)
    [found] = half_success_fits(told, 0)
    assert found.half.where == "within"
    assert found.half.low < 1.2 < found.half.high
    mixed = replace(told, flights=tuple(reversed(told.flights)), entrants=("other",))
    mixed = replace(mixed, flights=tuple(replace(each, entrant="other") for each in mixed.flights))
    [again] = half_success_fits(mixed, 0)
    assert again.half.value == pytest.approx(found.half.value, abs=1e-3)


def test_beside_other_factors_each_choice_has_its_own_half():
    latency, wind = number_factor("latency", 0.0, 1.0, 2.0, 4.0), number_factor("wind", 0.0, 8.0, unit="m/s")
    points = [(s, v) for s in latency.levels for v in wind.levels]
    told = a_study([latency, wind], points, lambda s, v: -2.0 * (s - 2.0 + float(v) / 8.0), episodes=60)
    still, blown = half_success_fits(told, 0)
    assert (still.beside, blown.beside) == ((0.0,), (8.0,))
    assert still.half.value == pytest.approx(2.0, abs=0.5)
    assert blown.half.value == pytest.approx(1.0, abs=0.5)


def test_many_levels_are_told_in_parts_and_words_one_by_one():
    many = number_factor("latency", *(k / 7 for k in range(20)))
    steps = level_steps(many)
    assert len(steps) == 6
    assert {level for step in steps for level in step.members} == set(many.levels)
    assert steps[0].title == "0–0.286 s"
    words = StudiedFactor(name="latency_policy", unit="", levels=("fixed:1", "stall"), reference="fixed:1")
    assert [(step.title, step.at) for step in level_steps(words)] == [("fixed:1", None), ("stall", None)]
