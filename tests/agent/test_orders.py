"""What a commander's reply is read as: all of it or, with the reason, nothing."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.orders import MAX_REPLY_CHARS, FleetOrders, OrdersError, parse_orders

LOOK: dict[str, Any] = {"drone": 2, "goal": "look at the left one"}


@pytest.mark.parametrize(
    ("reply", "read"),
    [
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
    ],
)
def test_what_can_be_read(reply, read):
    assert parse_orders(reply if isinstance(reply, str) else json.dumps(reply), 4) == read


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        ("", "no JSON object"),
        ("all of them: go left", "no JSON object"),
        ('[{"drone":1}]', "no JSON object"),
        ('{"orders":[{"drone":1,"goal":"a"}', "no JSON object"),
        ('{"orders":{"1":"a"}}', '"orders" is not a list'),
        ('{"orders":[],"confirm":2}', '"confirm" is not a list'),
        ('{"orders":["go left"]}', "not a JSON object"),
        ('{"orders":[{"drone":1}]}', 'no "goal"'),
        ('{"orders":[{"drone":1,"goal":7}]}', 'no "goal"'),
        ('{"orders":[{"drone":1,"goal":"  "}]}', "1 … 500 printable characters"),
        ('{"orders":[{"drone":1,"goal":"a\\u0000b"}]}', "1 … 500 printable characters"),
        (json.dumps({"orders": [{"drone": 1, "goal": "a" * 501}]}), "1 … 500 printable characters"),
        ('{"orders":[{"goal":"a"}]}', "not named by its number"),
        ('{"orders":[{"drone":"1","goal":"a"}]}', "not named by its number"),
        ('{"orders":[{"drone":true,"goal":"a"}]}', "not named by its number"),
        ('{"orders":[{"drone":0,"goal":"a"}]}', "there is no drone 0, but 1 to 4"),
        ('{"confirm":[5]}', "there is no drone 5, but 1 to 4"),
        ('{"orders":[{"drone":2,"goal":"a"},{"drone":2,"goal":"b"}]}', "drone 2 has two goals"),
        ('{"orders":[{"drone":2,"goal":"a"}],"confirm":["2"]}', "not named by its number"),
    ],
)
def test_what_cannot_is_told_and_changes_nothing(reply, said):
    with pytest.raises(OrdersError, match=said):
        parse_orders(reply, 4)


keys = st.sampled_from(["orders", "confirm", "drone", "goal"])
values = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner),
    max_leaves=12,
)


@given(values.map(json.dumps) | st.text(max_size=200), st.integers(1, 8))
def test_any_reply_is_orders_for_drones_that_there_are_or_an_error(reply, drones):
    try:
        read = parse_orders(reply, drones)
    except OrdersError:
        return
    named = [drone for drone, _ in read.goals]
    assert len(set(named)) == len(named)
    assert len(set(read.confirmed)) == len(read.confirmed)
    assert all(0 <= drone < drones for drone in (*named, *read.confirmed))
    assert all(goal and "\n" not in goal and len(goal) <= 500 for _, goal in read.goals)


@pytest.mark.parametrize("reply", ["{" * 10**6, '{"a":' * 10**5, '{"confirm":[' * 10**5, "{}" * 10**6])
def test_a_reply_without_end_is_read_in_part(reply):
    with pytest.raises(OrdersError):
        parse_orders(reply, 4)
    with pytest.raises(OrdersError):  # what is beyond the limit is not read
        parse_orders(" " * MAX_REPLY_CHARS + '{"confirm":[1]}', 4)
