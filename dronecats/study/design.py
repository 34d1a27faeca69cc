"""Which points of the factors' space are flown: every combination, a regular fraction, a Latin hypercube, or one factor
at a time. Pure, and the same for the same input.

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
from foundation.run_folder.benchmark import Level

KINDS = ("full", "fractional", "latin", "one-at-a-time")
POINTS_MAX = 10_000
FACTORS_MAX = 15  # of a fraction: more have names that nobody reads, and 2^15 defining words are looked through
DIGITS = 6  # significant ones of a level that is drawn from a range
ROMAN = ("0", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII", "XIII", "XIV", "XV")

DesignPoint = Mapping[str, Level]  # factor → its level


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One factor with what is flown of it: some levels, or, without any, whatever lies between two numbers."""

    name: str
    levels: tuple[Level, ...] = ()
    low: float = 0.0
    high: float = 0.0
    whole: bool = False

    @property
    def ends(self) -> tuple[Level, ...]:
        """The levels, of a range its two ends."""
        return self.levels or (self._number(self.low), self._number(self.high))

    def at(self, share: float) -> Level:
        """Return the level at a share of the way, 0 ≤ share < 1: each of the levels has an equal part of it."""
        if self.levels:
            return self.levels[int(share * len(self.levels))]
        if self.whole:
            return int(self.low + math.floor(share * (self.high - self.low + 1)))
        return self._number(self.low + share * (self.high - self.low))

    def _number(self, value: float) -> Level:
        return int(value) if self.whole else float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The points, and in words how they were chosen."""

    said: str
    points: tuple[DesignPoint, ...]  # each another one


def full(axes: Sequence[Axis]) -> Design:
    """Return every combination of the levels, of a range those of its ends; the first factor changes slowest."""
    count = math.prod(len(axis.ends) for axis in axes)
    if count > POINTS_MAX:
        raise UsageError(f"all combinations are {count:,} points, more than {POINTS_MAX:,}; take a fraction, or latin")
    points = itertools.product(*(axis.ends for axis in axes))
    return Design(said="full factorial", points=_named(axes, points))


def one_at_a_time(axes: Sequence[Axis], crossed: Collection[str] = ()) -> Design:
    """Return the first level of every factor, and from there each other level of each factor alone.

    Factors whose names are in `crossed` are no such: each of their combinations is at every one of these points.
    """
    base = tuple(axis.ends[0] for axis in axes)
    alone = [(place, axis) for place, axis in enumerate(axes) if axis.name not in crossed]
    points = [base, *((*base[:at], level, *base[at + 1 :]) for at, axis in alone for level in axis.ends[1:])]
    said = "one factor at a time, from the first levels"
    beside = [(place, axis) for place, axis in enumerate(axes) if axis.name in crossed]
    for place, axis in beside:
        points = [(*each[:place], level, *each[place + 1 :]) for each in points for level in axis.ends]
    if beside and alone:
        said += f", each with every {' and '.join(axis.name for _, axis in beside)}"
    return Design(said=said, points=_named(axes, points))


def latin(axes: Sequence[Axis], points: int, seed: int) -> Design:
    """Return so many points of which each factor's lie one in each of as many equal parts of its range.

    A factor with levels has each of them equally often, but for one. Points that come out the same are flown once.
    """
    from scipy.stats import qmc

    if not 2 <= points <= POINTS_MAX:
        raise UsageError(f"a Latin hypercube wants 2 to {POINTS_MAX:,} points, got {points}")
    shares = qmc.LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(points)
    rows = [tuple(axis.at(float(share)) for axis, share in zip(axes, row, strict=True)) for row in shares]
    return Design(said=f"Latin hypercube, {points} points, seed {seed}", points=_named(axes, dict.fromkeys(rows)))


def fractional(axes: Sequence[Axis], generators: Sequence[str]) -> Design:
    """Return a regular fraction 2^(k−p) of the combinations of two levels each, p being the number of generators.

    A generator makes one factor from the product of others that none makes: `D = ABC`, or by names
    `wind = latency * frame_delay`, with a minus for the other half. Letters count the factors in their order. Raises
    UsageError for a generator that is none, and for a resolution below III, where one factor passes for another.
    """
    for axis in axes:
        if len(axis.ends) != 2:
            raise UsageError(f"a fraction wants two levels of each factor; {axis.name} has {len(axis.ends)}")
    if not 3 <= len(axes) <= FACTORS_MAX:
        raise UsageError(f"a fraction wants 3 to {FACTORS_MAX} factors, got {len(axes)}")
    made = _generated([axis.name for axis in axes], generators)
    basic = [place for place in range(len(axes)) if place not in made]
    rows = []
    for signs in itertools.product((-1, 1), repeat=len(basic)):
        by_place = dict(zip(basic, signs, strict=True))
        for place, (sign, product) in made.items():
            by_place[place] = sign * math.prod(by_place[each] for each in product)
        rows.append(tuple(axis.ends[by_place[place] > 0] for place, axis in enumerate(axes)))
    words = [1 << place | sum(1 << each for each in product) for place, (_, product) in made.items()]
    number = resolution(words)
    if number < 3:
        raise UsageError(
            f"{'; '.join(generators)}: of resolution {ROMAN[number]}, in which one factor passes for another"
        )
    told = ", ".join(_written(place, sign, product) for place, (sign, product) in made.items())
    said = f"fractional factorial 2^({len(axes)}-{len(made)}) of resolution {ROMAN[number]}, {told}"
    return Design(said=said, points=_named(axes, rows))


def resolution(words: Sequence[int]) -> int:
    """Return the length of the shortest word of the defining relation that these generate, factors being bits."""
    relation = {0}
    for word in words:
        relation |= {word ^ each for each in relation}
    return min(each.bit_count() for each in relation - {0})


def _generated(names: Sequence[str], generators: Sequence[str]) -> dict[int, tuple[int, tuple[int, ...]]]:
    """Return for each factor that is made, by its place: the sign, and the places of which it is the product."""
    if not generators:
        raise UsageError('a fraction wants generators, for example generators = ["D = ABC"]')
    made: dict[int, tuple[int, tuple[int, ...]]] = {}
    for text in generators:
        left, equals, right = text.partition("=")
        right = right.strip()
        sign = -1 if right.startswith(("-", "−")) else 1
        target, product = _places(left, names, text), _places(right.lstrip("-−"), names, text)
        if not equals or len(target) != 1 or not product:
            raise UsageError(f"a generator is one factor = a product of others, for example D = ABC, got '{text:.60}'")
        if target[0] in made or target[0] in product or len(set(product)) < len(product):
            raise UsageError(f"'{text:.60}': each factor is made once, of others, and each of these stands there once")
        made[target[0]] = (sign, tuple(sorted(product)))
    for place in itertools.chain.from_iterable(product for _, product in made.values()):
        if place in made:
            raise UsageError(f"{names[place]} is made by a generator itself, so no other can be made of it")
    return dict(sorted(made.items()))


def _places(text: str, names: Sequence[str], whole: str) -> list[int]:
    """Return the places of the factors that a side of a generator names, by their names or their letters."""
    found = []
    letters = {letter: place for place, letter in enumerate(ascii_uppercase[: len(names)])}
    for word in filter(None, re.split(r"[*×·\s]+", text)):
        if word in names:
            found.append(names.index(word))
        elif all(letter in letters for letter in word):
            found += [letters[letter] for letter in word]
        else:
            raise UsageError(
                f"'{whole:.60}': '{word:.60}' is none of the factors {', '.join(names)}, nor of the letters"
                f" {''.join(letters)}"
            )
    return found


def _written(place: int, sign: int, product: Sequence[int]) -> str:
    return f"{ascii_uppercase[place]} = {'-' if sign < 0 else ''}{''.join(ascii_uppercase[each] for each in product)}"


def _named(axes: Sequence[Axis], rows: Iterable[tuple[Level, ...]]) -> tuple[DesignPoint, ...]:
    return tuple({axis.name: level for axis, level in zip(axes, row, strict=True)} for row in rows)
