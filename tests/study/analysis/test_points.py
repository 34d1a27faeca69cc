"""Comparisons of entrants at every point of a design, checked against counts by hand."""

import itertools
from fractions import Fraction

import pytest

from dronecats.judge.statistics.shares import holm
from dronecats.study.analysis.differences import (
    POINTS_MAX,
    SUCCESS,
    UNDISTURBED,
    between_entrants,
    point_differences,
    point_title,
    pooled_differences,
)
from dronecats.study.analysis.success_fits import heat_maps, main_effects
from dronecats.study.design import ONE_AT_A_TIME
from tests.study.analysis.in_memory import a_study, number_factor
from tests.support.randomisation import randomised

LATENCY, WIND = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 5.0, 10.0, unit="m/s")
ALONE = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (0.0, 5.0), (0.0, 10.0)]
GRID = list(itertools.product(LATENCY.levels, WIND.levels))


def falling(*levels):
    return 1.5 - 0.8 * levels[0] - 0.1 * levels[-1]


def study(points=ALONE, factors=(LATENCY, WIND), law=falling, **options):
    return a_study(factors, points, law, **{"entrants": ("one", "two"), "flights": 3, **options})


def outcomes(studied, entrant, point):
    by_episode: dict[str, list[bool]] = {}
    for flight in studied.of(entrant):
        if flight.levels == point:
            by_episode.setdefault(flight.scored.episode, []).append(flight.scored.success)
    return [by_episode[episode] for episode in sorted(by_episode)]


def apart(first: list[list[bool]], second: list[list[bool]]) -> list[Fraction]:
    """Return the difference of the two shares of each episode."""
    return [Fraction(sum(a), len(a)) - Fraction(sum(b), len(b)) for a, b in zip(first, second, strict=True)]


def test_each_point_uses_its_own_flights_and_is_named_by_its_unusual_levels():
    studied = study()
    rows = [row for row in point_differences(studied) if row.metric == SUCCESS]
    assert [row.at.title for row in rows] == [
        UNDISTURBED.capitalize(), "Latency 1 s", "Latency 2 s", "Wind 5 m/s", "Wind 10 m/s",
    ]  # fmt: skip
    ps = []
    for row, point in zip(rows, ALONE, strict=True):
        first, second = (outcomes(studied, entrant, point) for entrant in ("one", "two"))
        assert [(share.successes, share.trials) for share in row.shares] == [
            (sum(map(sum, flights)), 60) for flights in (first, second)
        ]
        assert row.difference.mean == pytest.approx((sum(map(sum, first)) - sum(map(sum, second))) / 60)
        assert row.pairs == 60
        assert row.difference.p == pytest.approx(randomised(apart(first, second)))
        ps.append(row.difference.p)
    assert [row.p_holm for row in rows] == holm(ps)
    assert len(set(ps)) > 1


def test_an_episode_counts_once_over_all_points():
    studied = study()
    [over] = pooled_differences(studied, point_differences(studied))
    first, second = (
        [
            list(itertools.chain(*flights))
            for flights in zip(*(outcomes(studied, entrant, at) for at in ALONE), strict=True)
        ]
        for entrant in ("one", "two")
    )
    assert (over.difference.episodes, over.pairs) == (20, 300)
    assert over.difference.p == pytest.approx(randomised(apart(first, second)))
    assert over.difference.mean == pytest.approx(sum(map(sum, first)) / 300 - sum(map(sum, second)) / 300)


def test_one_factor_at_a_time_compares_levels_only_at_the_base_of_the_other_factor():
    alone = study(design=f"{ONE_AT_A_TIME}, from the first levels")
    at_base = next(e for e in between_entrants(alone, 0) if e.metric == SUCCESS and e.at.title == "0 s")
    assert at_base.pairs == 60  # without the flights in the wind
    in_grid = next(e for e in between_entrants(study(GRID), 0) if e.metric == SUCCESS and e.at.title == "0 s")
    assert in_grid.pairs == 180


def test_one_factor_at_a_time_has_no_main_effects_and_no_heat_maps():
    for points in itertools.permutations(ALONE):  # in any order
        alone = study(points, episodes=1, flights=1)
        assert (main_effects(alone), heat_maps(alone)) == ([], [])
    assert len(main_effects(study(GRID))) == 4
    assert len(heat_maps(study(GRID))) == 2


def test_a_latin_hypercube_has_effects_although_no_level_is_repeated():
    """Each level of both factors occurs once, and neither factor has a base level."""
    levels = [0.0, 0.5, 1.0, 1.5, 2.0]
    latency, wind = number_factor("latency", *levels), number_factor("wind", *levels, unit="m/s")
    points = list(zip(levels, [1.0, 2.0, 0.0, 1.5, 0.5], strict=True))
    drawn = study(points, (latency, wind), episodes=4, flights=1)
    assert [effect.factor for effect in main_effects(drawn)] == [0, 1, 0, 1]
    assert len(heat_maps(drawn)) == 2


def test_single_entrants_single_factors_and_too_many_points_have_no_rows():
    assert point_differences(study(entrants=("one",))) == []
    assert point_differences(study([(0.0,), (1.0,)], (LATENCY,))) == []
    drawn = number_factor("latency", *(0.01 * k for k in range(POINTS_MAX + 1)))
    many = study([(level, 0.0) for level in drawn.levels], (drawn, WIND), episodes=1, flights=1)
    assert point_differences(many) == []
    assert pooled_differences(many, []) == []


def test_the_usual_level_is_the_most_frequent_one_or_the_reference_in_a_grid():
    points = [(1.0, 0.0), (0.0, 0.0), (2.0, 0.0), (1.0, 5.0), (1.0, 10.0)]
    assert [row.at.title for row in point_differences(study(points)) if row.metric == SUCCESS] == [
        UNDISTURBED.capitalize(), "Latency 0 s", "Latency 2 s", "Wind 5 m/s", "Wind 10 m/s",
    ]  # fmt: skip
    assert point_differences(study(GRID))[-1].at.title == "Latency 2 s, wind 10 m/s"
    assert point_title((LATENCY, WIND), (0.0, 5.0), (0.0, 0.0)) == "Wind 5 m/s"


def test_entrants_are_compared_in_a_study_without_other_factors():
    row, *_ = point_differences(study([()], factors=(), law=lambda: 0.0))
    assert (row.first, row.second, row.at.title.lower()) == ("one", "two", UNDISTURBED)
