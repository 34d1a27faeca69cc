"""Number plates: small pale rectangles low on a vehicle, and what is written on them."""

from dataclasses import dataclass

import cv2
import numpy as np

from dronecats.pilots.vision import reading
from dronecats.pilots.vision.inscription import ReadText, plain
from dronecats.pilots.vision.paint import Mask, Picture

HEIGHT_M = 0.16  # of a plate; its digits are 0.10 m high
DIGITS = 4
_LEVELS = range(110, 250, 14)  # of lightness, at which a pale plate stands out from paint, lamps and shade
_DULL = 34.0  # distance from grey in Lab: a plate is white, an indicator is not
_SHAPE = (0.7, 4.6)  # width over height, from very aslant to square on
_LEAST_PX = (8, 4)  # width and height
_FILLED = 0.5  # of its rectangle; the rest is digits
_READABLE_PX = 9  # height of a plate whose digits are tried: 5.6 px high
_TRIED = 5
_SAME_PX = 3


@dataclass(frozen=True, slots=True)
class Plate:
    """A pale rectangle that may be a plate."""

    left: int  # px, as right, top and bottom
    top: int
    right: int
    bottom: int
    reading: ReadText | None  # None when nothing could be read on it

    @property
    def middle(self) -> float:
        """px, its column."""
        return 0.5 * (self.left + self.right)

    @property
    def text(self) -> str:
        """Return its capitals and digits."""
        return plain(self.reading.text) if self.reading else ""


def find(picture: Picture, box: tuple[int, int, int, int], height_px: float) -> Plate | None:
    """Return the plate of the vehicle that fills `box` (left, top, right, bottom, px): the one that reads best.

    `height_px` is how high a plate is about where the vehicle stands.
    """
    candidates = _pale(picture, box, height_px)[:_TRIED]
    best: Plate | None = None
    for left, top, right, bottom in candidates:
        plate = Plate(left, top, right, bottom, _read(picture, (left, top, right, bottom)))
        if best is None or _worth(plate) > _worth(best):
            best = plate
    return best if best is not None and (best.reading is not None or len(candidates) == 1) else None


def _worth(plate: Plate) -> tuple[bool, float]:
    digits = len(plate.text) == DIGITS and plate.text.isdigit()
    return digits, plate.reading.confidence if plate.reading else 0.0


def _pale(picture: Picture, box: tuple[int, int, int, int], height_px: float) -> list[tuple[int, int, int, int]]:
    """Return the rectangles that may be a plate, those of the likeliest height first."""
    height, width = picture.shape[:2]
    left, right = max(0, box[0] - 4), min(width, box[2] + 4)
    top, bottom = max(0, box[1] + (box[3] - box[1]) // 4), min(height, box[3] + max(4, (box[3] - box[1]) // 8))
    if right - left < _LEAST_PX[0] or bottom - top < _LEAST_PX[1]:
        return []
    lab = cv2.cvtColor(np.ascontiguousarray(picture[top:bottom, left:right]), cv2.COLOR_BGR2LAB).astype(np.float32)
    dull = np.hypot(lab[..., 1] - 128.0, lab[..., 2] - 128.0) < _DULL
    found: list[tuple[int, int, int, int]] = []
    for level in _LEVELS:
        for x0, y0, x1, y1 in _rectangles(dull & (lab[..., 0] > level), height_px):
            one = (x0 + left, y0 + top, x1 + left, y1 + top)
            if all(max(abs(a - b) for a, b in zip(one, other, strict=True)) > _SAME_PX for other in found):
                found.append(one)
    return sorted(found, key=lambda b: (abs(b[3] - b[1] - height_px), b))


def _rectangles(mask: Mask, height_px: float) -> list[tuple[int, int, int, int]]:
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)[2][1:]
    x, y, w, h, area = stats.T
    fits = (w >= _LEAST_PX[0]) & (h >= _LEAST_PX[1]) & (w >= _SHAPE[0] * h) & (w <= _SHAPE[1] * h)
    fits &= (h >= 0.45 * height_px) & (h <= 1.9 * height_px) & (area >= _FILLED * w * h)
    return [(int(x[k]), int(y[k]), int(x[k] + w[k]), int(y[k] + h[k])) for k in np.flatnonzero(fits)]


def _read(picture: Picture, box: tuple[int, int, int, int]) -> ReadText | None:
    left, top, right, bottom = box
    h, w = bottom - top, right - left
    if h < _READABLE_PX:
        return None
    part = picture[max(0, top - 1) : bottom + 1, max(0, left - 2) : right + 2]
    texts = reading.line(part, min(max(2.6 * h / w, 1.0), 3.0))
    return max(texts, key=lambda r: r.confidence) if texts else None
