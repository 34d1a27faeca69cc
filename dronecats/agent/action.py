"""The four actions a pilot may take, and the parser that reads them out of a reply. Paper, "Action Space"."""

import json
import math
from dataclasses import dataclass
from typing import Any, Literal

from foundation import protocol
from foundation.protocol import FINISHED, GO, POINT_SPAN, ROTATE, THINK

AxisOrder = Literal["xy", "yx"]  # the order of `point` that a model was trained with


@dataclass(frozen=True, slots=True)
class Go:
    """Fly towards an image point."""

    x: float  # 0 … 1000, left to right
    y: float  # 0 … 1000, top to bottom
    depth_m: float  # m along the optical axis, the pilot's own estimate

    def as_json(self) -> dict[str, Any]:
        """Return the action as the reply declares it, point always in [x, y] order."""
        return {"action": GO, "point": [self.x, self.y], "depth_m": self.depth_m}


@dataclass(frozen=True, slots=True)
class Rotate:
    """Yaw in place."""

    angle_deg: float  # + right; ±90 is asked for in the prompt and not enforced

    def as_json(self) -> dict[str, Any]:
        return {"action": ROTATE, "angle_deg": self.angle_deg}


@dataclass(frozen=True, slots=True)
class Think:
    """Hold, and reason at length in the next call."""

    def as_json(self) -> dict[str, Any]:
        return {"action": THINK}


@dataclass(frozen=True, slots=True)
class Finished:
    """Declare arrival, and hold. Ends nothing."""

    def as_json(self) -> dict[str, Any]:
        return {"action": FINISHED}


Action = Go | Rotate | Think | Finished


class ActionError(ValueError):
    """A reply holds no valid action; the text says why. A failure of the pilot, never of the infrastructure."""


MAX_REPLY_CHARS = 200_000  # 8192 tokens are far below this
MAX_TRIES = 500  # places in a reply at which JSON may begin
MAX_VAIN_CHARS = 5 * MAX_REPLY_CHARS  # read in vain after such places: nothing that is meant to be read needs more
MAX_ROTATION_DEG = 3600.0  # ten turns: beyond it the number is noise, not an intention
MAX_DEPTH_M = 100_000.0


def parse(reply: str, axis_order: AxisOrder = "xy") -> Action:
    """Return the action in `reply`.

    The prompt asks for one JSON object and nothing else. Prose or a code fence around it is tolerated: the last object
    that has an "action" counts, since what comes before it leads up to it. Raises ActionError with the reason when
    there is none or it is malformed.
    """
    return action_from(_last_object(reply), axis_order)


def parse_fleet(reply: str, drones: int, axis_order: AxisOrder = "xy") -> list[Action | ActionError]:
    """Return one action or error per drone from a reply that holds a JSON array of `drones` objects.

    With one drone this is `parse`. A reply that is no array of the right length is an error for every drone.
    """
    if drones == 1:
        try:
            return [parse(reply, axis_order)]
        except ActionError as error:
            return [error]
    items = _first_array(reply)
    if isinstance(items, ActionError):
        return [items] * drones
    if len(items) != drones:
        return [ActionError(f"expected {drones} actions, got {len(items)}")] * drones
    actions: list[Action | ActionError] = []
    for item in items:
        try:
            actions.append(action_from(item, axis_order))
        except ActionError as error:
            actions.append(error)
    return actions


def action_from(value: Any, axis_order: AxisOrder = "xy") -> Action:
    """Return the action of one parsed JSON object. Raises ActionError."""
    if not isinstance(value, dict):
        raise ActionError("the action is not a JSON object")
    match value.get("action"):
        case protocol.GO:
            return _go(value, axis_order)
        case protocol.ROTATE:
            return Rotate(_number(value, "angle_deg", -MAX_ROTATION_DEG, MAX_ROTATION_DEG))
        case protocol.THINK:
            return Think()
        case protocol.FINISHED:
            return Finished()
        case None:
            raise ActionError('the object has no "action"')
        case other:
            raise ActionError(f"unknown action {str(other)[:40]!r}")


def _go(value: dict[str, Any], axis_order: AxisOrder) -> Go:
    point = value.get("point")
    if not isinstance(point, list) or len(point) != 2:
        raise ActionError('"point" is not a pair of numbers')
    first, second = (_finite(v, '"point"') for v in point)
    x, y = (first, second) if axis_order == "xy" else (second, first)
    if not (0.0 <= x <= POINT_SPAN and 0.0 <= y <= POINT_SPAN):
        raise ActionError(f'"point" ({x:g}, {y:g}) is outside 0–1000')
    return Go(x, y, _number(value, "depth_m", 0.0, MAX_DEPTH_M))


def _number(value: dict[str, Any], key: str, low: float, high: float) -> float:
    if key not in value:
        raise ActionError(f'"{key}" is missing')
    number = _finite(value[key], f'"{key}"')
    if not low <= number <= high:
        raise ActionError(f'"{key}" {number:g} is outside {low:g} … {high:g}')
    return number


def _finite(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ActionError(f"{what} is not a number")
    try:
        number = float(value)
    except OverflowError:
        raise ActionError(f"{what} is too large") from None
    if not math.isfinite(number):
        raise ActionError(f"{what} is not finite")
    return number


def _last_object(reply: str) -> Any:
    values = _values(reply, "{")
    if not values:
        raise ActionError("no JSON object in the reply")
    return next((v for v in reversed(values) if isinstance(v, dict) and "action" in v), values[-1])


def _first_array(reply: str) -> list[Any] | ActionError:
    for value in _values(reply, "["):
        if isinstance(value, list) and any(isinstance(item, dict) for item in value):
            return value
    return ActionError("no JSON array of actions in the reply")


def _values(reply: str, opening: str) -> list[Any]:
    """Return the outermost JSON values of the text that start with `opening`, in order.

    Where a value breaks off the next one may begin inside it, which read again and again would take the square of the
    reply's length: so what is read in vain is counted, and the search ends when it is too much.
    """
    decoder = json.JSONDecoder()
    text, values, at, tries, vain = reply[:MAX_REPLY_CHARS], [], 0, 0, 0
    while vain < MAX_VAIN_CHARS and (at := text.find(opening, at)) >= 0 and (tries := tries + 1) <= MAX_TRIES:
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:  # only a JSONDecodeError says how far it came
            vain += (error.pos if isinstance(error, json.JSONDecodeError) else len(text)) - at
            at += 1
            continue
        values.append(value)
        at = end
    return values
