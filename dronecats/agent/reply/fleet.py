"""Lenient parser of a fleet's reply. It assigns the objects of the reply to the drones.

Replies number the drones from 1, as the prompt does. Objects that name no drone belong to the drones in the order of
the pictures.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply import strict
from dronecats.agent.reply.mends import TOLERATED, Mend, around
from dronecats.agent.reply.shapes import action_of, is_action
from dronecats.agent.reply.strict import answer_of
from dronecats.agent.reply.tolerant import Cut, ReadValue, SearchBudget, read_values

NAMED = ("drone", "drone_id", "drone_number", "drone_index")
_NAME = re.compile(r"(?:drone|uav)?[\s_#-]*(\d{1,3})", re.IGNORECASE)
_NESTED_MAX = 3  # largest number of arrays or objects around the array of actions

DroneResult = tuple[Action | ActionError, set[Mend]]


@dataclass(slots=True)
class Assignment:
    """The assignment of the objects of a reply to the drones."""

    items: dict[int, Any]  # the object of each drone; drones are numbered from 0
    mends: set[Mend] = field(default_factory=set)  # corrections that concern the whole reply
    duplicated: frozenset[int] = frozenset()  # drones that several objects name


def read(reply: str, drones: int, axis_order: AxisOrder) -> list[DroneResult]:
    """Return (action or error, corrections) of a reply for each drone."""
    budget = SearchBudget()
    try:
        answer = answer_of(reply)
        division = _assigned(answer, drones, budget)
    except ActionError as error:
        return [(error, set()) for _ in range(drones)]
    division.mends |= {"reasoning"} if answer != reply else set()
    return [_drone_result(division, drone, drones, axis_order, budget) for drone in range(drones)]


def _drone_result(
    division: Assignment, drone: int, drones: int, axis_order: AxisOrder, budget: SearchBudget
) -> DroneResult:
    mends = set(division.mends)
    if drone in division.duplicated:
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
        return action_of(item, axis_order, own, budget), own
    except ActionError as error:
        return error, mends


def _assigned(answer: str, drones: int, budget: SearchBudget) -> Assignment:
    """Return the assignment of an answer's objects to the drones. Raises ActionError unless exactly one is possible."""
    try:
        array = strict.first_array(answer)
        strict_error = ActionError(f"expected {drones} actions, got {len(array.value)}")
        if len(array.value) == drones:
            other_arrays = [span for span in strict.json_spans(answer, "[") if span.begin != array.begin]
            spans = sorted((array, *other_arrays), key=lambda span: span.begin)
            division = _assign_list(array.value, drones)
            division.mends |= around(answer, spans) | (
                {"several"} if any(map(strict.has_objects, other_arrays)) else set()
            )
            return division
    except ActionError as error:
        strict_error = error
    drone_values = _drone_values(answer)
    division = _of_values(drone_values, drones, budget)
    division.mends |= around(answer, drone_values)
    for span in drone_values:
        division.mends |= span.mends
    if division.mends <= TOLERATED.keys():  # nothing was mended, so the strict rejection holds
        raise strict_error
    return division


def _drone_values(text: str) -> list[ReadValue]:
    """Return the outermost values that hold objects for drones, in order."""
    return [
        value
        for value in read_values(text, "[{")
        if not value.inner and (_items(value.value) or (isinstance(value.value, dict) and value.value))
    ]


def _of_values(drone_values: list[ReadValue], drones: int, budget: SearchBudget) -> Assignment:
    arrays = [value for value in drone_values if isinstance(value.value, list)]
    if arrays:
        return _of_arrays(arrays, drones)
    objects = [value.value for value in drone_values if is_action(value.value, budget)]
    if len(drone_values) == 1 and not (objects and _name(objects[0]) is not None):
        return _of_object(drone_values[0].value, drones, budget)
    if not objects:
        raise ActionError("no JSON array of actions in the reply")
    if len(objects) == drones or all(_name(value) is not None for value in objects):
        division = _assign_list(objects, drones)
        division.mends.add("lines")
        return division
    raise ActionError(f"{len(objects)} objects and no array: nothing says which of the {drones} drones they are for")


