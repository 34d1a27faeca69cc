"""What the command speaks of: the colour and the kind of thing, and how large such a thing usually is."""

import re
from dataclasses import dataclass, replace

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
"""Colour word → the colour class that `paint` can look for."""


@dataclass(frozen=True, slots=True)
class Size:
    """The usual outer size of a kind of thing, and which of its heights carry the paint."""

    length_m: float
    width_m: float
    height_m: float
    paint_from_m: float  # m above ground, lower edge of the painted body
    paint_to_m: float  # m above ground, upper edge
    outline: str = ""  # the kind in outlines.npz, where the catalogue has it

    @property
    def paint_height_m(self) -> float:
        """m, the height of the painted part, the yardstick that looks the same from every side."""
        return self.paint_to_m - self.paint_from_m


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
    """The thing a command names, as far as a colour-and-size eye can use it."""

    color: str | None  # a value of COLORS; None: no colour word, so this pilot cannot tell the thing apart
    noun: str  # the key of SIZES that was found; 'thing' when none was
    size: Size


def _longest_first(words: dict[str, object]) -> re.Pattern[str]:
    ordered = sorted(words, key=lambda w: (-len(w), w))
    return re.compile(r"\b(" + "|".join(re.escape(w) for w in ordered) + r")(?:s|es)?\b")


_COLOR = _longest_first(dict(COLORS))
_NOUN = _longest_first(dict(SIZES))


def read(command: str) -> Referent:
    """Return what `command` names: its first noun that has a size, with the last colour word before it.

    'the red car parked by the white house' → red car. Without such a pair, the first colour word and noun there are.
    """
    text = command.lower()
    nouns = list(_NOUN.finditer(text))
    colors = list(_COLOR.finditer(text))
    for noun in nouns:
        before = [c for c in colors if c.end() <= noun.start()]
        if before:
            return Referent(COLORS[before[-1][1]], noun[1], SIZES[noun[1]])
    color = COLORS[colors[0][1]] if colors else None
    return Referent(color, nouns[0][1], SIZES[nouns[0][1]]) if nouns else Referent(color, "thing", _CAR)
