"""Codes of the mends (corrections) of the lenient parser, and what each corrects. decisions.jsonl has the codes."""

import re
from collections.abc import Collection, Iterable
from typing import Literal

from dronecats.agent.reply.strict import JsonSpan

Mend = Literal[
    "prose", "fence", "array", "several", "reasoning",
    "trailing_comma", "missing_comma", "comment", "single_quotes", "smart_quotes", "unquoted",
    "python", "full_width", "whitespace", "control", "number_form", "escaped", "truncated",
    "number_text", "unit", "name", "field", "implied", "action_key", "nested", "tool_call", "wrapped",
    "point_form", "box",
    "nested_array", "one_fits", "by_name", "zero_based", "keyed", "lines", "short", "extra",
]  # fmt: skip

# Deviations outside the answer. The strict parser tolerates these too.
TOLERATED: dict[Mend, str] = {
    "prose": "other text before or after",
    "fence": "a code fence",
    "array": "the single drone's object is in an array",
    "several": "several objects: the last with an action counts; in a fleet, several arrays: the first counts",
    "reasoning": "reasoning between marks, which is skipped",
}
# Deviations in the JSON syntax.
WRITTEN: dict[Mend, str] = {
    "trailing_comma": "a comma after the last member",
    "missing_comma": "no comma between two members",
    "comment": "a comment: //, /* */ or #",
    "single_quotes": "strings in single quotes",
    "smart_quotes": "strings in typographic quotes",
    "unquoted": "a key or a word without quotes",
    "python": "True, False or None, or a tuple",
    "full_width": "full-width digits or punctuation",
    "whitespace": "spaces that JSON does not allow",
    "control": "a line break or tab within a string",
    "number_form": "+5, .5, 5. or 045",
    "escaped": "JSON within a JSON string, or with its quotes escaped",
    "truncated": "the reply breaks off, but the action is complete",
}
# Deviations in the form of the action.
EXPRESSED: dict[Mend, str] = {
    "number_text": "a number as a string",
    "unit": "a number with its unit",
    "name": "another spelling of the action's name, or an unmistakable synonym",
    "field": "another name for a field",
    "implied": "no action is named, but only one action has these fields",
    "action_key": 'the action\'s name is the key: {"go": {…}}',
    "nested": "the fields are in a separate object",
    "tool_call": "the action is written as a tool call",
    "wrapped": "the action is inside another object, which has no other action",
    "point_form": "the point is not a pair: x and y by name, text, a tag, or a list in a list",
    "box": "a box instead of a point; its centre is the point",
}
# Deviations in the assignment of objects to the drones of a fleet.
DIVIDED: dict[Mend, str] = {
    "nested_array": "an extra array around the array, or around each object",
    "one_fits": "several arrays, of which only one has an object per drone",
    "by_name": "the objects name their drones, but are in another order, or some are missing",
    "zero_based": "the drones are counted from 0",
    "keyed": "an object with a drone's name as each key",
    "lines": "one object after the other, without an array",
    "short": "fewer objects than drones: the drones without an object hold",
    "extra": "more objects than drones: the extra objects are ignored",
}
MENDS: dict[Mend, str] = {**TOLERATED, **WRITTEN, **EXPRESSED, **DIVIDED}
_PLACE = {mend: place for place, mend in enumerate(MENDS)}


def in_order(mends: Collection[Mend]) -> tuple[Mend, ...]:
    """Return the codes without duplicates, in the order of MENDS."""
    return tuple(sorted(set(mends), key=_PLACE.__getitem__))


_FENCE = re.compile(r"(?:```|~~~)[ \t]*[\w-]*")


def around(text: str, spans: Iterable[JsonSpan]) -> set[Mend]:
    """Return the mends for the text around the values of a reply (in order): fence, array and prose."""
    pieces, at = [], 0
    for span in spans:
        pieces.append(text[at : span.begin])
        at = span.end
    pieces.append(text[at:])
    mends: set[Mend] = set()
    rest = "\0".join(pieces)
    bare = _FENCE.sub("", rest)
    if bare != rest:
        mends.add("fence")
    if bare.strip(" \t\r\n\0").startswith("[") and bare.strip(" \t\r\n\0").endswith("]"):
        mends.add("array")
        bare = bare.replace("[", "").replace("]", "").replace(",", "")
    if bare.strip(" \t\r\n\0"):
        mends.add("prose")
    return mends
