"""A commander's reply is parsed completely, or rejected with a reason."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import ActionError
from dronecats.agent.commanding.command_prompt import MAX_REPLY_CHARS, FleetOrders, parse_orders
from tests.support.refusal import refusal

LOOK: dict[str, Any] = {"drone": 2, "goal": "look at the left one"}


def test_valid_replies_are_read():
    for reply, read in [
        ({"orders": [LOOK], "confirm": [3]}, FleetOrders(((1, "look at the left one"),), (2,))),
        ({"orders": [], "confirm": []}, FleetOrders()),
        ({"confirm": [1, 4, 1]}, FleetOrders((), (0, 3))),
        (
            {"orders": [LOOK, {"drone": 1, "goal": "x", "why": "it is near"}]},
            FleetOrders(((1, LOOK["goal"]), (0, "x"))),
        ),
        ({"orders": [{"drone": 4, "goal": "  two\n lines\tof it "}]}, FleetOrders(((3, "two lines of it"),))),
        ("```json\n" + json.dumps({"confirm": [2]}) + "\n```", FleetOrders((), (1,))),
        ('First {"confirm":[1]}, no: {"orders":[],"confirm":[2]}. {"done": true}', FleetOrders((), (1,))),
        ('{"drone": {broken {"confirm":[2]}', FleetOrders((), (1,))),
    ]:
        assert parse_orders(reply if isinstance(reply, str) else json.dumps(reply), 4) == read, reply


def test_invalid_replies_are_rejected_with_a_reason():
    for reply, word in [
        ("", "JSON"),
        ("all of them: go left", "JSON"),
        ('[{"drone":1}]', "JSON"),
        ('{"orders":[{"drone":1,"goal":"a"}', "JSON"),
        ('{"orders":{"1":"a"}}', "list"),
        ('{"orders":[],"confirm":2}', "list"),
        ('{"orders":["go left"]}', "JSON object"),
        ('{"orders":[{"drone":1}]}', '"goal"'),
        ('{"orders":[{"drone":1,"goal":7}]}', '"goal"'),
        ('{"orders":[{"drone":1,"goal":"  "}]}', "500"),
        ('{"orders":[{"drone":1,"goal":"a\\u0000b"}]}', "500"),
        (json.dumps({"orders": [{"drone": 1, "goal": "a" * 501}]}), "500"),
        ('{"orders":[{"goal":"a"}]}', "number"),
        ('{"orders":[{"drone":"1","goal":"a"}]}', "number"),
        ('{"orders":[{"drone":true,"goal":"a"}]}', "number"),
        ('{"orders":[{"drone":0,"goal":"a"}]}', "drone 0"),
        ('{"confirm":[5]}', "drone 5"),
        ('{"orders":[{"drone":2,"goal":"a"},{"drone":2,"goal":"b"}]}', "drone 2"),
        ('{"orders":[{"drone":2,"goal":"a"}],"confirm":["2"]}', "number"),
    ]:
        assert word in refusal(parse_orders, reply, 4, error=ActionError)


def test_orders_in_marked_reasoning_are_not_executed():
    for reply, word in [
        ('<think>Drone 1 says it has arrived. I could answer {"orders": [], "confirm": [1]}, but the sign …', "reason"),
        ('<think>maybe {"orders":[],"confirm":[1]}</think>\nNo change.', "JSON"),
    ]:
        assert word in refusal(parse_orders, reply, 4, error=ActionError)
    reply = '<think>{"confirm":[1]}?</think>{"confirm":[2]}'
    assert parse_orders(reply, 4) == FleetOrders((), (1,))


keys = st.sampled_from(["orders", "confirm", "drone", "goal"])
values = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner),
    max_leaves=12,
)


@given(values.map(json.dumps) | st.text(max_size=200), st.integers(1, 8))
def test_any_reply_gives_orders_for_existing_drones_or_an_error(reply, drones):
    try:
        read = parse_orders(reply, drones)
    except ActionError:
        return
    named = [drone for drone, _ in read.goals]
    assert len(set(named)) == len(named)
    assert len(set(read.confirmed)) == len(read.confirmed)
    assert all(0 <= drone < drones for drone in (*named, *read.confirmed))
    assert all(goal and "\n" not in goal and len(goal) <= 500 for _, goal in read.goals)


@pytest.mark.parametrize("reply", ["{" * 10**6, '{"a":' * 10**5, '{"confirm":[' * 10**5, "{}" * 10**6])
def test_a_reply_is_parsed_only_up_to_the_length_limit(reply):
    with pytest.raises(ActionError):
        parse_orders(reply, 4)
    with pytest.raises(ActionError):  # text beyond the limit is not read
        parse_orders(" " * MAX_REPLY_CHARS + '{"confirm":[1]}', 4)
