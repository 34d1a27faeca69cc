"""Paints a person would name, and the plain materials that assets share."""

from functools import cache

from episodes.maps.scene import Material
from foundation.errors import UsageError
from foundation.frames import Vec3

# sRGB as a colour picker shows them: far enough apart to be named without doubt.
PAINTS: dict[str, tuple[int, int, int]] = {
    "cyan": (0, 205, 220),
    "red": (200, 18, 24),
    "yellow": (245, 205, 10),
    "orange": (240, 110, 10),
    "blue": (20, 60, 190),
    "green": (20, 140, 50),
    "purple": (110, 35, 150),
    "pink": (240, 110, 170),
    "brown": (95, 58, 34),
    "white": (228, 230, 230),
    "silver": (166, 170, 174),
    "grey": (98, 102, 106),
    "black": (22, 23, 25),
}
NEUTRAL = ("white", "silver", "grey", "black")  # what parked vehicles wear, so that a target's colour stays its own


def linear(srgb: tuple[int, int, int]) -> Vec3:
    """Return an 8-bit sRGB colour as linear reflectance, 0 … 1 (IEC 61966-2-1)."""

    def channel(value: int) -> float:
        v = value / 255.0
        return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4

    return (channel(srgb[0]), channel(srgb[1]), channel(srgb[2]))


@cache
def paint(name: str) -> Material:
    """Return a car paint. Raises UsageError for a name that is not in PAINTS."""
    if name not in PAINTS:
        raise UsageError(f"paint '{name}' is not known: use one of {', '.join(PAINTS)}.")
    return Material(f"paint-{name}", linear(PAINTS[name]), specular=0.55)


@cache
def plain(name: str, srgb: tuple[int, int, int], specular: float = 0.0, emission: float = 0.0) -> Material:
    """Return an untextured material; the same arguments give the same object."""
    return Material(name, linear(srgb), specular=specular, emission=emission)


GLASS = plain("glass", (26, 34, 42), 0.9)
WINDOW = plain("window", (52, 66, 80), 0.9)
RUBBER = plain("rubber", (26, 26, 27), 0.05)
TRIM = plain("trim", (42, 43, 45), 0.15)
SHADOW = plain("wheel-housing", (9, 9, 10))
CHROME = plain("chrome", (200, 203, 207), 0.8)
RIM = plain("rim", (172, 175, 180), 0.6)
HEADLAMP = plain("headlamp", (236, 240, 244), 0.9, 0.15)
TAIL_LAMP = plain("tail-lamp", (170, 10, 14), 0.7, 0.12)
INDICATOR = plain("indicator", (228, 120, 20), 0.5, 0.08)
WHITE_WOOD = plain("white-wood", (232, 231, 226), 0.05)
STEEL = plain("steel", (90, 94, 98), 0.3)
