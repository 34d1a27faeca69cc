"""What stands around what is read: prose, fences, brackets, and marked reasoning."""

import json
import re
from collections.abc import Iterable

from dronecats.agent.action import ActionError
from dronecats.agent.reply.mends import Mend

_WORD = "think(?:ing)?|thoughts?|reasoning|analysis|reflection|scratchpad"
_MARK = re.compile(
    rf"""<(?P<closes>/?)(?:\w+:)?(?:{_WORD})>  |  \[(?P<closes_bracket>/?)THINK\]  |  ◁(?P<closes_triangle>/?)think▷
    |  <\|(?:begin|(?P<closes_thought>end))_of_thought\|>
    |  <\|channel\|>\s*(?:(?P<closes_channel>final)\b|\w+)(?:[^<]*<\|message\|>)?
    |  (?P<fence>(?:```|~~~)[ \t]*(?P<opens_fence>(?:{_WORD})\b)?)""",
    re.IGNORECASE | re.VERBOSE,
)
_FENCE = re.compile(r"(?:```|~~~)[ \t]*[\w-]*")


def answer_of(reply: str) -> str:
    """Return a reply without its reasoning. Raises ActionError when nothing else is left of it."""
    if _is_json(reply):  # a mark in one of its strings is none
        return reply
    answer = without_reasoning(reply)
    if not answer.strip() and reply.strip():
        raise ActionError("the reply is reasoning and no answer")
    return answer


def without_reasoning(text: str) -> str:
    """Return a reply without what its marks of reasoning enclose.

    Marks are tags such as <think> and [THINK], the channels of gpt-oss other than `final`, and fences that are named
    like a tag. Reasoning that is never closed runs to the end. Before a closing mark that was never opened, everything
    is reasoning: the template of some models has opened it.
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


def around(text: str, spans: Iterable[tuple[int, int]]) -> set[Mend]:
    """Return what stands around values at (begin, end), in order: a fence, an array's brackets, prose."""
    pieces, at = [], 0
    for begin, end in spans:
        pieces.append(text[at:begin])
        at = end
    pieces.append(text[at:])
    found: set[Mend] = set()
    rest = "\0".join(pieces)
    bare = _FENCE.sub("", rest)
    if bare != rest:
        found.add("fence")
    if bare.strip(" \t\r\n\0").startswith("[") and bare.strip(" \t\r\n\0").endswith("]"):
        found.add("array")
        bare = bare.replace("[", "").replace("]", "").replace(",", "")
    if bare.strip(" \t\r\n\0"):
        found.add("prose")
    return found
