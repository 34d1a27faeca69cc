import contextlib
import gc
import json
import time

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dronecats.agent.action import ActionError, Finished, Go, Rotate, Think, action_from
from dronecats.agent.reply.strict import MAX_REPLY_CHARS, parse, parse_fleet
from tests.support.refusal import refusal


def test_errors_name_the_fault():
    for reply, word in [
        ("", "JSON"),
        ("the car is ahead", "JSON"),
        ('{"action":"land"}', "land"),
        ('{"point":[1,2]}', '"action"'),
        ('{"action":"go","point":[1],"depth_m":3}', '"point"'),
        ('{"action":"go","point":[1200,20],"depth_m":3}', '"point" (1200, 20)'),
        ('{"action":"go","point":[1,2]}', '"depth_m"'),
        ('{"action":"go","point":[1,2],"depth_m":-1}', '"depth_m" -1'),
        ('{"action":"go","point":[1,2],"depth_m":NaN}', '"depth_m"'),
        ('{"action":"go","point":[true,2],"depth_m":3}', '"point"'),
        ('{"action":"rotate","angle_deg":"90"}', '"angle_deg"'),
        ('{"action":"rotate","angle_deg":1e400}', '"angle_deg"'),
        ('{"action":"go","point":[1,2],"depth_m":%s}' % ("9" * 400), '"depth_m"'),
    ]:
        assert word in refusal(parse, reply, error=ActionError)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@given(
    st.dictionaries(
        st.sampled_from(["action", "point", "depth_m", "angle_deg", "x"]),
        json_values | st.sampled_from(["go", "rotate", "think", "finished"]),
    )
)
def test_any_object_is_an_action_in_range_or_an_error(value):
    try:
        action = parse(json.dumps(value))
    except ActionError:
        return
    if isinstance(action, Go):
        assert 0 <= action.x <= 1000
        assert 0 <= action.y <= 1000
        assert 0 <= action.depth_m <= 1e5


def test_deep_nesting_is_an_error_not_a_crash():
    with pytest.raises(ActionError):
        parse("{" * 50_000)
    with pytest.raises(ActionError):
        parse('{"action":' + "[" * 90_000)


def test_a_fleet_needs_one_action_per_drone():
    reply = '[{"action":"think"},{"action":"rotate","angle_deg":9},{"action":"x"},{"action":"finished"}]'
    think, rotate, bad, finished = parse_fleet(reply, 4)
    assert (think, rotate, finished) == (Think(), Rotate(9), Finished())
    assert isinstance(bad, ActionError)
    assert all(isinstance(a, ActionError) for a in parse_fleet(reply, 3))
    assert all(isinstance(a, ActionError) for a in parse_fleet('{"action":"think"}', 4))


def plainly(reply):
    """Reference for `parse`: try every brace, skip parsed objects, and take the last object that has an action."""
    values, at = [], 0
    while (at := reply.find("{", at)) >= 0:
        try:
            value, at = json.JSONDecoder().raw_decode(reply, at)
            values.append(value)
        except (ValueError, RecursionError):
            at += 1
    if not values:
        raise ActionError("no JSON object in the reply")
    return action_from(next((v for v in reversed(values) if "action" in v), values[-1]))


def outcome(read, reply):
    try:
        return read(reply)
    except ActionError as error:
        return str(error)


PIECES = ["{", "}", "[", "]", '"', ":", ",", " ", "\\", "a", "7", "\n", '"a":', '{"action":"think"}', '"action"', '"{',
          '{"action":"rotate","angle_deg":9}', '{"action":"finished"}', '}"', '\\"', '{"plan":[', "null"]  # fmt: skip


@given(st.lists(st.sampled_from(PIECES), max_size=60).map("".join))
@example('{"a": "{" {"action":"think"}')
@example('{"plan":[{"action":"think"},{"action":"rotate","angle_deg":9}')
@example('{"say":"{\\"action\\":\\"think\\"}","action":"finished"}')
def test_parse_agrees_with_the_reference_search(reply):
    assert outcome(parse, reply) == outcome(plainly, reply)


def test_an_action_inside_a_long_truncated_reply_is_parsed():
    reply = '{"plan":[' + '{"why":"' + "because " * 3000 + '"},' + '{"action":"rotate","angle_deg":9}'
    assert parse(reply) == Rotate(9)


def seconds(call):
    """Return the processor time of a call, s: the minimum of three, without garbage collection."""
    best = float("inf")
    gc.disable()
    try:
        for _ in range(3):
            began = time.process_time()
            with contextlib.suppress(ActionError):
                call()
            best = min(best, time.process_time() - began)
    finally:
        gc.enable()
    return best


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        ('{"a":' * 490 + "[", '{"a":{}},'),
        ('{"a":' * 490 + "[", "[],"),
        ('{"a":' * 490 + "[", "1,"),
        ('{"a":' * 490, '"\\"'),
        ("", '{"a":[' + "[]," * 130),
        ("", '{"a":'),
        ("", "["),
        ("", '{"'),
        ("", "[{"),
    ],
)
def test_parse_time_is_bounded_for_adversarial_replies(head, unit):
    reply = (head + unit * MAX_REPLY_CHARS)[:MAX_REPLY_CHARS]
    valid = "[" + '{"a":{}},' * (MAX_REPLY_CHARS // 9 - 2) + "0]"
    once = seconds(lambda: json.loads(valid))
    assert seconds(lambda: parse(reply)) < 100 * once
    assert seconds(lambda: parse_fleet(reply, 4)) < 100 * once
