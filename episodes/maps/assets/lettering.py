"""Draws plates and boards with capitals and digits of an exact height, and builds the sign that shows a board.

Letters are drawn OVERSAMPLED times larger, then averaged by area, so that strokes have an even width.
"""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.scene import Material, Mesh, Picture
from foundation.frames import Vec3

CAP_PX = 40  # height of a capital in all pictures of this module
CAP_SHARE = 0.625  # height of a capital, as a share of a plate's height
MARGIN_PX = 13  # free space left and right of the text on a plate
OVERSAMPLED = 4
STROKE = 0.17  # width, as a share of a capital's height; a wider stroke closes the holes of 8 and B in small pictures
SPACING = 0.19  # between letters, as a share of a capital's height
LEADING = 1.55  # distance between the lines of a sign, in heights of a capital
FONT = cv2.FONT_HERSHEY_SIMPLEX
ZERO_WIDTH = 0.86  # width of a zero / width of an O; a zero has no slash, which would make it look like an 8

LETTER_M = 0.136  # height of a sign's letters (paper, appendix "Maps and Episodes")
BOARD_M = (1.2, 0.8)  # least width and height of a sign's board
BOARD_FOOT_M = 0.75  # height of the board's lower edge above the ground
PAPER, INK = (242, 242, 238), (24, 26, 30)


def _drawn(text: str, scale: float) -> NDArray[np.uint8]:
    """Return a text on a black canvas, 3 capitals high and as wide as the text. The baseline is 2 capitals down."""
    cap, thick = CAP_PX * OVERSAMPLED, round(STROKE * CAP_PX * OVERSAMPLED)
    image = np.zeros((3 * cap, 4 * cap), np.uint8)
    cv2.putText(image, text, (cap, 2 * cap), FONT, scale, 255, thick, cv2.LINE_AA)
    inked = np.flatnonzero(image.max(axis=0) > 127)
    return image[:, inked[0] : inked[-1] + 1]


@cache
def _measure() -> tuple[float, int]:
    """Return the font scale at which an H is exactly CAP_PX · OVERSAMPLED high, and the top row of the H."""
    cap, scale = CAP_PX * OVERSAMPLED, 5.0
    for _ in range(8):
        rows = np.flatnonzero(_drawn("H", scale).max(axis=1) > 127)
        scale *= cap / len(rows)
    return scale, int(rows[0])


@cache
def _glyph(letter: str) -> NDArray[np.uint8]:
    """Return one letter (cap, W), oversampled. A Q is compressed to the height of a capital, tail included."""
    cap = CAP_PX * OVERSAMPLED
    if letter == " ":
        return np.zeros((cap, round(0.36 * cap)), np.uint8)
    scale, top = _measure()
    shape = _drawn("O" if letter == "0" else letter, scale)
    if letter == "Q":
        rows = np.flatnonzero(shape.max(axis=1) > 127)
        shape = cv2.resize(shape[rows[0] : rows[-1] + 1], (shape.shape[1], cap), interpolation=cv2.INTER_AREA)
    else:
        shape = shape[top : top + cap]
    if letter == "0":
        shape = cv2.resize(shape, (round(shape.shape[1] * ZERO_WIDTH), cap), interpolation=cv2.INTER_AREA)
    return np.asarray(shape, np.uint8)


