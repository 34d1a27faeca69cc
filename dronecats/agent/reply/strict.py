"""Strict parser of replies: one JSON object, or an array with one object per drone, with any text around it."""

import json
import re
from dataclasses import dataclass
from typing import Any

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from

MAX_REPLY_CHARS = 200_000  # characters of a reply that are parsed; a reply of 8192 tokens is far shorter
MAX_TRIES = 500  # the parser tries to read JSON at up to this many places of a reply
MAX_VAIN_CHARS = 5 * MAX_REPLY_CHARS  # the parser stops when its failed tries have read this many characters
_WORD = "think(?:ing)?|thoughts?|reasoning|analysis|reflection|scratchpad"
_MARK = re.compile(
    rf"""<(?P<closes>/?)(?:\w+:)?(?:{_WORD})>  |  \[(?P<closes_bracket>/?)THINK\]  |  ◁(?P<closes_triangle>/?)think▷
    |  <\|(?:begin|(?P<closes_thought>end))_of_thought\|>
    |  <\|channel\|>\s*(?:(?P<closes_channel>final)\b|\w+)(?:[^<]*<\|message\|>)?
    |  (?P<fence>(?:```|~~~)[ \t]*(?P<opens_fence>(?:{_WORD})\b)?)""",
    re.IGNORECASE | re.VERBOSE,
)


@dataclass(frozen=True, slots=True)
class JsonSpan:
    """A JSON value of a reply, and its position."""

    value: Any
    begin: int
    end: int


def answer_of(reply: str) -> str:
    """Return a reply without its reasoning. Raises ActionError if the reply is only reasoning."""
    if _is_json(reply):  # a reasoning mark inside a JSON string does not count
        return reply
    answer = without_reasoning(reply)
    if not answer.strip() and reply.strip():
        raise ActionError("the reply is reasoning and no answer")
    return answer


def without_reasoning(text: str) -> str:
    """Return a reply without the text between its reasoning marks.

    Marks are tags such as <think> and [THINK], the channels of gpt-oss other than `final`, and code fences with the
    name of a tag, such as ```thinking. Reasoning without a closing mark extends to the end. All text before a closing
    mark without an opening mark is reasoning, because some models have the opening mark in their chat template and not
    in the reply.
    """
    kept: list[str] = []
    at, within, fenced = 0, False, False
    for mark in _MARK.finditer(text):
        if mark["fence"]:
            opens = bool(mark["opens_fence"]) and not within
            if not opens and not fenced:
                continue  # a fence around an answer
            fenced, closes = opens, not opens
        else:
            closes = any(value for name, value in mark.groupdict().items() if name.startswith("closes"))
        if closes and not within:
            kept.clear()
        elif not closes and not within:
            kept.append(text[at : mark.start()])
        at, within = mark.end(), not closes
        fenced = fenced and within
    return "".join(kept) + ("" if within else text[at:])


def _is_json(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict | list)
    except (ValueError, RecursionError):
        return False


def parse(reply: str, axis_order: AxisOrder = "xy") -> Action:
    """Return the action in `reply`.

    The prompt asks for one JSON object and nothing else. Prose or a code fence around it is tolerated: the last object
    that has an "action" counts. Marked reasoning is skipped. Raises ActionError with the reason if there is no action
    or it is malformed.
    """
    return action_from(last_object(answer_of(reply[:MAX_REPLY_CHARS])).value, axis_order)


def parse_fleet(reply: str, drones: int, axis_order: AxisOrder = "xy") -> list[Action | ActionError]:
    """Return one action or error per drone from a reply that holds a JSON array of `drones` objects.

    With one drone this is `parse`. Without an array of the right length, every drone gets an error.
    """
    if drones == 1:
        try:
            return [parse(reply, axis_order)]
        except ActionError as error:
            return [error]
    try:
        items = first_array(answer_of(reply[:MAX_REPLY_CHARS])).value
    except ActionError as error:
        return [error] * drones
    if len(items) != drones:
        return [ActionError(f"expected {drones} actions, got {len(items)}")] * drones
    actions: list[Action | ActionError] = []
    for item in items:
        try:
            actions.append(action_from(item, axis_order))
        except ActionError as error:
            actions.append(error)
    return actions


def last_object(reply: str) -> JsonSpan:
    """Return the last object that names an action, else the last object. Raises ActionError if there is none."""
    spans = json_spans(reply, "{")
    if not spans:
        raise ActionError("no JSON object in the reply")
    return next((span for span in reversed(spans) if "action" in span.value), spans[-1])


def first_array(reply: str) -> JsonSpan:
    """Return the first array that has an object. Raises ActionError if there is none."""
    for span in json_spans(reply, "["):
        if has_objects(span):
            return span
    raise ActionError("no JSON array of actions in the reply")


def has_objects(array: JsonSpan) -> bool:
    return any(isinstance(item, dict) for item in array.value)


def json_spans(reply: str, opening: str) -> list[JsonSpan]:
    """Return the outermost JSON values of the text that start with `opening`, in order.

    If a value is incomplete or not valid, the search continues after its opening bracket. This could take quadratic
    time, so the search ends after MAX_TRIES places, or after MAX_VAIN_CHARS characters without a complete value.
    """
    decoder = json.JSONDecoder()
    text, spans, at, tries, vain = reply[:MAX_REPLY_CHARS], [], 0, 0, 0
    while vain < MAX_VAIN_CHARS and (at := text.find(opening, at)) >= 0 and (tries := tries + 1) <= MAX_TRIES:
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:  # only a JSONDecodeError has a position
            vain += (error.pos if isinstance(error, json.JSONDecodeError) else len(text)) - at
            at += 1
            continue
        spans.append(JsonSpan(value, at, end))
        at = end
    return spans
