"""The JSON Schema of a reply, for servers that hold a model to one. The rules are those of `agent.action`."""

from typing import Any, Literal

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


def response_format(root: Literal["object", "array"]) -> dict[str, Any]:
    """Return `response_format` of an OpenAI chat request: a single action, or an array of one per drone."""
    schema = action_schema() if root == "object" else {"type": "array", "items": action_schema()}
    return {"type": "json_schema", "json_schema": {"name": "reply", "strict": True, "schema": schema}}


def _one(name: str, fields: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {"action": {"type": "string", "enum": [name]}, **fields},
        "required": ["action", *fields],
        "additionalProperties": False,
    }
