"""Lenient reading of an object as an action: other field names, tool calls, wrappers, boxes, synonyms.

Only objects with one possible meaning are read. Each correction is recorded as a mend (`mends.py`). A synonym counts
only with the fields of its action. `hover`, `stop`, `land` and `done` are not synonyms: they may mean a think or a
declaration, and the benchmark measures this choice.
"""

import re
from typing import Any
from unicodedata import normalize

from dronecats.agent.action import SCHEMAS, Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply.mends import Mend
from dronecats.agent.reply.tolerant import CUT, Cut, Quantity, SearchBudget, number_in, read_values
from foundation.protocol import ACTIONS, FINISHED, GO, POINT_SPAN, ROTATE, THINK

METRES = frozenset({"m", "meter", "meters", "metre", "metres"})
DEGREES = frozenset({"°", "º", "deg", "degs", "degree", "degrees"})
PLAIN: frozenset[str] = frozenset()  # a point's numbers have no unit
UNITS = {"m": METRES, "deg": DEGREES}  # allowed units, by the last word of a field's name
BOXES = ("bbox_2d", "box_2d", "bbox", "box")
_NUMBER = re.compile(r"([+\-\u2212\uff0b\uff0d]?(?:\d+[.\uff0e]?\d*|[.\uff0e]\d+))\s*([^\W\d_]+|°|º)?")
_TEXT_MAX = 80  # longest text of a number or a point, characters
_POINT_TAG = re.compile(r"<point>(.*?)</point>", re.DOTALL)
_BETWEEN = re.compile(r"\s*[,，;]\s*|\s+")
_BRACKETS = {"[": "]", "(": ")"}


