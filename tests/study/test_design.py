"""Properties of the designs: balance, orthogonality, one point in each part of a range, and reproducible points."""

import itertools
import math
import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dronecats.study.design import Axis, fractional, full, latin, one_at_a_time
from foundation.errors import UsageError

LETTERS = "ABCDEFGHIJ"
levels = st.lists(st.integers(0, 9), min_size=1, max_size=4, unique=True).map(tuple)
axes_of_levels = st.lists(levels, min_size=1, max_size=4).map(
    lambda drawn: [Axis(name=f"f{place}", levels=own) for place, own in enumerate(drawn)]
)


def two_levels(count):
    return [Axis(name=f"f{place}", low=-1.0, high=1.0) for place in range(count)]


def matrix(design):
    return np.array([list(point.values()) for point in design.points], dtype=float)


@given(axes_of_levels)
def test_a_full_design_has_every_combination_once(axes):
    points = [tuple(point.items()) for point in full(axes).points]
    assert len(points) == len(set(points)) == math.prod(len(axis.levels) for axis in axes)
    for axis in axes:
        times = Counter(dict(point)[axis.name] for point in points)
        assert set(times) == set(axis.levels)
        assert len(set(times.values())) == 1


@given(axes_of_levels)
def test_one_at_a_time_keeps_the_other_factors_at_their_first_level(axes):
    points = one_at_a_time(axes).points
    assert len(points) == 1 + sum(len(axis.levels) - 1 for axis in axes)
    first = {axis.name: axis.levels[0] for axis in axes}
    assert points[0] == first
    assert all(sum(point[name] != first[name] for name in first) == 1 for point in points[1:])
    assert len({tuple(point.items()) for point in points}) == len(points)


@given(axes_of_levels)
def test_one_at_a_time_repeats_all_points_for_each_level_of_a_crossed_factor(axes):
    agents = Axis(name="agent", levels=("paper", "steady", "own"))
    alone = [tuple(point.items()) for point in one_at_a_time(axes).points]
    made = one_at_a_time([axes[0], agents, *axes[1:]], ("agent", "pilot"))
    by_agent: dict[object, list[object]] = {agent: [] for agent in agents.levels}
    for point in made.points:
        by_agent[point["agent"]].append(tuple((name, level) for name, level in point.items() if name != "agent"))
    assert list(by_agent.values()) == [alone] * 3
    assert "agent" in made.description
    assert len(one_at_a_time([agents], ("agent",)).points) == 3


@st.composite
def fractions(draw):
    """Draw a number of factors, and generators that make the last ones from products of two or more of the others."""
    basic = draw(st.integers(2, 5))
    products = [letters for size in range(2, basic + 1) for letters in itertools.combinations(LETTERS[:basic], size)]
    chosen = draw(st.lists(st.sampled_from(products), min_size=1, max_size=4, unique=True))
    signs = draw(st.lists(st.sampled_from(["", "-"]), min_size=len(chosen), max_size=len(chosen)))
    made = zip(LETTERS[basic:], signs, chosen, strict=False)
    return basic + len(chosen), [f"{letter} = {sign}{''.join(product)}" for letter, sign, product in made]


@given(fractions())
@example((6, ["E = ABCD", "F = ABC"]))  # the product of its two defining words is the shortest word
def test_a_fraction_is_balanced_and_orthogonal_up_to_its_resolution(drawn):
    """Every set of at most R − 1 columns has all combinations of signs equally often."""
    count, generators = drawn
    design = fractional(two_levels(count), generators)
    signs = matrix(design)
    assert signs.shape == (2 ** (count - len(generators)), count)
    assert not signs.sum(axis=0).any()
    assert np.array_equal(signs.T @ signs, np.eye(count) * len(signs))
    # the resolution is the size of the smallest set of columns with a constant product
    shortest = next(
        size
        for size in range(1, count + 1)
        for columns in itertools.combinations(range(count), size)
        if abs(signs[:, columns].prod(axis=1).sum()) == len(signs)
    )
    roman = {3: "III", 4: "IV", 5: "V", 6: "VI"}[shortest]
    assert re.search(rf"2\^\({count}-{len(generators)}\) .*\b{roman}, ", design.description)
    for place, generator in enumerate(generators):
        made, _, product = generator.partition(" = ")
        column = signs[:, [LETTERS.index(letter) for letter in product.lstrip("-")]].prod(axis=1)
        assert np.array_equal(signs[:, LETTERS.index(made)], -column if "-" in product else column), place


