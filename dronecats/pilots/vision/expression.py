"""A thing told by where it stands: "the bench left of the fountain", read out of a command.

expression = the NOUN RELATION LANDMARK [and LANDMARK]
"""

import re
from dataclasses import dataclass

NEAREST, LEFT, RIGHT, BEFORE, BEHIND, BETWEEN = "nearest", "left of", "right of", "in front of", "behind", "between"

_RELATIONS: dict[str, str] = {
    "nearest to": NEAREST, "nearest": NEAREST, "closest to": NEAREST, "next to": NEAREST, "beside": NEAREST,
    "near": NEAREST, "by": NEAREST, "to the left of": LEFT, "on the left of": LEFT, "left of": LEFT,
    "to the right of": RIGHT, "on the right of": RIGHT, "right of": RIGHT, "in front of": BEFORE, "before": BEFORE,
    "behind": BEHIND, "between": BETWEEN,
}  # fmt: skip
"""How a relation is said → which it is."""

NOUNS: dict[str, str] = {
    "bench": "bench", "bike rack": "bike-rack", "bicycle rack": "bike-rack", "bin": "bin", "trash can": "bin",
    "bollard": "bollard", "clock tower": "clock-tower", "delivery robot": "delivery-robot", "robot": "delivery-robot",
    "fountain": "fountain", "fountain with three bowls": "tiered-fountain", "kiosk": "kiosk", "lamp": "lamp",
    "street lamp": "lamp", "notice board": "notice-board", "noticeboard": "notice-board", "person": "person",
    "pedestrian": "person", "man": "person", "woman": "person", "picnic table": "picnic-table", "planter": "planter",
    "service cart": "service-cart", "cart": "service-cart", "statue": "statue", "vending machine": "vending-machine",
}  # fmt: skip
"""What people call the things that `shapes` knows → their kind."""


def _any(words: dict[str, str]) -> str:
    return "|".join(re.escape(w) for w in sorted(words, key=lambda w: (-len(w), w)))


_HEAD = re.compile(rf"\bthe ({_any(NOUNS)}) ({_any(_RELATIONS)}) (.+)", re.IGNORECASE)
_KNOWN = re.compile(rf"(?:the )?({_any(NOUNS)})\b", re.IGNORECASE)
_SOUGHT = re.compile(r"\b(?:find|locate|look|search|seek)\b", re.IGNORECASE)
_ENDS = re.compile(
    r"(?:,| and (?:go|get|fly|approach|reach|catch|follow|close|come)\b| until\b|[.;!?]).*", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class ToldBy:
    """What a thing is told by."""

    words: str  # as it was said, without the article
    kind: str | None  # of `shapes.KINDS`; None: nothing whose shape is known, as a hall


@dataclass(frozen=True, slots=True)
class ToldByPlace:
    """A kind of thing in a relation to one landmark, or to two with BETWEEN."""

    kind: str  # of `shapes.KINDS`
    relation: str
    landmarks: tuple[ToldBy, ...]
    sought: bool = False  # to be looked for: it is not in sight at first


def read(command: str) -> ToldByPlace | None:
    """Return the expression in a command; None when it has none, or of a kind that is not known. Never raises."""
    found = _HEAD.search(command)
    if found is None:
        return None
    relation = _RELATIONS[found[2].lower()]
    rest = _ENDS.sub("", found[3]).strip()
    said = re.split(r" and (?=the\b|[A-Z])", rest, maxsplit=1) if relation == BETWEEN else [rest]
    if relation == BETWEEN and len(said) < 2:
        return None
    sought = _SOUGHT.search(command[: found.start()]) is not None
    return ToldByPlace(NOUNS[found[1].lower()], relation, tuple(_landmark(words) for words in said), sought)


def _landmark(words: str) -> ToldBy:
    known = _KNOWN.fullmatch(words)
    return ToldBy(re.sub(r"^the ", "", words, flags=re.IGNORECASE), NOUNS[known[1].lower()] if known else None)