@cache
def line(text: str) -> NDArray[np.float32]:
    """Return the ink coverage (CAP_PX, W), 0 … 1, of one line of text, cropped to its letters.

    Capitals and digits fill the height exactly.
    """
    cap = CAP_PX * OVERSAMPLED
    gap = np.zeros((cap, round(SPACING * cap)), np.uint8)
    pieces = [piece for letter in text for piece in (_glyph(letter), gap)][:-1]
    image = np.concatenate(pieces, axis=1)
    width = -(-image.shape[1] // OVERSAMPLED)
    image = np.pad(image, ((0, 0), (0, width * OVERSAMPLED - image.shape[1])))
    small = cv2.resize(image, (width, CAP_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(small / np.float32(255.0), np.float32)


def _printed(shape: tuple[int, int], lines: tuple[str, ...], ink: Vec3, ground: Vec3) -> Picture:
    """Return a picture (H, W, 3) sRGB with centred lines of text."""
    cover = np.zeros(shape, np.float32)
    step = round(LEADING * CAP_PX)
    top = (shape[0] - CAP_PX - step * (len(lines) - 1)) // 2
    for k, text in enumerate(lines):
        mask = line(text)
        left = (shape[1] - mask.shape[1]) // 2
        cover[top + k * step : top + k * step + CAP_PX, left : left + mask.shape[1]] = mask
    mixed = cover[..., None] * np.array(ink) + (1.0 - cover[..., None]) * np.array(ground)
    return np.asarray(np.round(mixed), np.uint8)


@cache
def plate(text: str, ink: Vec3 = (18, 24, 70), ground: Vec3 = (240, 240, 234)) -> Picture:
    """Return (H, W, 3): one framed line of text; capitals have CAP_SHARE of the height."""
    height = round(CAP_PX / CAP_SHARE)
    image = _printed((height, line(text).shape[1] + 2 * MARGIN_PX), (text,), ink, ground)
    cv2.rectangle(image, (0, 0), (image.shape[1] - 1, height - 1), ink, 2)
    return image


@cache
def board(text: str, ink: Vec3, ground: Vec3, least_px: tuple[int, int]) -> Picture:
    """Return (H, W, 3): a text on as many lines as it needs; the picture is at least `least_px` (height, width)."""
    room = least_px[1] - CAP_PX
    lines: list[str] = []
    for word in text.split():
        if lines and line(f"{lines[-1]} {word}").shape[1] <= room:
            lines[-1] = f"{lines[-1]} {word}"
        else:
            lines.append(word)
    wide = max([least_px[1], *(line(text).shape[1] + CAP_PX for text in lines)])
    high = max(least_px[0], round(LEADING * CAP_PX * len(lines)) + CAP_PX // 2)
    return _printed((high, wide), tuple(lines), ink, ground)


def contrasting(paint: str) -> tuple[int, int, int]:
    """Return the ink that reads best on a paint: near black or near white."""
    materials.paint(paint)  # raises UsageError for an unknown paint
    r, g_, b = materials.linear(materials.PAINTS[paint])
    return INK if 0.2126 * r + 0.7152 * g_ + 0.0722 * b > 0.25 else PAPER


@cache
def sign(paint: str, text: str) -> Mesh:
    """Return a painted board on two posts, with `text` on both faces in letters LETTER_M high.

    Raises UsageError for an unknown paint.
    """
    per_px = LETTER_M / CAP_PX
    least = (round(BOARD_M[1] / per_px), round(BOARD_M[0] / per_px))
    ink = contrasting(paint)
    srgb = materials.PAINTS[paint]
    picture = board(text, ink, srgb, least)
    face = Material(f"sign-{paint}-{text}", (1.0, 1.0, 1.0), picture, specular=0.05)
    shell = Material(f"paint-{paint}", materials.linear(srgb), specular=0.05)
    high, wide = picture.shape[0] * per_px, picture.shape[1] * per_px / 2
    low, x = BOARD_FOOT_M, 0.026
    solids = [
        g.box((-0.025, -wide - 0.03, low - 0.03), (0.025, wide + 0.03, low + high + 0.03), shell),
        g.panel(x, (-wide, wide), (low, low + high), face),
        g.panel(-x, (wide, -wide), (low, low + high), face),
    ]
    for s in (-1, 1):
        y = s * (wide - 0.14)
        solids.append(g.box((-0.024, y - 0.04, 0.0), (0.024, y + 0.04, low), materials.STEEL))
        solids.append(g.box((-0.22, y - 0.07, 0.0), (0.22, y + 0.07, 0.03), materials.STEEL))
        solids.append(g.rod((0.20, y, 0.02), (-0.02, y, low - 0.02), (0.018, 0.018), materials.STEEL, 6))
    return g.assemble(solids)
