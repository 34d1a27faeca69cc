"""The words that a command says stand on the thing it means, and whether what was read is those."""

import re
from dataclasses import dataclass

_NAMED = re.compile(
    r"\b(?:reads?|reading|says?|saying|marked|labell?ed|(?:licen[cs]e |number )?plate(?: number)?(?: is| reads?)?)"
    r"[:\s]+[\"'“‘]?([A-Z0-9][A-Z0-9]*(?:[ -][A-Z0-9]+)*)\b"
)
_PLATE = re.compile(r"\bplates?\b", re.IGNORECASE)
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
_PLACE = re.compile(rf"\b(?:(?P<nth>{'|'.join(_ORDINALS)})(?:\s+\w+)?\s+from the\s+)?(?P<side>left|right)(?:most)?\b")
_MOST = re.compile(r"\b(left|right)\s?-?most\b")

SURE = 0.90  # confidence of a reading that is believed; in benchmarks/reading.py every wrong one near by has less


@dataclass(frozen=True, slots=True)
class ReadText:
    """One text that was read."""

    text: str
    confidence: float  # 0 … 1


@dataclass(frozen=True, slots=True)
class Inscription:
    """What is to be read."""

    text: str  # capitals and digits alone
    on_plate: bool  # on a vehicle's plate rather than on a board


def named(command: str) -> Inscription | None:
    """Return what `command` says is written on its thing; None when it names no inscription."""
    found = _NAMED.findall(command)
    return Inscription(plain(found[-1]), bool(_PLATE.search(command))) if found else None


def place(command: str) -> int | None:
    """Return which one from the left a command means: 0, 1 … from the left, -1, -2 … from the right; None: any.

    'the second one from the left' is 1, 'the rightmost' is -1.
    """
    text = command.lower()
    most = _MOST.search(text)
    if most:
        return 0 if most[1] == "left" else -1
    for match in _PLACE.finditer(text):
        if match["nth"]:
            n = _ORDINALS.index(match["nth"])
            return n if match["side"] == "left" else -1 - n
    return None


def plain(text: str) -> str:
    """Return the capitals and digits of a text, nothing between them."""
    return "".join(letter for letter in text.upper() if letter.isascii() and letter.isalnum())


def agrees(wanted: Inscription, readings: list[ReadText]) -> bool | None:
    """Return whether the thing is the named one: True or False when that was read surely, None when it is not known.

    A text that differs in one letter of four or more is not taken for another one unless it was read very surely: a
    letter may be misread, and to leave the named thing is worse than to look again.
    """
    if any(plain(r.text) == wanted.text and r.confidence >= SURE for r in readings):
        return True
    for reading in readings:
        text = plain(reading.text)
        if reading.confidence >= SURE and len(text) == len(wanted.text) and text.isdigit() == wanted.text.isdigit():
            return False
        if reading.confidence >= SURE and not wanted.on_plate and len(text) >= 3:
            return False
    return None
