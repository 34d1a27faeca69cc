"""The numbers and points of an action in the forms that models give them. Each raises ActionError for any other."""

import re
from typing import Any

from dronecats.agent.action import ActionError, AxisOrder
from dronecats.agent.reply.mends import Mend
from dronecats.agent.reply.tolerant import Cut, Quantity, number_in
from foundation.protocol import POINT_SPAN

METRES = frozenset({"m", "meter", "meters", "metre", "metres"})
DEGREES = frozenset({"°", "º", "deg", "degs", "degree", "degrees"})
PLAIN: frozenset[str] = frozenset()  # a point's numbers have no unit
BOXES = ("bbox_2d", "box_2d", "bbox", "box")
_NUMBER = re.compile(r"([+\-\u2212\uff0b\uff0d]?(?:\d+[.\uff0e]?\d*|[.\uff0e]\d+))\s*([^\W\d_]+|°|º)?")
_TEXT_MAX = 80  # characters of a number or a point as text
_POINT_TAG = re.compile(r"<point>(.*?)</point>", re.DOTALL)
_BETWEEN = re.compile(r"\s*[,，;]\s*|\s+")
_BRACKETS = {"[": "]", "(": ")"}


def number(value: Any, what: str, units: frozenset[str], mends: set[Mend]) -> float:
    """Return a number that stands as one, as text, or with one of its units; what was mended goes into `mends`."""
    if isinstance(value, Cut):
        raise ActionError(f"the reply breaks off in {what}")
    if isinstance(value, Quantity):
        _check_unit(value.unit, what, units, mends)
        return value.number
    if isinstance(value, str):
        said = _NUMBER.fullmatch(value.strip()) if len(value) <= _TEXT_MAX else None
        if said is None:
            raise ActionError(f"{what} is not a number")
        mends.add("number_text")
        if said.group(2):
            _check_unit(said.group(2), what, units, mends)
        return number_in(said.group(1))
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ActionError(f"{what} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise ActionError(f"{what} is too large") from None


def point(value: Any, axis_order: AxisOrder, mends: set[Mend], depth: int = 3) -> tuple[float, float]:
    """Return (x, y), 0–1000. A pair is in the declared order; only what is named x and y needs none."""
    if isinstance(value, Cut):
        raise ActionError('the reply breaks off in "point"')
    if isinstance(value, str):
        mends.add("point_form")
        value = _pair_in(value)
    if isinstance(value, dict):
        mends.add("point_form")
        if "x" in value and "y" in value:
            x, y = (number(value[key], f'"{key}"', PLAIN, mends) for key in ("x", "y"))
            return x, y
        labelled = [value[key] for key in ("point", "point_2d") if key in value]
        value = labelled[0] if len(labelled) == 1 else None
        return point(value if depth else None, axis_order, mends, depth - 1)
    if isinstance(value, list) and len(value) == 1 and isinstance(value[0], dict | list | str) and depth:
        mends.add("point_form")
        return point(value[0], axis_order, mends, depth - 1)
    if isinstance(value, list) and any(isinstance(each, Cut) for each in value):
        raise ActionError('the reply breaks off in "point"')
    if not isinstance(value, list) or len(value) != 2:
        raise ActionError('"point" is not a pair of numbers')
    first, second = (number(each, '"point"', PLAIN, mends) for each in value)
    return (first, second) if axis_order == "xy" else (second, first)


def box_centre(value: Any, axis_order: AxisOrder, mends: set[Mend]) -> tuple[float, float]:
    """Return the centre (x, y) of a box given by two corners, each in the declared order."""
    mends.add("box")
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if not isinstance(value, list) or len(value) != 4:
        raise ActionError("the box is not four numbers")
    a, b, c, d = (number(each, "the box", PLAIN, mends) for each in value)
    if not (0.0 <= a <= c <= POINT_SPAN and 0.0 <= b <= d <= POINT_SPAN):
        raise ActionError(f"the box ({a:g}, {b:g}, {c:g}, {d:g}) has no two corners within 0–1000")
    first, second = (a + c) / 2.0, (b + d) / 2.0
    return (first, second) if axis_order == "xy" else (second, first)


def _pair_in(text: str) -> list[str]:
    """Return the two numbers of a text, as text."""
    said = text.strip()[: _TEXT_MAX + 1]
    if tag := _POINT_TAG.fullmatch(said):
        said = tag.group(1).strip()
    if said and _BRACKETS.get(said[0]) == said[-1]:
        said = said[1:-1].strip()
    return _BETWEEN.split(said) if len(said) <= _TEXT_MAX else []


def _check_unit(unit: str, what: str, units: frozenset[str], mends: set[Mend]) -> None:
    if unit.lower() not in units:
        raise ActionError(f"{what} has the unit {unit[:20]!r}")
    mends.add("unit")
