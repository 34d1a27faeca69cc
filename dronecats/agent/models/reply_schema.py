"""The JSON Schema of a reply, for servers that hold a model to one. The rules are those of `agent.action`."""

from collections.abc import Collection
from typing import Any, Literal, cast

_ACTIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    (
        "go",
        {
            "point": {
                "type": "array",
                "items": {"type": "number", "minimum": 0, "maximum": 1000},
                "minItems": 2,
                "maxItems": 2,
            },
            "depth_m": {"type": "number", "exclusiveMinimum": 0},
        },
    ),
    ("rotate", {"angle_deg": {"type": "number"}}),
    ("think", {}),
    ("finished", {}),
)


def action_schema() -> dict[str, Any]:
    """Return the schema of one action: one of the four, with its own fields and no other."""
    return {"anyOf": [_one(name, fields) for name, fields in _ACTIONS]}


def reply_schema(root: Literal["object", "array"], unknown: Collection[str] = ()) -> dict[str, Any]:
    """Return the schema of a reply: a single action, or an array of one per drone.

    Without the keywords that a server does not know, which leaves it wider: the parser holds a reply to all of them.
    """
    schema = action_schema() if root == "object" else {"type": "array", "items": action_schema()}
    return cast(dict[str, Any], _without(schema, unknown))


def response_format(root: Literal["object", "array"]) -> dict[str, Any]:
    """Return `response_format` of an OpenAI chat request."""
    return {"type": "json_schema", "json_schema": {"name": "reply", "strict": True, "schema": reply_schema(root)}}


def _without(schema: Any, unknown: Collection[str]) -> Any:
    if isinstance(schema, dict):
        return {key: _without(value, unknown) for key, value in schema.items() if key not in unknown}
    return [_without(value, unknown) for value in schema] if isinstance(schema, list) else schema


def _one(name: str, fields: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {"action": {"type": "string", "enum": [name]}, **fields},
        "required": ["action", *fields],
        "additionalProperties": False,
    }
