"""Parses the target of a command: colour and kind, place beside a landmark, inscription, and place in a row."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from dronecats.pilots.actions import ORDINALS

COLORS: dict[str, str] = {
    "red": "red", "crimson": "red", "scarlet": "red", "maroon": "red",
    "orange": "orange", "amber": "orange",
    "yellow": "yellow", "gold": "yellow", "golden": "yellow",
    "green": "green", "lime": "green",
    "cyan": "cyan", "turquoise": "cyan", "teal": "cyan", "aqua": "cyan",
    "blue": "blue", "navy": "blue",
    "purple": "purple", "violet": "purple", "lilac": "purple",
    "magenta": "magenta", "fuchsia": "magenta", "pink": "pink",
    "white": "white", "black": "black", "grey": "grey", "gray": "grey", "silver": "grey",
    "brown": "brown", "beige": "brown", "tan": "brown",
}  # fmt: skip
"""Colour word → the colour in `colors.BANDS`."""


@dataclass(frozen=True, slots=True)
class Size:
    """The usual outer size of a kind of thing, and the heights of its painted body."""

    length_m: float
    width_m: float
    height_m: float
    paint_from_m: float  # m above ground, lower edge of the painted body
    paint_to_m: float  # m above ground, upper edge of the painted body
    outline: str = ""  # key of the kind in outlines.npz; '' for a kind without an outline


# Ordinary European and North American vehicles, rounded; a roof is painted, the sill and the wheels are not.
_SUV = Size(4.7, 1.9, 1.72, 0.42, 1.72, "suv")
_CAR = Size(4.6, 1.8, 1.46, 0.36, 1.46, "sedan")
_HATCHBACK = replace(_CAR, outline="hatchback")
_PICKUP = Size(5.5, 2.0, 1.85, 0.52, 1.85, "pickup")
_VAN = Size(5.3, 2.0, 2.1, 0.42, 2.1, "van")
_TRUCK = Size(7.5, 2.4, 3.2, 0.6, 3.2)
_BUS = Size(10.4, 2.5, 3.1, 0.4, 2.9, "bus")
_MOTORCYCLE = Size(2.4, 1.1, 1.88, 0.4, 1.88, "motorcycle")
_CYCLIST = Size(1.74, 0.64, 1.77, 0.3, 1.75, "cyclist")
_QUADROTOR = Size(2.7, 2.7, 2.03, 0.12, 1.84, "quadrotor")
_PERSON = Size(0.45, 0.5, 1.75, 0.9, 1.5)  # a coloured garment covers the trunk
_HOUSE = Size(12.0, 10.0, 6.5, 0.3, 6.5)

SIZES: dict[str, Size] = {
    "suv": _SUV, "jeep": _SUV, "crossover": _SUV, "off-roader": _SUV,
    "sedan": _CAR, "car": _CAR, "hatchback": _HATCHBACK, "taxi": _CAR, "cab": _CAR, "coupe": _CAR, "vehicle": _CAR,
    "automobile": _CAR, "wagon": _CAR,
    "pickup": _PICKUP, "pick-up": _PICKUP, "pickup truck": _PICKUP, "pick-up truck": _PICKUP,
    "van": _VAN, "minivan": _VAN, "delivery van": _VAN, "ambulance": _VAN,
    "truck": _TRUCK, "lorry": _TRUCK, "bus": _BUS, "coach": _BUS, "school bus": _BUS,
    "motorcycle": _MOTORCYCLE, "motorbike": _MOTORCYCLE, "scooter": _MOTORCYCLE,
    "bicycle": _MOTORCYCLE, "bike": _MOTORCYCLE, "cyclist": _CYCLIST,
    "person": _PERSON, "man": _PERSON, "woman": _PERSON, "pedestrian": _PERSON, "child": Size(0.3, 0.4, 1.2, 0.6, 1.0),
    "bench": Size(1.8, 0.6, 0.85, 0.35, 0.85), "chair": Size(0.6, 0.6, 0.9, 0.3, 0.9),
    "trash can": Size(0.6, 0.6, 1.0, 0.05, 1.0), "bin": Size(0.6, 0.6, 1.0, 0.05, 1.0),
    "mailbox": Size(0.5, 0.3, 1.2, 0.9, 1.2), "sign": Size(0.1, 1.0, 2.0, 1.2, 2.0),
    "ball": Size(0.6, 0.6, 0.6, 0.0, 0.6), "box": Size(1.0, 1.0, 1.0, 0.0, 1.0), "cube": Size(1.0, 1.0, 1.0, 0.0, 1.0),
    "barrel": Size(0.6, 0.6, 0.9, 0.0, 0.9), "cone": Size(0.3, 0.3, 0.6, 0.0, 0.6),
    "drone": Size(0.6, 0.6, 0.25, 0.05, 0.25), "quadrotor": _QUADROTOR,
    "house": _HOUSE, "building": _HOUSE,
}  # fmt: skip
"""Noun → usual size."""


@dataclass(frozen=True, slots=True)
class Referent:
    """The thing that a command names, by colour and size."""

    color: str | None  # a value of COLORS; None: the command has no colour word
    size: Size  # of the named kind; of a car if the command has no noun of SIZES


def _alternatives(words: Iterable[str]) -> str:
    return "|".join(re.escape(w) for w in sorted(words, key=lambda w: (-len(w), w)))


_COLOR_WORD = re.compile(rf"\b({_alternatives(COLORS)})(?:s|es)?\b")
_SIZED_NOUN = re.compile(rf"\b({_alternatives(SIZES)})(?:s|es)?\b")


def read_referent(command: str) -> Referent:
    """Return the first noun of SIZES that follows a colour word, and the colour word nearest before it.

    'the red car parked by the white house' → red car. Without such a pair: the first colour word and the first noun.
    Without a noun: the size of a car.
    """
    text = command.lower()
    nouns = list(_SIZED_NOUN.finditer(text))
    colors = list(_COLOR_WORD.finditer(text))
    for noun in nouns:
        before = [c for c in colors if c.end() <= noun.start()]
        if before:
            return Referent(COLORS[before[-1][1]], SIZES[noun[1]])
    color = COLORS[colors[0][1]] if colors else None
    return Referent(color, SIZES[nouns[0][1]] if nouns else _CAR)


NEAREST, LEFT, RIGHT, BEFORE, BEHIND, BETWEEN = "nearest", "left of", "right of", "in front of", "behind", "between"

_RELATIONS: dict[str, str] = {
    "nearest to": NEAREST, "nearest": NEAREST, "closest to": NEAREST, "next to": NEAREST, "beside": NEAREST,
    "near": NEAREST, "by": NEAREST, "to the left of": LEFT, "on the left of": LEFT, "left of": LEFT,
    "to the right of": RIGHT, "on the right of": RIGHT, "right of": RIGHT, "in front of": BEFORE, "before": BEFORE,
    "behind": BEHIND, "between": BETWEEN,
}  # fmt: skip
"""Words → relation."""

KIND_OF_NOUN: dict[str, str] = {
    "bench": "bench", "bike rack": "bike-rack", "bicycle rack": "bike-rack", "bin": "bin", "trash can": "bin",
    "bollard": "bollard", "clock tower": "clock-tower", "delivery robot": "delivery-robot", "robot": "delivery-robot",
    "fountain": "fountain", "fountain with three bowls": "tiered-fountain", "kiosk": "kiosk", "lamp": "lamp",
    "street lamp": "lamp", "notice board": "notice-board", "noticeboard": "notice-board", "person": "person",
    "pedestrian": "person", "man": "person", "woman": "person", "picnic table": "picnic-table", "planter": "planter",
    "service cart": "service-cart", "cart": "service-cart", "statue": "statue", "vending machine": "vending-machine",
}  # fmt: skip
"""Noun → kind in `shape_detector.KINDS`."""


_EXPRESSION = re.compile(rf"\bthe ({_alternatives(KIND_OF_NOUN)}) ({_alternatives(_RELATIONS)}) (.+)", re.IGNORECASE)
_LANDMARK = re.compile(rf"(?:the )?({_alternatives(KIND_OF_NOUN)})\b", re.IGNORECASE)
_SEARCH_VERB = re.compile(r"\b(?:find|locate|look|search|seek)\b", re.IGNORECASE)
_CLAUSE_END = re.compile(
    r"(?:,| and (?:go|get|fly|approach|reach|catch|follow|close|come)\b| until\b|[.;!?]).*", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class PlaceExpression:
    """A target that is named by its place: "the NOUN RELATION LANDMARK". The relation BETWEEN has two landmarks."""

    kind: str  # one of `shape_detector.KINDS`
    relation: str  # NEAREST, LEFT, RIGHT, BEFORE, BEHIND or BETWEEN
    # kind of each landmark, like `kind`; None: a thing that the detector cannot find, such as a hall
    landmarks: tuple[str | None, ...]
    needs_search: bool = False  # the command has a search verb, so the target is not in the first picture


def read_place_expression(command: str) -> PlaceExpression | None:
    """Return the command's place expression; None if it has none, or an unknown noun. Never raises."""
    match = _EXPRESSION.search(command)
    if match is None:
        return None
    relation = _RELATIONS[match[2].lower()]
    rest = _CLAUSE_END.sub("", match[3]).strip()
    landmarks = re.split(r" and (?=the\b|[A-Z])", rest, maxsplit=1) if relation == BETWEEN else [rest]
    if relation == BETWEEN and len(landmarks) < 2:
        return None
    needs_search = _SEARCH_VERB.search(command[: match.start()]) is not None
    return PlaceExpression(
        KIND_OF_NOUN[match[1].lower()], relation, tuple(map(_landmark_kind, landmarks)), needs_search
    )


