"""The reading of a reply: a pure function of its text, so that a kept reply can be read again, in either way."""

from dataclasses import dataclass
from typing import Literal

from dronecats.agent.action import Action, ActionError, AxisOrder
from dronecats.agent.reply import lenient, strict
from dronecats.agent.reply.mends import Mend

ReplyParser = Literal["strict", "lenient"]


@dataclass(frozen=True, slots=True)
class Reading:
    """What a reply says for one drone: an action, or why there is none."""

    action: Action | None
    error: str | None = None  # None: there is an action
    mended: tuple[Mend, ...] = ()  # what had to be mended to read it, each once, in the order of `mends.MENDS`


def reading(reply: str, drones: int, axis_order: AxisOrder = "xy", parser: ReplyParser = "strict") -> list[Reading]:
    """Return what `reply` says for each of `drones`, in the order of their pictures.

    strict: as the prompt asks, and nothing is mended. lenient: whatever can be meant in one way only is read, and the
    reading says how. What strict reads, lenient reads alike, but where a fleet's objects name their drones and stand in
    another order. Raises nothing.
    """
    if parser == "lenient":
        return [_of(one, mended) for one, mended in lenient.read(reply, drones, axis_order)]
    return [_of(one) for one in strict.parse_fleet(reply, drones, axis_order)]


def _of(one: Action | ActionError, mended: tuple[Mend, ...] = ()) -> Reading:
    return Reading(None, str(one), mended) if isinstance(one, ActionError) else Reading(one, None, mended)
