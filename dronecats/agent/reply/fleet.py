"""Whose is which: the objects of a reply divided among a fleet's drones, each with its own fate.

Drones are counted from 1, as the prompt counts them. Objects that name no drone are meant in the order of the pictures.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply import strict
from dronecats.agent.reply.mends import TOLERATED, Mend, answer_of, around
from dronecats.agent.reply.shapes import action_of, tells
from dronecats.agent.reply.tolerant import Cut, Found, values

NAMED = ("drone", "drone_id", "drone_number", "drone_index")
_NAME = re.compile(r"(?:drone|uav)?[\s_#-]*(\d{1,3})", re.IGNORECASE)
_NESTED_MAX = 3  # arrays or objects around the array that is meant

Fate = tuple[Action | ActionError, set[Mend]]


@dataclass(slots=True)
class Division:
    """Who gets which object of a reply."""

    items: dict[int, Any]  # by drone, from 0
    mends: set[Mend] = field(default_factory=set)  # of the reply as a whole
    twice: frozenset[int] = frozenset()  # drones that several objects name


def read(reply: str, drones: int, axis_order: AxisOrder) -> list[Fate]:
    """Return for each drone its action, or why there is none, and what had to be mended."""
    try:
        answer = answer_of(reply)
        division = _divided(answer, drones)
    except ActionError as error:
        return [(error, set()) for _ in range(drones)]
    division.mends |= {"reasoning"} if answer != reply else set()
    return [_fate(division, drone, drones, axis_order) for drone in range(drones)]


def _fate(division: Division, drone: int, drones: int, axis_order: AxisOrder) -> Fate:
    mends = set(division.mends)
    if drone in division.twice:
        return ActionError(f"several objects name drone {drone + 1} of {drones}"), mends
    if drone not in division.items:
        cut = "the reply breaks off before the" if "truncated" in mends else "the reply has no"
        return ActionError(f"{cut} object for drone {drone + 1} of {drones}"), mends
    item, own = division.items[drone], set(mends)
    try:
        return action_from(item, axis_order), mends
    except ActionError:
        pass
    try:
        return action_of(item, axis_order, own), own
    except ActionError as error:
        return error, mends


def _divided(answer: str, drones: int) -> Division:
    """Return the division of an answer. Raises ActionError where nothing says whose an object is."""
    try:
        array = strict.first_array(answer)
        refused = ActionError(f"expected {drones} actions, got {len(array.value)}")
        if len(array.value) == drones:
            others = [each for each in strict.values(answer, "[") if each.begin != array.begin]
            spans = sorted((each.begin, each.end) for each in (array, *others))
            division = _of_items(array.value, drones)
            division.mends |= around(answer, spans) | ({"several"} if any(map(_arms, others)) else set())
            return division
    except ActionError as error:
        refused = error
    found = _found(answer)
    division = _of_found(found, drones)
    division.mends |= around(answer, [(each.begin, each.end) for each in found])
    for each in found:
        division.mends |= each.mends
    if division.mends <= TOLERATED.keys():  # nothing was mended, so what was refused stays refused
        raise refused
    return division


def _arms(placed: strict.JsonSpan) -> bool:
    return isinstance(placed.value, list) and any(isinstance(item, dict) for item in placed.value)


def _found(text: str) -> list[Found]:
    """Return the outermost values that hold objects for drones, in order; what breaks off hides what stands in it."""
    found: list[Found] = []
    for each in values(text, "[{"):
        if not each.inner and (_items(each.value) or (isinstance(each.value, dict) and each.value)):
            found.append(each)
    return found


def _of_found(found: list[Found], drones: int) -> Division:
    arrays = [each for each in found if isinstance(each.value, list)]
    if arrays:
        return _of_arrays(arrays, drones)
    objects = [each.value for each in found if tells(each.value)]
    if len(found) == 1 and not (objects and _name(objects[0]) is not None):
        return _of_object(found[0].value, drones)
    if not objects:
        raise ActionError("no JSON array of actions in the reply")
    if len(objects) == drones or all(_name(each) is not None for each in objects):
        division = _of_items(objects, drones)
        division.mends.add("lines")
        return division
    raise ActionError(f"{len(objects)} objects and no array: nothing says which of the {drones} drones they are for")


def _of_arrays(arrays: list[Found], drones: int) -> Division:
    """Return the division of the one array that is meant: the only one, or the only one with an object per drone."""
    fitting = [each for each in arrays if len(_items(each.value) or []) == drones]
    if len(arrays) > 1 and len(fitting) != 1:
        raise ActionError(f"{len(arrays)} arrays of objects in the reply: nothing says which is meant")
    meant = arrays[0] if len(arrays) == 1 else fitting[0]
    items = _items(meant.value) or []
    division = _of_items(items, drones)
    division.mends |= {"one_fits"} if len(arrays) > 1 else set()
    nested = items is not meant.value or any(isinstance(each, list) for each in items)
    division.mends |= {"nested_array"} if nested else set()
    return division


def _of_object(value: dict[str, Any], drones: int, depth: int = 0) -> Division:
    """Return the division of one object: drones as keys, or an array of their objects within it."""
    keyed = {key: match for key in value if (match := _NAME.fullmatch(key.strip()))}
    if keyed:
        numbers = {key: int(match.group(1)) for key, match in keyed.items()}
        places, zero_based = _places(list(numbers.values()), drones)
        division = Division({}, {"keyed"})
        division.mends |= {"zero_based"} if zero_based else set()
        _place(division, [(place, value[key]) for key, place in zip(numbers, places, strict=True)], drones)
        return division
    inner = [each for each in value.values() if _items(each) or isinstance(each, dict)]
    if len(inner) != 1 or depth == _NESTED_MAX or (tells(value) and "action" in value):
        raise ActionError(f"one object for {drones} drones: nothing says which of them it is for")
    items = _items(inner[0])
    division = _of_items(items, drones) if items else _of_object(inner[0], drones, depth + 1)
    division.mends.add("wrapped")
    return division


def _items(value: Any) -> list[Any] | None:
    """Return the array with an object per drone, without further arrays around it; None for what is none."""
    for _ in range(_NESTED_MAX):
        if not isinstance(value, list):
            return None
        if len(value) != 1 or not isinstance(value[0], list):
            break
        value = value[0]
    held = [each[0] if isinstance(each, list) and len(each) == 1 else each for each in value]
    return value if any(isinstance(each, dict) or (isinstance(each, str) and "{" in each) for each in held) else None


def _of_items(items: list[Any], drones: int) -> Division:
    """Return the division of objects in a row: by the drones that they name, or in the order of the pictures."""
    items = items[:-1] if items and isinstance(items[-1], Cut) else items
    names = [_name(item) for item in items]
    division = Division({})
    told = [name for name in names if name is not None]
    places, zero_based = _places(told, drones)
    ordered = iter(places)
    named = [None if name is None else next(ordered) for name in names]
    if all(place in (None, k) for k, place in enumerate(named)):
        division.items = dict(enumerate(items[:drones]))
        if len(items) != drones:
            division.mends.add("short" if len(items) < drones else "extra")
        return division
    division.mends.add("by_name")
    division.mends |= {"zero_based"} if zero_based else set()
    _place(division, [(place, item) for place, item in zip(named, items, strict=True)], drones)
    return division


def _place(division: Division, told: list[tuple[int | None, Any]], drones: int) -> None:
    """Give each drone the object that names it; those that name none, or one that is not there, are passed over."""
    counts: dict[int, int] = {}
    for place, item in told:
        if place is None or not 0 <= place < drones:
            division.mends.add("extra")
            continue
        counts[place] = counts.get(place, 0) + 1
        division.items[place] = item
    if len(counts) < drones:
        division.mends.add("short")
    division.twice = frozenset(place for place, count in counts.items() if count > 1)


def _places(names: list[int], drones: int) -> tuple[list[int], bool]:
    """Return the drones, from 0, of the numbers that name them, and whether they are counted from 0: a 0 says so."""
    zero_based = 0 in names and drones not in names
    return [name if zero_based else name - 1 for name in names], zero_based


def _name(item: Any) -> int | None:
    """Return the number by which an object names its drone, None where it names none."""
    if not isinstance(item, Mapping):
        return None
    for key in NAMED:
        said = item.get(key)
        if isinstance(said, str) and (match := _NAME.fullmatch(said.strip())):
            return int(match.group(1))
        if isinstance(said, int) and not isinstance(said, bool):
            return said
    said = item.get("id")  # a bare number there may be of anything
    match = _NAME.fullmatch(said.strip()) if isinstance(said, str) else None
    return int(match.group(1)) if match and not match.group().isdigit() else None
