"""The schemas satisfy OpenAI's rules for strict schemas, and valid replies are parsed.

Source: platform.openai.com/docs/guides/structured-outputs, "Supported schemas".
"""

import json

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import Action, action_from
from dronecats.agent.commanding.command_prompt import parse_orders
from dronecats.agent.models.model import Request
from dronecats.agent.models.reply_schema import action_schema, flat_action_schema, orders_schema, reply_schema
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.agent.reply.reading import reading
from foundation.errors import UsageError

TYPES = {"string", "number", "boolean", "integer", "object", "array", "null"}
KEYWORDS = {
    "object": {"properties", "required", "additionalProperties"},
    "array": {"items", "minItems", "maxItems"},
    "number": {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf"},
    "integer": {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf"},
    "string": {"enum"},
}


def faults(schema, root=True):
    """Yield the reasons for which OpenAI would reject a strict schema."""
    if "anyOf" in schema:
        if root:
            yield "a choice at the root"
        for inner in schema["anyOf"]:
            yield from faults(inner, root=False)
        return
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if root and kinds != ["object"]:
        yield "a root that is no object"
    yield from (f"type {kind}" for kind in kinds if kind not in TYPES)
    allowed = {"type"}.union(*(KEYWORDS.get(kind, set()) for kind in kinds))
    yield from (f"keyword {key}" for key in schema if key not in allowed)
    if "object" in kinds:
        if schema["required"] != list(schema["properties"]):
            yield "a property that may be left out"
        if schema["additionalProperties"] is not False:
            yield "properties of any name"
        for inner in schema["properties"].values():
            yield from faults(inner, root=False)
    if "array" in kinds:
        yield from faults(schema["items"], root=False)


def sent(provider, role="pilot", drones=1, schema="object"):
    """Return the schema that a provider's model receives."""
    model = open_model(ModelSpec(provider=provider, name="m", base_url="http://127.0.0.1:1", schema=schema))
    body = model.body(Request("text", (b"jpeg",) * drones, False, role=role))
    model.close()
    return body["response_format"]["json_schema"]


@pytest.mark.parametrize("provider", ["openai", "openrouter", "litellm"])
def test_schemas_for_openai_satisfy_its_rules(provider):
    for response_schema in (sent(provider), sent(provider, "commander", 4)):
        assert response_schema["strict"] is True
        assert list(faults(response_schema["schema"])) == []
    assert list(faults(action_schema())) == ["a choice at the root"]  # local servers accept it
    assert list(faults(reply_schema("array"))) == ["a root that is no object"]


def test_request_schemas_of_pilot_and_commander():
    number = {"type": ["number", "null"]}
    point = {
        "type": ["array", "null"],
        "items": {"type": "number", "minimum": 0, "maximum": 1000},
        "minItems": 2,
        "maxItems": 2,
    }
    assert sent("openai") == {
        "name": "reply",
        "strict": True,
        "schema": {
            "type": "object",
            "properties": {
                "action": {"type": "string", "enum": ["go", "rotate", "think", "finished"]},
                "point": point,
                "depth_m": {**number, "exclusiveMinimum": 0},
                "angle_deg": number,
            },
            "required": ["action", "point", "depth_m", "angle_deg"],
            "additionalProperties": False,
        },
    }
    drone = {"type": "integer", "minimum": 1, "maximum": 3}
    order = {
        "type": "object",
        "properties": {"drone": drone, "goal": {"type": "string"}},
        "required": ["drone", "goal"],
        "additionalProperties": False,
    }
    assert sent("vllm", "commander", 3, "array") == {
        "name": "reply",
        "strict": True,
        "schema": {
            "type": "object",
            "properties": {"orders": {"type": "array", "items": order}, "confirm": {"type": "array", "items": drone}},
            "required": ["orders", "confirm"],
            "additionalProperties": False,
        },
    }


def test_local_servers_are_sent_the_narrower_schema():
    assert sent("vllm")["schema"] == action_schema()


POINTS = st.lists(st.floats(0, 1000), min_size=2, max_size=2)
REPLIES = st.fixed_dictionaries(
    {
        "action": st.sampled_from(["go", "rotate", "think", "finished"]),
        "point": st.none() | POINTS,
        "depth_m": st.none() | st.floats(0.001, 1e5),
        "angle_deg": st.none() | st.floats(-3600, 3600),
    }
)
WANTS = {"go": ("point", "depth_m"), "rotate": ("angle_deg",), "think": (), "finished": ()}


@given(REPLIES, st.sampled_from(["xy", "yx"]), st.sampled_from(["strict", "lenient"]))
def test_a_valid_reply_is_an_action_exactly_if_its_required_fields_are_not_null(reply, order, parser):
    jsonschema.validate(reply, flat_action_schema())
    (read,) = reading(json.dumps(reply), 1, order, parser)
    own = {name: reply[name] for name in WANTS[reply["action"]]}
    if None in own.values():
        assert read.action is None
    else:
        assert isinstance(read.action, Action)
        assert read.action == action_from({"action": reply["action"], **own}, order)
        assert read.mended == ()


@given(
    st.fixed_dictionaries(
        {
            "orders": st.lists(
                st.fixed_dictionaries(
                    {"drone": st.integers(1, 4), "goal": st.text("ab ", min_size=1).filter(str.strip)}
                ),
                unique_by=lambda order: order["drone"],
            ),
            "confirm": st.lists(st.integers(1, 4)),
        }
    )
)
def test_orders_that_satisfy_the_schema_are_parsed(reply):
    jsonschema.validate(reply, orders_schema(4))
    read = parse_orders(json.dumps(reply), 4)
    assert [drone + 1 for drone, _ in read.goals] == [order["drone"] for order in reply["orders"]]
    assert {drone + 1 for drone in read.confirmed} == set(reply["confirm"])


def test_an_array_schema_is_rejected_for_openai_itself(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-SECRET-1234567890")
    with pytest.raises(UsageError, match="array"):
        open_model(ModelSpec(provider="openai", name="m", schema="array"))
    open_model(ModelSpec(provider="openai", name="m", schema="array", base_url="http://127.0.0.1:1/v1")).close()
