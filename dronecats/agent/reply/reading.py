"""Parses the text of a reply, strictly or leniently. `reading` is a pure function, so it can parse a logged reply."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply import fleet, strict
from dronecats.agent.reply.mends import TOLERATED, Mend, around, in_order
from dronecats.agent.reply.shapes import action_of, is_action
from dronecats.agent.reply.strict import answer_of
from dronecats.agent.reply.tolerant import ReadValue, SearchBudget, read_values

ReplyParser = Literal["strict", "lenient"]


@dataclass(frozen=True, slots=True)
class Reading:
    """The action of a reply for one drone, or the reason why there is none."""

    action: Action | None
    error: str | None = None  # None: there is an action
    mended: tuple[Mend, ...] = ()  # codes of the corrections that the parser made, in the order of `mends.MENDS`


def reading(reply: str, drones: int, axis_order: AxisOrder = "xy", parser: ReplyParser = "strict") -> list[Reading]:
    """Return the reading of `reply` for each of `drones`, in the order of their pictures.

    strict: accepts the form that the prompt asks for, without corrections. lenient: accepts any text with only one
    possible meaning, and lists its corrections. If the strict parser accepts a reply, both parsers give the same
    result. Exception: the objects of a fleet name their drones in another order than the pictures. Never raises.
    """
    if parser == "strict":
        return [_reading(result) for result in strict.parse_fleet(reply, drones, axis_order)]
    reply = reply[: strict.MAX_REPLY_CHARS]
    if drones > 1:
        return [_reading(result, mends) for result, mends in fleet.read(reply, drones, axis_order)]
    mends: set[Mend] = set()
    try:
        return [_reading(_single_action(reply, axis_order, mends), mends)]
    except ActionError as error:
        return [_reading(error)]


def _reading(result: Action | ActionError, mends: Collection[Mend] = ()) -> Reading:
    mended = in_order(mends)
    return Reading(None, str(result), mended) if isinstance(result, ActionError) else Reading(result, None, mended)


def _single_action(reply: str, axis_order: AxisOrder, mends: set[Mend]) -> Action:
    """Return the action of one drone's reply, read leniently. Raises ActionError.

    A reply that the strict parser accepts is parsed strictly. Otherwise the last object that is meant as an action
    counts. If that object is cut off or malformed, earlier objects do not count instead.
    """
    answer = answer_of(reply)
    mends |= {"reasoning"} if answer != reply else set()
    try:
        action = action_from(strict.last_object(answer).value, axis_order)
    except ActionError as error:
        strict_error = error
    else:
        spans = strict.json_spans(answer, "{")
        mends |= around(answer, spans)
        mends |= {"several"} if len(spans) > 1 else set()
        return action
    budget = SearchBudget()
    for text in (answer, _unescaped(answer)):
        if objects := action_objects(text, budget):
            mends |= around(text, objects) | objects[-1].mends
            mends |= {"escaped"} if text is not answer else set()
            mends |= {"several"} if len(objects) > 1 else set()
            action = action_of(objects[-1].value, axis_order, mends, budget)
            if mends <= TOLERATED.keys():  # nothing was mended: the strict rejection holds
                raise strict_error
            return action
    raise strict_error


def action_objects(text: str, budget: SearchBudget) -> list[ReadValue]:
    """Return the outermost objects that are meant as actions, in order, up to the first that is cut off."""
    objects = []
    for value in read_values(text, "{"):
        if is_action(value.value, budget, value.inner):
            objects.append(value)
            if value.cut:
                break
    return objects


def _unescaped(text: str) -> str:
    r"""Return a text with escaped quotes, {\"action\": …}, without the escapes; "" if it has no escaped quotes."""
    if '\\"' not in text:
        return ""
    bare = text.strip()
    bare = bare[1:-1] if len(bare) > 1 and bare[0] == bare[-1] == '"' else bare
    return bare.replace('\\"', '"').replace("\\n", "\n").replace("\\t", "\t")