def _of_arrays(arrays: list[ReadValue], drones: int) -> Assignment:
    """Return the assignment of the only array, or of the only array with as many objects as drones.

    Raises ActionError for several arrays, unless exactly one of them has this number of objects.
    """
    fitting = [array for array in arrays if len(_items(array.value) or []) == drones]
    if len(arrays) > 1 and len(fitting) != 1:
        raise ActionError(f"{len(arrays)} arrays of objects in the reply: nothing says which is meant")
    meant = arrays[0] if len(arrays) == 1 else fitting[0]
    items = _items(meant.value) or []
    division = _assign_list(items, drones)
    division.mends |= {"one_fits"} if len(arrays) > 1 else set()
    nested = items is not meant.value or any(isinstance(array, list) for array in items)
    division.mends |= {"nested_array"} if nested else set()
    return division


def _of_object(value: dict[str, Any], drones: int, budget: SearchBudget, depth: int = 0) -> Assignment:
    """Return the assignment of one object: its keys name the drones, or it contains the array of the drones' objects.

    Raises ActionError if it is neither.
    """
    keyed = {key: match for key in value if (match := _NAME.fullmatch(key.strip()))}
    if keyed:
        division = Assignment({}, {"keyed"})
        _place(division, [(int(match.group(1)), value[key]) for key, match in keyed.items()], drones)
        return division
    inner = [member for member in value.values() if _items(member) or isinstance(member, dict)]
    if len(inner) != 1 or depth == _NESTED_MAX or (is_action(value, budget) and "action" in value):
        raise ActionError(f"one object for {drones} drones: nothing says which of them it is for")
    items = _items(inner[0])
    division = _assign_list(items, drones) if items else _of_object(inner[0], drones, budget, depth + 1)
    division.mends.add("wrapped")
    return division


def _items(value: Any) -> list[Any] | None:
    """Return the array of the drones' objects, taken out of extra arrays; None if `value` is no such array."""
    for _ in range(_NESTED_MAX):
        if not isinstance(value, list):
            return None
        if len(value) != 1 or not isinstance(value[0], list):
            break
        value = value[0]
    held = [item[0] if isinstance(item, list) and len(item) == 1 else item for item in value]
    return value if any(isinstance(item, dict) or (isinstance(item, str) and "{" in item) for item in held) else None


def _assign_list(items: list[Any], drones: int) -> Assignment:
    """Return the assignment of a list of objects: by the drones that they name, or in the order of the pictures."""
    items = items[:-1] if items and isinstance(items[-1], Cut) else items
    names = [_name(item) for item in items]
    division = Assignment({})
    if all(name in (None, k) for k, name in enumerate(names, _first_number(names, drones))):
        division.items = dict(enumerate(items[:drones]))
        if len(items) != drones:
            division.mends.add("short" if len(items) < drones else "extra")
        return division
    division.mends.add("by_name")
    _place(division, list(zip(names, items, strict=True)), drones)
    return division


def _place(division: Assignment, numbered: list[tuple[int | None, Any]], drones: int) -> None:
    """Give each drone the object that names it. Objects without a drone, or with an unknown one, are skipped."""
    first = _first_number([number for number, _ in numbered], drones)
    division.mends |= set() if first else {"zero_based"}
    counts: Counter[int] = Counter()
    for number, item in numbered:
        if number is None or not first <= number < first + drones:
            division.mends.add("extra")
            continue
        counts[number - first] += 1
        division.items[number - first] = item
    if len(counts) < drones:
        division.mends.add("short")
    division.duplicated = frozenset(place for place, count in counts.items() if count > 1)


def _first_number(names: Sequence[int | None], drones: int) -> int:
    """Return the number of the first drone in a reply: 0 if 0 is among the names and `drones` is not, else 1."""
    return 0 if 0 in names and drones not in names else 1


def _name(item: Any) -> int | None:
    """Return the number by which an object names its drone; None if there is none."""
    if not isinstance(item, Mapping):
        return None
    for key in NAMED:
        name = item.get(key)
        if isinstance(name, str) and (match := _NAME.fullmatch(name.strip())):
            return int(match.group(1))
        if isinstance(name, int) and not isinstance(name, bool):
            return name
    name = item.get("id")  # a bare number as `id` is ignored: it may number other things
    match = _NAME.fullmatch(name.strip()) if isinstance(name, str) else None
    return int(match.group(1)) if match and not match.group().isdigit() else None