def test_published_fractions_have_their_published_resolution():
    for count, generators, resolution in (  # NIST/SEMATECH e-Handbook of Statistical Methods, 5.3.3.4.7, table 3.17
        (3, ["C=AB"], "III"), (4, ["D=ABC"], "IV"), (5, ["E=ABCD"], "V"), (5, ["D=AB", "E=AC"], "III"),
        (6, ["F=ABCDE"], "VI"), (6, ["E=ABC", "F=BCD"], "IV"), (7, ["D=AB", "E=AC", "F=BC", "G=ABC"], "III"),
        (7, ["E=ABC", "F=BCD", "G=ACD"], "IV"), (8, ["G=ABCD", "H=ABEF"], "V"),
    ):  # fmt: skip
        assert f" {resolution}," in fractional(two_levels(count), generators).description, (count, generators)


def test_generators_may_name_the_factors():
    axes = [Axis(name=name, levels=("off", "on")) for name in ("latency", "wind", "frame_delay", "gusts")]
    by_name = fractional(axes, ["gusts = latency * wind * frame_delay"])
    assert by_name == fractional(axes, ["D = ABC"])
    assert by_name.points[0] == {"latency": "off", "wind": "off", "frame_delay": "off", "gusts": "off"}


def test_invalid_fractions_are_rejected():
    for count, generators, parts in (
        (4, [], "generators"),
        (4, ["D"], "D = ABC.*'D'"),
        (4, ["D ="], "D = ABC.*'D ='"),
        (4, ["CD = AB"], "D = ABC.*'CD = AB'"),
        (4, ["D = ABZ"], "'ABZ'.* .f0, f1, f2, f3.* ABCD"),
        (4, ["D = AD"], "'D = AD'"),
        (4, ["D = AAB"], "'D = AAB'"),
        (4, ["D = AB", "D = AC"], "'D = AC'"),
        (4, ["A = BC", "D = AB"], "f0 "),
        (4, ["D = A"], "D = A: .*resolution II,"),
        (5, ["D = AB", "E = AB"], "D = AB; E = AB: .*resolution II,"),
        (2, ["B = A"], " 3 .* 15 .* 2$"),
    ):
        with pytest.raises(UsageError, match=parts):
            fractional(two_levels(count), generators)


def test_a_fraction_rejects_factors_with_more_than_two_levels():
    with pytest.raises(UsageError, match=r"f2 .*3"):
        fractional([*two_levels(2), Axis(name="f2", levels=(1, 2, 3))], ["C=AB"])


@given(st.integers(2, 40), st.integers(0, 2**31), st.integers(1, 4))
def test_a_latin_hypercube_has_one_point_in_each_part_of_a_range(points, seed, count):
    axes = [Axis(name=f"f{place}", low=10.0 * place, high=10.0 * place + 5.0) for place in range(count)]
    design = latin(axes, points, seed)
    assert design == latin(axes, points, seed)
    for axis, column in zip(axes, matrix(design).T, strict=True):
        share = (np.sort(column) - axis.low) / (axis.high - axis.low) * points
        slack = 1e-3  # levels are rounded to six digits
        assert all(place - slack <= value <= place + 1 + slack for place, value in enumerate(share))
        assert column.min() >= axis.low
        assert column.max() <= axis.high


@given(st.integers(2, 40), st.integers(0, 2**31), levels)
def test_a_latin_hypercube_uses_the_levels_of_a_factor_about_equally_often(points, seed, own):
    axes = [
        Axis(name="x", low=0.0, high=1.0),
        Axis(name="levels", levels=own),
        Axis(name="n", low=3, high=6, integer=True),
    ]
    drawn = latin(axes, points, seed).points
    assert len(drawn) == points
    for name, allowed in (("levels", own), ("n", (3, 4, 5, 6))):
        times = Counter(point[name] for point in drawn)
        assert set(times) <= set(allowed)
        assert max(times.values()) - min(times[level] for level in allowed) <= 2
        assert all(abs(times[level] - points / len(allowed)) < 2 for level in allowed)


def test_equal_points_of_a_latin_hypercube_are_merged():
    drawn = latin([Axis(name="a", levels=("x", "y"))], 10, 1).points
    assert sorted(point["a"] for point in drawn) == ["x", "y"]


def test_another_seed_gives_other_points():
    axes = [Axis(name="x", low=0.0, high=1.0)]
    assert latin(axes, 5, 1).points != latin(axes, 5, 2).points


def test_too_many_combinations_are_rejected():
    with pytest.raises(UsageError, match="10,000"):
        full([Axis(name=f"f{place}", levels=tuple(range(9))) for place in range(9)])
