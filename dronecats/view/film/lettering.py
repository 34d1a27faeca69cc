"""Writes text on pictures, in a font from matplotlib."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dronecats.report.kit import palette

Ink = tuple[int, int, int]  # RGB
Picture = NDArray[np.uint8]

WHITE, PALE, GREY, YELLOW = (245, 246, 244), (203, 207, 210), (150, 156, 162), (255, 230, 0)
GREEN, RED, MAGENTA = (46, 214, 90), (255, 92, 80), (255, 70, 220)
DRONES = tuple(map(palette.rgb, ("#ffb000", "#3fa7ff", "#ff5c8a", "#b48cff", "#00d0a0", "#ff7a1a")))
BACKGROUND: Ink = (20, 23, 27)


def write(picture: Picture, text: str, at: tuple[int, int], size_px: int, color: Ink = WHITE, bold: bool = False,
          right: bool = False) -> int:  # fmt: skip
    """Write a line of text on a picture, and return its width in px. Text beyond an edge of the picture is cut off.

    `at` (x, y) is the line's top left corner, or its top right corner if `right`.
    """
    mask = _mask(text, size_px, bold)
    x, y = (at[0] - mask.shape[1], at[1]) if right else at
    left, top = max(0, -x), max(0, -y)
    under = picture[y + top : y + mask.shape[0], x + left : x + mask.shape[1]]
    share = mask[top : top + under.shape[0], left : left + under.shape[1], None].astype(np.uint16)
    under[:] = (under * (255 - share) + np.array(color, np.uint16) * share) // 255
    return int(mask.shape[1])


def color_of(drone: int) -> Ink:
    return DRONES[drone % len(DRONES)]


def width_px(text: str, size_px: int, bold: bool = False) -> int:
    return int(_font(size_px, bold).getlength(text)) + 1


def fitted(text: str, size_px: int, room_px: int, lines: int = 1, bold: bool = False) -> list[str]:
    """Return a text wrapped to at most `lines` lines of `room_px`. A text that does not fit ends in …"""
    fitting = [""]
    words: Sequence[str] = text.split()
    for number, word in enumerate(words):
        longer = f"{fitting[-1]} {word}".strip()
        if width_px(longer, size_px, bold) <= room_px or not fitting[-1]:
            fitting[-1] = longer
        elif len(fitting) < lines:
            fitting.append(word)
        else:
            fitting[-1] = f"{fitting[-1]} {' '.join(words[number:])}"
            break
    *complete, last = fitting
    if width_px(last, size_px, bold) > room_px:
        while last and width_px(last + "…", size_px, bold) > room_px:
            last = last[:-1]
        last = last.rstrip() + "…"
    return [*complete, last]


def plate(picture: Picture, left: int, top: int, width: int, height: int, share: float = 0.6) -> None:
    """Mix a rectangle with `share` of the dark background colour, so that text on it is readable."""
    part = picture[max(0, top) : top + height, max(0, left) : left + width]
    part[:] = (part * (1.0 - share) + np.array(BACKGROUND) * share).astype(np.uint8)


@lru_cache(512)
def _mask(text: str, size_px: int, bold: bool) -> NDArray[np.uint8]:
    font = _font(size_px, bold)
    page = Image.new("L", (max(1, int(font.getlength(text)) + 1), int(1.3 * size_px) + 1))
    ImageDraw.Draw(page).text((0, 0), text, 255, font)
    return np.asarray(page)


@lru_cache(32)
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    import matplotlib

    face = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / face), size_px)
