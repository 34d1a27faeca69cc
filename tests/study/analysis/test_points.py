"""Those who fly beside one another at every point of a design, held to flights that are counted by hand."""

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
from tests.study.analysis.in_memory import a_study, number_factor
from tests.support.randomisation import randomised

LATENCY, WIND = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 5.0, 10.0, unit="m/s")
ALONE = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (0.0, 5.0), (0.0, 10.0)]
GRID = list(itertools.product(LATENCY.levels, WIND.levels))


def study(points=ALONE, factors=(LATENCY, WIND), **told):
    def law(*levels):
        return 1.5 - 0.8 * levels[0] - 0.1 * levels[-1]

    return a_study(factors, points, law, **{"entrants": ("one", "two"), "flights": 3, **told})


def flown(studied, entrant, point):
    by_episode: dict[str, list[bool]] = {}
    for each in studied.of(entrant):
        if each.levels == point:
            by_episode.setdefault(each.scored.episode, []).append(each.scored.success)
    return [by_episode[episode] for episode in sorted(by_episode)]


def apart(one: list[list[bool]], two: list[list[bool]]) -> list[Fraction]:
    """Return how far the shares of two lie apart in each episode."""
    return [Fraction(sum(a), len(a)) - Fraction(sum(b), len(b)) for a, b in zip(one, two, strict=True)]


def test_each_point_has_its_own_flights_and_is_named_by_what_is_unusual_there():
    studied = study()
    told = point_differences(studied)
    assert [each.title for each in told] == [
        UNDISTURBED.capitalize(), "Latency 1 s", "Latency 2 s", "Wind 5 m/s", "Wind 10 m/s",
    ]  # fmt: skip
    ps = []
    for each, point in zip(told, ALONE, strict=True):
        one, two = (flown(studied, entrant, point) for entrant in ("one", "two"))
        assert [(share.successes, share.trials) for share in each.shares] == [
            (sum(map(sum, s)), 60) for s in (one, two)
        ]
        assert each.success.difference.mean == pytest.approx((sum(map(sum, one)) - sum(map(sum, two))) / 60)
        assert each.success.pairs == 60
        assert each.success.difference.p == pytest.approx(randomised(apart(one, two)))
        ps.append(each.success.difference.p)
    assert [each.success.p_holm for each in told] == holm(ps)
    assert len(set(ps)) > 1


def test_over_all_points_an_episode_is_one_number():
    studied = study()
    [over] = pooled_differences(studied, point_differences(studied))
    one, two = (
        [list(itertools.chain(*some)) for some in zip(*(flown(studied, who, at) for at in ALONE), strict=True)]
        for who in ("one", "two")
    )
    assert (over.difference.episodes, over.pairs) == (20, 300)
    assert over.difference.p == pytest.approx(randomised(apart(one, two)))
    assert over.difference.mean == pytest.approx(sum(map(sum, one)) / 300 - sum(map(sum, two)) / 300)


def test_a_level_of_one_factor_at_a_time_is_compared_at_the_base_alone():
    at_base = next(e for e in between_entrants(study(), 0) if e.metric == SUCCESS and e.at.title == "0 s")
    assert at_base.pairs == 60  # and not those that were flown in the wind
    in_grid = next(e for e in between_entrants(study(GRID), 0) if e.metric == SUCCESS and e.at.title == "0 s")
    assert in_grid.pairs == 180


def test_one_factor_at_a_time_has_no_interaction_and_no_line_through_all():
    for points in itertools.permutations(ALONE):  # whichever was flown first
        alone = study(points, episodes=1, flights=1)
        assert (main_effects(alone), heat_maps(alone)) == ([], [])
    assert len(main_effects(study(GRID))) == 4
    assert len(heat_maps(study(GRID))) == 2


def test_a_latin_hypercube_has_effects_though_no_level_comes_twice():
    """Each level of both once: more points than levels there are not, and yet neither stays at a base."""
    levels = [0.0, 0.5, 1.0, 1.5, 2.0]
    latency, wind = number_factor("latency", *levels), number_factor("wind", *levels, unit="m/s")
    points = list(zip(levels, [1.0, 2.0, 0.0, 1.5, 0.5], strict=True))
    drawn = study(points, (latency, wind), episodes=4, flights=1)
    assert [each.factor for each in main_effects(drawn)] == [0, 1, 0, 1]
    assert len(heat_maps(drawn)) == 2


def test_where_nobody_is_beside_or_nobody_would_read_it_nothing_is_told():
    assert point_differences(study(entrants=("one",))) == []
    assert point_differences(study([(0.0,), (1.0,)], (LATENCY,))) == []
    drawn = number_factor("latency", *(0.01 * k for k in range(POINTS_MAX + 1)))
    many = study([(level, 0.0) for level in drawn.levels], (drawn, WIND), episodes=1, flights=1)
    assert point_differences(many) == []
    assert pooled_differences(many, []) == []


def test_the_usual_level_is_that_of_most_points_and_of_a_grid_the_reference():
    points = [(1.0, 0.0), (0.0, 0.0), (2.0, 0.0), (1.0, 5.0), (1.0, 10.0)]
    assert [each.title for each in point_differences(study(points))] == [
        UNDISTURBED.capitalize(), "Latency 0 s", "Latency 2 s", "Wind 5 m/s", "Wind 10 m/s",
    ]  # fmt: skip
    assert point_differences(study(GRID))[-1].title == "Latency 2 s, wind 10 m/s"
    assert point_title((LATENCY, WIND), (0.0, 5.0), (0.0, 0.0)) == "Wind 5 m/s"
