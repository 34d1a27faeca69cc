"""What stands around what is read: prose, fences, brackets, and reasoning between tags."""

import re
from collections.abc import Iterable

from dronecats.agent.reply.mends import Mend

_TAG = re.compile(r"<(/?)(?:think|thinking|thought|reasoning|analysis)>|◁(/?)think▷", re.IGNORECASE)
_FENCE = re.compile(r"(?:```|~~~)[ \t]*[\w-]*")


def without_reasoning(text: str) -> str:
    """Return a reply without what stands between tags of reasoning.

    A tag that is never closed runs to the end; before one that was never opened, everything is reasoning: the template
    of some models has opened it.
    """
    kept: list[str] = []
    at, within = 0, False
    for tag in _TAG.finditer(text):
        closes = bool(tag.group(1) or tag.group(2))
        if closes and not within:
            kept.clear()
        elif not closes and not within:
            kept.append(text[at : tag.start()])
        at, within = tag.end(), not closes
    return "".join(kept) + ("" if within else text[at:])


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
