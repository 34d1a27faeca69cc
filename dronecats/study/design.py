"""Designs of a study: every combination of levels, a regular fraction, a Latin hypercube, or one factor at a time.

All functions are pure and deterministic.

Fractions of two-level designs: Box, Hunter and Hunter, Statistics for Experimenters, chapter 6. Latin hypercubes:
McKay, Beckman and Conover (1979), made by `scipy.stats.qmc`.
"""

import itertools
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from foundation.errors import UsageError
from foundation.run_folder.results import Level

KINDS = ("full", "fractional", "latin", "one-at-a-time")
ONE_AT_A_TIME = "one factor at a time"  # first words of the description of this design
POINTS_MAX = 10_000
FACTORS_MAX = 15  # factors of a fraction; `resolution` examines up to 2^15 defining words
DIGITS = 6  # significant digits of a level drawn from a range
ROMAN = ("0", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII", "XIII", "XIV", "XV")

DesignPoint = Mapping[str, Level]  # factor → its level


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One factor of a design, with its levels or, if it has none, a range between two numbers."""

    name: str
    levels: tuple[Level, ...] = ()
    low: float = 0.0
    high: float = 0.0
    integer: bool = False

    @property
    def ends(self) -> tuple[Level, ...]:
        """The levels, or the two ends of the range."""
        return self.levels or (self._number(self.low), self._number(self.high))

    def at(self, share: float) -> Level:
        """Return the level at a share of the axis, 0 ≤ share < 1. Each level covers an equal part of the axis."""
        if self.levels:
            return self.levels[int(share * len(self.levels))]
        if self.integer:
            return int(self.low + math.floor(share * (self.high - self.low + 1)))
        return self._number(self.low + share * (self.high - self.low))

    def _number(self, value: float) -> Level:
        return int(value) if self.integer else float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    description: str
    points: tuple[DesignPoint, ...]  # without duplicates


def full(axes: Sequence[Axis]) -> Design:
    """Return every combination of the levels, or of the ends of ranges. The first factor changes slowest."""
    count = math.prod(len(axis.ends) for axis in axes)
    if count > POINTS_MAX:
        raise UsageError(f"all combinations are {count:,} points, more than {POINTS_MAX:,}. Take a fraction, or latin")
    points = itertools.product(*(axis.ends for axis in axes))
    return Design(description="full factorial", points=_points(axes, points))


def one_at_a_time(axes: Sequence[Axis], crossed: Collection[str] = ()) -> Design:
    """Return the base point (the first level of every factor), and each point that differs from it in one factor.

    All levels of the factors in `crossed` are combined with each of these points.
    """
    base = tuple(axis.ends[0] for axis in axes)
    varied_axes = [(place, axis) for place, axis in enumerate(axes) if axis.name not in crossed]
    points = [base, *((*base[:at], level, *base[at + 1 :]) for at, axis in varied_axes for level in axis.ends[1:])]
    description = f"{ONE_AT_A_TIME}, from the first levels"
    crossed_axes = [(place, axis) for place, axis in enumerate(axes) if axis.name in crossed]
    for place, axis in crossed_axes:
        points = [(*point[:place], level, *point[place + 1 :]) for point in points for level in axis.ends]
    if crossed_axes and varied_axes:
        description += f", each with every {' and '.join(axis.name for _, axis in crossed_axes)}"
    return Design(description=description, points=_points(axes, points))


def latin(axes: Sequence[Axis], points: int, seed: int) -> Design:
    """Return `points` points. Each factor's range is divided into `points` equal parts, with one point in each part.

    If a factor has levels, each level gets nearly the same number of points. Duplicate points are left out.
    """
    from scipy.stats import qmc

    if not 2 <= points <= POINTS_MAX:
        raise UsageError(f"a Latin hypercube needs 2 to {POINTS_MAX:,} points, got {points}")
    shares = qmc.LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(points)
    rows = [tuple(axis.at(float(share)) for axis, share in zip(axes, row, strict=True)) for row in shares]
    return Design(
        description=f"Latin hypercube, {points} points, seed {seed}", points=_points(axes, dict.fromkeys(rows))
    )


def fractional(axes: Sequence[Axis], generators: Sequence[str]) -> Design:
    """Return a regular fraction of all combinations: 2^(k−p) points for k factors of two levels and p generators.

    A generator sets one factor to the product of others: `D = ABC`, or with names `wind = latency * frame_delay`. A
    minus before the product selects another fraction. A is the first factor, B the second. Raises UsageError for an
    invalid generator, and for a resolution below III, in which factors are confounded with each other.
    """
    for axis in axes:
        if len(axis.ends) != 2:
            raise UsageError(f"a fraction needs two levels of each factor, but {axis.name} has {len(axis.ends)}")
    if not 3 <= len(axes) <= FACTORS_MAX:
        raise UsageError(f"a fraction needs 3 to {FACTORS_MAX} factors, got {len(axes)}")
    generated = _generated([axis.name for axis in axes], generators)
    basic = [place for place in range(len(axes)) if place not in generated]
    rows = []
    for signs in itertools.product((-1, 1), repeat=len(basic)):
        by_place = dict(zip(basic, signs, strict=True))
        for place, (sign, product) in generated.items():
            by_place[place] = sign * math.prod(by_place[factor] for factor in product)
        rows.append(tuple(axis.ends[by_place[place] > 0] for place, axis in enumerate(axes)))
    words = [1 << place | sum(1 << factor for factor in product) for place, (_, product) in generated.items()]
    number = resolution(words)
    if number < 3:
        raise UsageError(
            f"{'; '.join(generators)}: of resolution {ROMAN[number]}, in which factors are confounded with each other"
        )
    text = ", ".join(_generator_text(place, sign, product) for place, (sign, product) in generated.items())
    description = f"fractional factorial 2^({len(axes)}-{len(generated)}) of resolution {ROMAN[number]}, {text}"
    return Design(description=description, points=_points(axes, rows))


def resolution(words: Sequence[int]) -> int:
    """Return the number of factors in the shortest word of the defining relation.

    `words` are the defining words of the generators, as bit sets of factors.
    """
    relation = {0}
    for word in words:
        relation |= {word ^ product for product in relation}
    return min(product.bit_count() for product in relation - {0})


def _generated(names: Sequence[str], generators: Sequence[str]) -> dict[int, tuple[int, tuple[int, ...]]]:
    """Return index of a generated factor → (sign, indices of the product's factors)."""
    if not generators:
        raise UsageError('a fraction needs generators, for example generators = ["D = ABC"]')
    generated: dict[int, tuple[int, tuple[int, ...]]] = {}
    for text in generators:
        left, equals, right = text.partition("=")
        right = right.strip()
        sign = -1 if right.startswith(("-", "−")) else 1
        target, product = _places(left, names, text), _places(right.lstrip("-−"), names, text)
        if not equals or len(target) != 1 or not product:
            raise UsageError(
                f"a generator must be one factor = a product of others, for example D = ABC; got '{text:.60}'"
            )
        if target[0] in generated or target[0] in product or len(set(product)) < len(product):
            raise UsageError(f"'{text:.60}': generate each factor once, from other factors that appear once each")
        generated[target[0]] = (sign, tuple(sorted(product)))
    for place in itertools.chain.from_iterable(product for _, product in generated.values()):
        if place in generated:
            raise UsageError(f"{names[place]} is generated itself, so it cannot generate another factor")
    return dict(sorted(generated.items()))


def _places(text: str, names: Sequence[str], generator: str) -> list[int]:
    """Return the indices of the factors in one side of a generator. The side has names or letters of factors."""
    places = []
    letters = {letter: place for place, letter in enumerate(ascii_uppercase[: len(names)])}
    for word in filter(None, re.split(r"[*×·\s]+", text)):
        if word in names:
            places.append(names.index(word))
        elif all(letter in letters for letter in word):
            places += [letters[letter] for letter in word]
        else:
            raise UsageError(
                f"'{generator:.60}': '{word:.60}' is neither a factor ({', '.join(names)}) nor one of the letters"
                f" {''.join(letters)}"
            )
    return places


def _generator_text(place: int, sign: int, product: Sequence[int]) -> str:
    return f"{ascii_uppercase[place]} = {'-' if sign < 0 else ''}{''.join(ascii_uppercase[k] for k in product)}"


def _points(axes: Sequence[Axis], rows: Iterable[tuple[Level, ...]]) -> tuple[DesignPoint, ...]:
    return tuple({axis.name: level for axis, level in zip(axes, row, strict=True)} for row in rows)
