"""Reading what models really emit: whatever can be meant in one way only, with a note of what was mended.

What the strict reading accepts is taken as that takes it. Everything else goes the same way with more patience: the
last object that is meant as an action counts, one that is broken off or malformed too, so that no earlier draft is
flown instead.
"""

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.reply import fleet, strict
from dronecats.agent.reply.mends import TOLERATED, Mend, answer_of, around, in_order
from dronecats.agent.reply.shapes import action_of, tells
from dronecats.agent.reply.tolerant import Found, values

Read = tuple[Action | ActionError, tuple[Mend, ...]]


def read(reply: str, drones: int, axis_order: AxisOrder) -> list[Read]:
    """Return for each drone its action, or why there is none, and what had to be mended."""
    reply = reply[: strict.MAX_REPLY_CHARS]
    if drones > 1:
        return [(one, in_order(mends)) for one, mends in fleet.read(reply, drones, axis_order)]
    mends: set[Mend] = set()
    try:
        return [(_one(reply, axis_order, mends), in_order(mends))]
    except ActionError as error:
        return [(error, ())]


def _one(reply: str, axis_order: AxisOrder, mends: set[Mend]) -> Action:
    """Return the action of one drone's reply. Raises ActionError."""
    answer = answer_of(reply)
    mends |= {"reasoning"} if answer != reply else set()
    try:
        placed = strict.last_object(answer)
        action = action_from(placed.value, axis_order)
    except ActionError as error:
        refused = error
    else:
        spans = [(each.begin, each.end) for each in strict.values(answer, "{")]
        mends |= around(answer, spans)
        mends |= {"several"} if len(spans) > 1 else set()
        return action
    for text in (answer, _unescaped(answer)):
        found = candidates(text)
        if found:
            mends |= around(text, [(each.begin, each.end) for each in found]) | found[-1].mends
            mends |= {"escaped"} if text is not answer else set()
            mends |= {"several"} if len(found) > 1 else set()
            action = action_of(found[-1].value, axis_order, mends)
            if mends <= TOLERATED.keys():  # nothing was mended, so what was refused stays refused
                raise refused
            return action
    raise refused


def candidates(text: str) -> list[Found]:
    """Return the outermost objects that are meant as actions, in order; what breaks off hides what stands in it."""
    found = []
    for each in values(text, "{"):
        if tells(each.value, each.inner):
            found.append(each)
            if each.cut:
                break
    return found


def _unescaped(text: str) -> str:
    r"""Return a text whose quotes are escaped, {\"action\": …}, without the escapes."""
    if '\\"' not in text:
        return ""
    bare = text.strip()
    bare = bare[1:-1] if len(bare) > 1 and bare[0] == bare[-1] == '"' else bare
    return bare.replace('\\"', '"').replace("\\n", "\n").replace("\\t", "\t")
