"""The four actions of a pilot, their JSON Schemas and their parser. See "Action Space" in the paper."""

import math
from dataclasses import dataclass
from typing import Any, Literal

from foundation import protocol
from foundation.protocol import FINISHED, GO, POINT_SPAN, ROTATE, THINK

AxisOrder = Literal["xy", "yx"]  # the order in which a model writes the coordinates of `point`
POINT_FORMAT: dict[AxisOrder, str] = {"xy": "[x, y]", "yx": "[y, x]"}


@dataclass(frozen=True, slots=True)
class Go:
    """Fly towards an image point."""

    x: float  # 0 … 1000, left to right
    y: float  # 0 … 1000, top to bottom
    depth_m: float  # m along the optical axis, estimated by the pilot

    def as_json(self) -> dict[str, Any]:
        """Return the action in the JSON form of a reply, but the point is always in [x, y] order."""
        return {"action": GO, "point": [self.x, self.y], "depth_m": self.depth_m}

    @property
    def line(self) -> str:
        """The action on one line, with the point on the scale 0–1000."""
        return f"GO point=[{self.x:.0f}, {self.y:.0f}] depth={self.depth_m:.4g}m"


@dataclass(frozen=True, slots=True)
class Rotate:
    """Yaw in place."""

    angle_deg: float  # + right; the prompt asks for −90 … 90, the parser accepts ±MAX_ROTATION_DEG

    def as_json(self) -> dict[str, Any]:
        return {"action": ROTATE, "angle_deg": self.angle_deg}

    @property
    def line(self) -> str:
        """The action on one line."""
        return f"ROTATE angle={self.angle_deg:.4g}deg"


@dataclass(frozen=True, slots=True)
class Think:
    """Hold position; the model reasons at length in its next call."""

    def as_json(self) -> dict[str, Any]:
        return {"action": THINK}

    @property
    def line(self) -> str:
        """The action on one line."""
        return "THINK"


@dataclass(frozen=True, slots=True)
class Finished:
    """Declare arrival, and hold. This does not end the episode."""

    def as_json(self) -> dict[str, Any]:
        return {"action": FINISHED}

    @property
    def line(self) -> str:
        """The action on one line."""
        return "FINISHED"


Action = Go | Rotate | Think | Finished
SCHEMAS: dict[str, dict[str, Any]] = {  # JSON Schemas of the fields of each action, except the field "action"
    GO: {
        "point": {
            "type": "array",
            "items": {"type": "number", "minimum": 0, "maximum": 1000},
            "minItems": 2,
            "maxItems": 2,
        },
        "depth_m": {"type": "number", "exclusiveMinimum": 0},
    },
    ROTATE: {"angle_deg": {"type": "number"}},
    THINK: {},
    FINISHED: {},
}


class ActionError(ValueError):
    """A reply has no valid action or orders; the message says why. The model has failed, not the infrastructure."""


MAX_ROTATION_DEG = 3600.0  # the parser accepts up to ten turns in either direction
MAX_DEPTH_M = 100_000.0


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
        case name:
            raise ActionError(f"unknown action {str(name)[:40]!r}")


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


def _finite(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ActionError(f"{name} is not a number")
    try:
        number = float(value)
    except OverflowError:
        raise ActionError(f"{name} is too large") from None
    if not math.isfinite(number):
        raise ActionError(f"{name} is not finite")
    return number