def number(value: Any, name: str, units: frozenset[str], mends: set[Mend]) -> float:
    """Return the number in `value`, which may be text or have one of `units`; add the mends to `mends`."""
    if isinstance(value, Cut):
        raise ActionError(f"the reply breaks off in {name}")
    if isinstance(value, Quantity):
        _check_unit(value.unit, name, units, mends)
        return value.number
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value.strip()) if len(value) <= _TEXT_MAX else None
        if match is None:
            raise ActionError(f"{name} is not a number")
        mends.add("number_text")
        if match.group(2):
            _check_unit(match.group(2), name, units, mends)
        return number_in(match.group(1))
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ActionError(f"{name} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise ActionError(f"{name} is too large") from None


def point(value: Any, axis_order: AxisOrder, mends: set[Mend], depth: int = 3) -> tuple[float, float]:
    """Return (x, y), 0–1000. A pair is in `axis_order`, unless it has the keys x and y. `depth`: levels to unpack."""
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
    if isinstance(value, list) and any(isinstance(item, Cut) for item in value):
        raise ActionError('the reply breaks off in "point"')
    if not isinstance(value, list) or len(value) != 2:
        raise ActionError('"point" is not a pair of numbers')
    first, second = (number(item, '"point"', PLAIN, mends) for item in value)
    return (first, second) if axis_order == "xy" else (second, first)


def box_centre(value: Any, axis_order: AxisOrder, mends: set[Mend]) -> tuple[float, float]:
    """Return the centre (x, y) of a box given by two corners, each in `axis_order`."""
    mends.add("box")
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if not isinstance(value, list) or len(value) != 4:
        raise ActionError("the box is not four numbers")
    a, b, c, d = (number(item, "the box", PLAIN, mends) for item in value)
    if not (0.0 <= a <= c <= POINT_SPAN and 0.0 <= b <= d <= POINT_SPAN):
        raise ActionError(f"the box ({a:g}, {b:g}, {c:g}, {d:g}) has no two corners within 0–1000")
    first, second = (a + c) / 2.0, (b + d) / 2.0
    return (first, second) if axis_order == "xy" else (second, first)


def _pair_in(text: str) -> list[str]:
    """Return the numbers of a point that is written as text, each as text."""
    pair = text.strip()[: _TEXT_MAX + 1]
    if tag := _POINT_TAG.fullmatch(pair):
        pair = tag.group(1).strip()
    if pair and _BRACKETS.get(pair[0]) == pair[-1]:
        pair = pair[1:-1].strip()
    return _BETWEEN.split(pair) if len(pair) <= _TEXT_MAX else []


def _check_unit(unit: str, name: str, units: frozenset[str], mends: set[Mend]) -> None:
    if unit.lower() not in units:
        raise ActionError(f"{name} has the unit {unit[:20]!r}")
    mends.add("unit")


SYNONYMS = {
    **dict.fromkeys(("goto", "go_to", "go_towards", "fly", "fly_to", "fly_towards", "move", "move_to"), GO),
    **dict.fromkeys(("turn", "yaw", "rotation"), ROTATE),
    "thinking": THINK,
    "finish": FINISHED,
}
SIDES = {f"{verb}_{side}": sign for verb in ("rotate", "turn", "yaw") for side, sign in (("right", 1), ("left", -1))}
DIRECTIONS = {"right": 1, "clockwise": 1, "cw": 1, "left": -1, "counterclockwise": -1, "ccw": -1}
ACTION_NAME_KEYS = (
    "action",
    "action_type",
    "action_name",
    "type",
    "command",
    "name",
    "function",
    "tool",
)  # keys under which an object may have the name of its action
TOOL_NAME_KEYS = ("name", "function", "tool")  # keys of ACTION_NAME_KEYS that occur in tool calls
PARAMETERS = ("arguments", "parameters", "params", "args", "input", "action_input", "tool_input")
TOOL_CALL_KEYS = ("function", "function_call", "tool_call", "tool_calls")
POINTS = ("point", "point_2d", "point2d", "points", "coordinate", "coordinates")
DEPTHS = ("depth_m", "depth", "depth_meters", "depth_metres")
ANGLES = ("angle_deg", "angle", "angle_degrees", "degrees", "deg")
# name of an action; side in the name that the reply used (1: right, -1: left, 0: no side); the action's fields
Unfolded = tuple[str, int, dict[str, Any]]
_BETWEEN_WORDS = re.compile(r"[\s\-_]+")
_DEPTH = 6  # maximum nesting of objects
_HELD_MAX = 40  # most members of an object that may wrap an action
_NAME_MAX = 40  # longest key or action name, characters


def is_action(value: Any, budget: SearchBudget, inner: bool = False) -> bool:
    """Return whether an object is meant as an action, valid or not.

    `inner`: the object begins inside a broken or cut-off value. It then needs the key "action".
    `budget`: for the searches in strings. All objects of a reply share it.
    """
    if not isinstance(value, dict):
        return False
    return _has_action(value) or (_unfold(value, set(), 0, budget) is not None and not inner)


def _has_action(value: dict[str, Any]) -> bool:
    return any(_plain(key) == "action" for key in value)


def action_of(value: Any, axis_order: AxisOrder, mends: set[Mend], budget: SearchBudget) -> Action:
    """Return the action of one object; add its mends to `mends`. `budget`: as for `is_action`. Raises ActionError."""
    if isinstance(value, Cut):
        raise ActionError("the reply breaks off before the action")
    if isinstance(value, str):
        value = _within(value, mends, budget)
    if isinstance(value, list) and len(value) == 1:
        mends.add("nested_array")
        value = value[0]
    if not isinstance(value, dict):
        raise ActionError("the action is not a JSON object")
    unfolded = _unfold(value, mends, 0, budget)
    if unfolded is None:
        raise ActionError(_why_none(value))
    kind, sign, fields = unfolded
    if kind == GO:
        x, y = _point(fields, axis_order, mends)
        depth = number(_field(fields, DEPTHS, mends), '"depth_m"', METRES, mends)
        return action_from({"action": GO, "point": [x, y], "depth_m": depth})
    if kind == ROTATE:
        angle = number(_field(fields, ANGLES, mends), '"angle_deg"', DEGREES, mends)
        return action_from({"action": ROTATE, "angle_deg": _signed(angle, sign, fields)})
    numbers = {
        name: number(_field(fields, (name,), mends), f'"{name}"', UNITS.get(name.rpartition("_")[2], PLAIN), mends)
        for name in SCHEMAS[kind]
    }
    return action_from({"action": kind, **numbers})


def _unfold(value: dict[str, Any], mends: set[Mend], depth: int, budget: SearchBudget) -> Unfolded | None:
    """Return the action of an object; None when it has none, or several."""
    if depth > _DEPTH:
        return None
    for key in ACTION_NAME_KEYS:
        spelt = next((name for name in value if _plain(name) == key), None)
        named = None if spelt is None else _named(value[spelt])
        if spelt is None or named is None:
            if spelt is not None and key == "action" and isinstance(value[spelt], str | Cut):
                return None
            continue
        if value[spelt] not in ACTIONS:
            mends.add("name")
        fields = _fields(value, key, mends, budget)
        if spelt != "action" and "tool_call" not in mends:
            mends.add("field")
        return None if fields is None else (*named, fields)
    if isinstance(value.get("action"), dict):
        mends.add("nested")
        return _unfold(value["action"], mends, depth + 1, budget)
    call = _tool_call(value)
    called = _called(call, mends, depth, budget)
    if called or _has_action(value):
        return called
    return _keyed(value, mends) or _implied(value, mends) or _wrapped(value, mends, depth, budget, call)


def _named(name: Any) -> tuple[str, int] | None:
    """Return the action of a name, and the side in the name as in `Unfolded`; None for an unknown name."""
    plain = _plain(name)
    if plain in ACTIONS:
        return plain, 0
    if plain in SIDES:
        return ROTATE, SIDES[plain]
    return (SYNONYMS[plain], 0) if plain in SYNONYMS else None


def _fields(value: dict[str, Any], key: str, mends: set[Mend], budget: SearchBudget) -> dict[str, Any] | None:
    """Return an action's fields: the members of its object and of its parameters; None if ambiguous."""
    inner = [name for name in PARAMETERS if name in value]
    if len(inner) != 1:
        return value if not inner else None
    parameters = value[inner[0]]
    if isinstance(parameters, str):
        parameters = _within(parameters, mends, budget)
    mends.add("tool_call" if key in TOOL_NAME_KEYS else "nested")
    if parameters is None or parameters == []:
        parameters = {}
    if isinstance(parameters, Cut):
        return {name: CUT for own in SCHEMAS.values() for name in own}
    if not isinstance(parameters, dict) or parameters.keys() & value.keys() & {*POINTS, *DEPTHS, *ANGLES, *BOXES}:
        return None
    return {**value, **parameters}


def _tool_call(value: dict[str, Any]) -> dict[str, Any] | None:
    """Return the tool call in an object; None if it has none, or several."""
    inner = [value[key] for key in TOOL_CALL_KEYS if isinstance(value.get(key), dict | list)]
    if len(inner) != 1:
        return None
    call = inner[0][0] if isinstance(inner[0], list) and len(inner[0]) == 1 else inner[0]
    return call if isinstance(call, dict) else None


def _called(call: dict[str, Any] | None, mends: set[Mend], depth: int, budget: SearchBudget) -> Unfolded | None:
    """Return the action inside a tool call."""
    own: set[Mend] = {"tool_call"}
    unfolded = None if call is None else _unfold(call, own, depth + 1, budget)
    mends |= own if unfolded else set()
    return unfolded


def _keyed(value: dict[str, Any], mends: set[Mend]) -> Unfolded | None:
    """Return the action of an object whose only key is the action's name, for example {"go": {…}}."""
    if len(value) != 1:
        return None
    ((key, inner),) = value.items()
    named = _named(key)
    if named is None:
        return None
    kind = named[0]
    if not SCHEMAS[kind] and (inner is True or inner is None or inner == {}):
        inner = {}
    elif kind == ROTATE and isinstance(inner, int | float | str) and not isinstance(inner, bool):
        inner = {ANGLES[0]: inner}
    if not isinstance(inner, dict):
        return None
    mends.add("action_key")
    if key not in ACTIONS:
        mends.add("name")
    return (*named, inner)


def _implied(value: dict[str, Any], mends: set[Mend]) -> Unfolded | None:
    """Return the action of an object that has fields but no name; None unless exactly one action fits."""
    # only `depth_m` counts, because results of object detection may have a "depth"
    aims = DEPTHS[0] in value and any(key in value for key in POINTS)
    turns = ANGLES[0] in value
    if aims == turns:
        return None
    mends.add("implied")
    return (GO if aims else ROTATE), 0, value


def _wrapped(
    value: dict[str, Any], mends: set[Mend], depth: int, budget: SearchBudget, call: dict[str, Any] | None
) -> Unfolded | None:
    """Return the only action within an object that is not an action itself. `call`: its tool call, without action."""
    held = [item for member in value.values() for item in (member if isinstance(member, list) else [member])]
    if len(held) > _HELD_MAX:
        return None
    meant: list[tuple[Unfolded | None, set[Mend]]] = []
    for item in held:
        own: set[Mend] = {"wrapped"}
        inner = _within(item, own, budget) if isinstance(item, str) and "{" in item else item
        # the call is not unfolded again, because the work would double with each level
        unfolded = _unfold(inner, own, depth + 1, budget) if isinstance(inner, dict) and inner is not call else None
        names = isinstance(inner, dict) and _has_action(inner)
        if unfolded or names or isinstance(inner, Cut):  # a cut member may have held another action
            meant.append((unfolded, own))
    if len(meant) != 1 or meant[0][0] is None:
        return None
    mends |= meant[0][1]
    return meant[0][0]


def _within(text: str, mends: set[Mend], budget: SearchBudget) -> Any:
    """Return the only object that a string holds as JSON; the string itself if it holds none, or several."""
    objects = read_values(text, "{", budget)
    if len(objects) != 1:
        return text
    mends |= objects[0].mends | {"escaped"}
    return objects[0].value


def _point(fields: dict[str, Any], axis_order: AxisOrder, mends: set[Mend]) -> tuple[float, float]:
    points = [key for key in POINTS if key in fields]
    boxes = [key for key in BOXES if key in fields]
    if "x" in fields and "y" in fields and not points and not boxes:
        return point({"x": fields["x"], "y": fields["y"]}, axis_order, mends)
    if not points and len(boxes) == 1:
        return box_centre(fields[boxes[0]], axis_order, mends)
    return point(_field(fields, POINTS, mends), axis_order, mends)


def _field(fields: dict[str, Any], names: tuple[str, ...], mends: set[Mend]) -> Any:
    """Return the member named `names[0]`, else the only member with another of `names`. Raises ActionError."""
    if names[0] in fields:
        return fields[names[0]]
    keys = [key for key in fields if _plain(key) in names]
    if not keys:
        raise ActionError(
            f'"{names[0]}" is missing' if "" not in fields else f'the reply breaks off before "{names[0]}"'
        )
    if len(keys) > 1:
        raise ActionError(f"{' and '.join(keys)[:80]} contradict each other or say the same: which is meant?")
    mends.add("field")
    return fields[keys[0]]


def _signed(angle: float, sign: int, fields: dict[str, Any]) -> float:
    """Return an angle with the sign of the side in the action's name. Raises ActionError for a contradiction."""
    side = next((fields[key] for key in ("direction", "dir") if key in fields), None)
    direction = DIRECTIONS.get(_plain(side), 0)
    if (sign and angle < 0) or direction * sign < 0 or (direction and direction * (angle * (sign or 1)) < 0):
        raise ActionError("the side that is named and the sign of the angle contradict each other")
    return angle * (sign or 1)


def _plain(name: Any) -> str:
    """Return a name in lower case, with one underscore between its words; "" for any other value."""
    if not isinstance(name, str) or len(name) > _NAME_MAX:
        return ""
    return _BETWEEN_WORDS.sub("_", normalize("NFKC", name).strip(" \t\r\n.!_-").lower())


def _why_none(value: dict[str, Any]) -> str:
    named = next((value[key] for key in value if _plain(key) == "action"), None)
    if isinstance(named, Cut):
        return 'the reply breaks off in "action"'
    if isinstance(named, str):
        return f"unknown action {named[:40]!r}"
    return 'the object has no "action"'