def _landmark_kind(words: str) -> str | None:
    match = _LANDMARK.fullmatch(words)
    return KIND_OF_NOUN[match[1].lower()] if match else None


_INSCRIPTION = re.compile(
    r"\b(?:reads?|reading|says?|saying|marked|labell?ed|(?:licen[cs]e |number )?plate(?: number)?(?: is| reads?)?)"
    r"[:\s]+[\"'“‘]?([A-Z0-9][A-Z0-9]*(?:[ -][A-Z0-9]+)*)\b"
)
_PLATE = re.compile(r"\bplates?\b", re.IGNORECASE)
_ORDINAL_PLACE = re.compile(
    rf"\b(?:(?P<nth>{'|'.join(ORDINALS)})(?:\s+\w+)?\s+from the\s+)?(?P<side>left|right)(?:most)?\b"
)
_OUTERMOST = re.compile(r"\b(left|right)\s?-?most\b")


@dataclass(frozen=True, slots=True)
class Inscription:
    """The text on the target."""

    text: str  # only letters and digits, as `plain_text` returns
    on_plate: bool  # True: on a vehicle's plate; False: on a board


def read_inscription(command: str) -> Inscription | None:
    """Return the inscription that a command names; None if it names none."""
    texts = _INSCRIPTION.findall(command)
    return Inscription(plain_text(texts[-1]), bool(_PLATE.search(command))) if texts else None


def read_place_in_row(command: str) -> int | None:
    """Return the target's index in a row: 0, 1 … from the left, -1, -2 … from the right; None if no place is named.

    'the second one from the left' is 1, 'the rightmost' is -1.
    """
    text = command.lower()
    outermost = _OUTERMOST.search(text)
    if outermost:
        return 0 if outermost[1] == "left" else -1
    for match in _ORDINAL_PLACE.finditer(text):
        if match["nth"]:
            n = ORDINALS.index(match["nth"])
            return n if match["side"] == "left" else -1 - n
    return None


def plain_text(text: str) -> str:
    """Return the ASCII letters (in upper case) and digits of a text."""
    return "".join(letter for letter in text.upper() if letter.isascii() and letter.isalnum())
