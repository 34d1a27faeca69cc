"""The lenient parser accepts more than the strict one, never gives another action, and does bounded work."""

import json
from cProfile import Profile

from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.reply import strict, tolerant
from dronecats.agent.reply.mends import MENDS, TOLERATED, in_order
from dronecats.agent.reply.reading import reading
from tests.agent.reply.table import rows

TEXTS = [row.text for row in rows()]
PIECES = [
    "{", "}", "[", "]", "(", ")", '"', "'", "“", "”", ":", "：", ",", " ", "\n", "\\", '\\"', "//", "/*", "*/", "#",
    "a", "7", "-", ".", "°", "９", "\u00a0", "<think>", "</think>", "```", "True", "NaN", '"action"', "action",
    '"go"', "'think'", '"GO"', '"point":[1,2]', '"depth_m":', '"angle_deg":', "'9 m'", '"drone":2', '"drone":1',
    '{"action":"think"}', "{'action':'finished'}", '{"action":"rotate","angle_deg":9}', '{"drone_1":',
    '{"name":"think","arguments":{}}', '{"action":"land"}', "null",
]  # fmt: skip
ACTIONS = st.one_of(
    st.builds(Go, st.floats(0, 1000), st.floats(0, 1000), st.floats(0, 100_000)),
    st.builds(Rotate, st.floats(-3600, 3600)), st.just(Think()), st.just(Finished()),
)  # fmt: skip


@st.composite
def replies(draw):
    """A random reply of pieces, or a reply of the table with a piece added, a part removed, or the end cut off."""
    if draw(st.booleans()):
        return draw(st.lists(st.sampled_from(PIECES), max_size=40).map("".join))
    text = draw(st.sampled_from(TEXTS))
    a, b = sorted((draw(st.integers(0, len(text))), draw(st.integers(0, len(text)))))
    return draw(st.sampled_from([text[:a], text[:a] + text[b:], text[:a] + draw(st.sampled_from(PIECES)) + text[a:]]))


def compared(text, drones):
    """Assert that the strict and the lenient reading of a reply are consistent."""
    both = zip(reading(text, drones, "xy", "strict"), reading(text, drones, "xy", "lenient"), strict=True)
    for plain, lenient in both:
        assert (lenient.action is None) == (lenient.error is not None)
        assert lenient.mended == in_order(lenient.mended)
        if plain.action is not None and "by_name" not in lenient.mended:
            assert lenient.action == plain.action
            assert set(lenient.mended) <= TOLERATED.keys()
        if set(lenient.mended) <= TOLERATED.keys():
            assert lenient.action == plain.action


@settings(deadline=None, max_examples=300)
@given(replies(), st.sampled_from([1, 1, 2, 4]))
def test_lenient_agrees_with_strict_and_lists_every_repair(text, drones):
    compared(text, drones)


def test_lenient_agrees_with_strict_on_the_table():
    for row in rows():
        compared(row.text, row.drones)


@settings(deadline=None)
@given(st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("utf-8", "surrogateescape")))
def test_lenient_agrees_with_strict_on_any_text(text):
    compared(text, 1)
    compared(text, 3)


@given(st.lists(ACTIONS, min_size=1, max_size=5))
def test_serialized_actions_are_parsed_back(actions):
    text = json.dumps([a.as_json() for a in actions] if len(actions) > 1 else actions[0].as_json())
    for parser in ("strict", "lenient"):
        read = reading(text, len(actions), "xy", parser)
        assert [result.action for result in read] == actions
        assert all(result.mended == () for result in read)


@given(st.lists(ACTIONS, min_size=2, max_size=5), st.randoms())
def test_actions_with_drone_numbers_are_accepted_in_any_order(actions, lots):
    objects = [{"drone": place, **action.as_json()} for place, action in enumerate(actions, 1)]
    lots.shuffle(objects)
    assert [result.action for result in reading(json.dumps(objects), len(actions), "xy", "lenient")] == actions


def test_a_stored_reply_can_be_parsed_again_by_the_other_parser():
    """A stored `reply` is enough to parse it again: strictly for the score, leniently for the list of repairs."""
    text = "{'action': 'rotate', 'angle_deg': '30°'}"
    lenient_result = reading(text, 1, "xy", "lenient")[0]
    assert lenient_result.action == Rotate(30)
    assert lenient_result.mended == ("single_quotes", "number_text", "unit")
    assert reading(text, 1, "xy", "strict")[0].action is None


def calls(*arguments):
    """Return the number of function calls during a reading, calls of built-in functions included."""
    profile = Profile()
    profile.runcall(reading, *arguments)
    return sum(entry.callcount for entry in profile.getstats())


def test_parsing_work_is_proportional_to_the_reply_length(monkeypatch):
    """The limits are a tenth of the real ones, to save time."""
    for module in (strict, tolerant):
        monkeypatch.setattr(module, "MAX_REPLY_CHARS", module.MAX_REPLY_CHARS // 10)
        monkeypatch.setattr(module, "MAX_VAIN_CHARS", module.MAX_VAIN_CHARS // 10)
    length = strict.MAX_REPLY_CHARS
    for head, unit, tail in [
        ('{"a":' * 490 + "[", '{"a":{}},', ""), ("{a:" * 490 + "[", "[],", ""), ('{"a":' * 490, '"\\"', ""),
        ('{"a":' * 39 + "[", "1,", ";"), ("{'a':" * 39 + '["', "say ", ""), ("", '{"a":[', ""), ("", "{", ""),
        ("", '{"', ""), ("", "[{", ""), ("", "{'", ""), ("", "{/*", ""), ("", "{//", ""), ("", "{#\n", ""),
        ("{" * 400, " \u00a0", ""), ("", "{a:9", ""), ("{a:" * 300, "9", ""), ("", "<think>", ""), ("", "</think>", ""),
        ("", "<think></think>", ""), ("", "```", ""), ("", '{"a":"{"},', ""), ("", "[{'drone':1},", ""),
        ("[", "{'action':'go','point':'<point>'},", ""), ("", '{\\"', ""), ('{"a":[', "{'b':[1]},", ""),
    ]:  # fmt: skip
        text = (head + unit * length)[: length - len(tail)] + tail
        assert calls(text, 1, "xy", "lenient") < 40 * len(text), (head[:20], unit, tail)
        assert calls(text, 4, "xy", "lenient") < 40 * len(text), (head[:20], unit, tail)


def test_parsing_work_is_bounded_for_nested_objects_with_braces_in_their_strings():
    string = '"' + "{a:" * 60 + '"'
    members = "{" + ",".join(f'"k{k}":{string}' for k in range(39)) + "}"
    flat = calls(members, 1, "xy", "lenient")
    assert calls('{"function":' * 5 + members + "}" * 5, 1, "xy", "lenient") < 1.5 * flat  # each level counts once
    assert calls(members * 20, 1, "xy", "lenient") < 3 * flat  # all strings of a reply share one budget


def test_every_repair_code_is_documented():
    from tests.docs.pages import ROOT

    page = (ROOT / "docs" / "replies.md").read_text(encoding="utf-8")
    assert [code for code in MENDS if f"| `{code}` |" not in page] == []
