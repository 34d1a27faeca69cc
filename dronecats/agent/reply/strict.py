"""Reading to the letter of the prompt: one JSON object, or an array of one per drone, whatever stands around it."""

import json
from dataclasses import dataclass
from typing import Any

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply.mends import answer_of

MAX_REPLY_CHARS = 200_000  # 8192 tokens are far below this
MAX_TRIES = 500  # places in a reply at which JSON may begin
MAX_VAIN_CHARS = 5 * MAX_REPLY_CHARS  # read in vain after such places: nothing that is meant to be read needs more


@dataclass(frozen=True, slots=True)
class JsonSpan:
    """A JSON value of a reply, and where it stands."""

    value: Any
    begin: int
    end: int


def parse(reply: str, axis_order: AxisOrder = "xy") -> Action:
    """Return the action in `reply`.

    The prompt asks for one JSON object and nothing else. Prose or a code fence around it is tolerated: the last object
    that has an "action" counts, since what comes before it leads up to it. Marked reasoning is not read. Raises
    ActionError with the reason when there is no action or it is malformed.
    """
    return action_from(last_object(answer_of(reply[:MAX_REPLY_CHARS])).value, axis_order)


def parse_fleet(reply: str, drones: int, axis_order: AxisOrder = "xy") -> list[Action | ActionError]:
    """Return one action or error per drone from a reply that holds a JSON array of `drones` objects.

    With one drone this is `parse`. A reply that is no array of the right length is an error for every drone.
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
    """Return the object that counts. Raises ActionError when there is none."""
    found = values(reply, "{")
    if not found:
        raise ActionError("no JSON object in the reply")
    return next((each for each in reversed(found) if declares(each.value)), found[-1])


def first_array(reply: str) -> JsonSpan:
    """Return the array of objects that counts. Raises ActionError when there is none."""
    for each in values(reply, "["):
        if isinstance(each.value, list) and any(isinstance(item, dict) for item in each.value):
            return each
    raise ActionError("no JSON array of actions in the reply")


def declares(value: Any) -> bool:
    """Whether a value is an object that names an action."""
    return isinstance(value, dict) and "action" in value


def values(reply: str, opening: str) -> list[JsonSpan]:
    """Return the outermost JSON values of the text that start with `opening`, in order.

    Where a value breaks off the next one may begin inside it, which read again and again would take the square of the
    reply's length: so what is read in vain is counted, and the search ends when it is too much.
    """
    decoder = json.JSONDecoder()
    text, found, at, tries, vain = reply[:MAX_REPLY_CHARS], [], 0, 0, 0
    while vain < MAX_VAIN_CHARS and (at := text.find(opening, at)) >= 0 and (tries := tries + 1) <= MAX_TRIES:
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:  # only a JSONDecodeError says how far it came
            vain += (error.pos if isinstance(error, json.JSONDecodeError) else len(text)) - at
            at += 1
            continue
        found.append(JsonSpan(value, at, end))
        at = end
    return found
