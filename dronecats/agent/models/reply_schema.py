"""JSON Schemas of a pilot's and a commander's replies, for servers that enforce a schema."""

from collections.abc import Collection
from typing import Any, Literal

from dronecats.agent.action import SCHEMAS

ORDERS, CONFIRM = "orders", "confirm"  # keys of a commander's reply


def action_schema() -> dict[str, Any]:
    """Return the schema of one action: a choice (anyOf) of all actions, each with only its own fields."""
    return {"anyOf": [_object(action=_named(name), **fields) for name, fields in SCHEMAS.items()]}


def flat_action_schema() -> dict[str, Any]:
    """Return the schema of one action without a choice: it has the fields of all actions, null if not used.

    It allows more than `action_schema`, such as a go without a point, which the parser rejects.
    """
    fields = {
        name: {**own, "type": [own["type"], "null"]} for all_own in SCHEMAS.values() for name, own in all_own.items()
    }
    return _object(action=_named(*SCHEMAS), **fields)


def reply_schema(root: Literal["object", "array"], choice: bool = True) -> dict[str, Any]:
    """Return the schema of a pilot's reply: a single action, or an array with one action per drone.

    `choice`: whether the server accepts a choice of schemas at the root.
    """
    if root == "array":
        return {"type": "array", "items": action_schema()}
    return action_schema() if choice else flat_action_schema()


def orders_schema(drones: int) -> dict[str, Any]:
    """Return the schema of a commander's orders to a fleet of `drones` (`agent.commanding.command_prompt`)."""
    drone = {"type": "integer", "minimum": 1, "maximum": drones}
    order = _object(drone=drone, goal={"type": "string"})
    return _object(**{ORDERS: {"type": "array", "items": order}, CONFIRM: {"type": "array", "items": drone}})


def known_part(schema: Any, unknown: Collection[str]) -> Any:
    """Return a schema without the keywords in `unknown`, which a server does not support.

    The server then does not check the conditions of these keywords. The parser of replies does.
    """
    if isinstance(schema, dict):
        return {key: known_part(value, unknown) for key, value in schema.items() if key not in unknown}
    return [known_part(value, unknown) for value in schema] if isinstance(schema, list) else schema


def response_format(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the field `response_format` of an OpenAI chat request."""
    return {"type": "json_schema", "json_schema": {"name": "reply", "strict": True, "schema": schema}}


def _named(*names: str) -> dict[str, Any]:
    return {"type": "string", "enum": list(names)}


def _object(**fields: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": fields, "required": list(fields), "additionalProperties": False}
