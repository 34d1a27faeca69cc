"""Boards on two posts, whatever their paint: a plain rectangle about the horizon, and two thin legs below it.

Assumed knowledge: a notice board is about 0.86 m high with its frame, stands 0.72 m above the ground, and is up to
1.3 m wide; its posts stand a little inside its sides. A board's height looks the same from every side, so it tells the
distance; its width tells how far from square one looks at it.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision.paint import Mask, Picture

HEIGHT_M, WIDTH_M, FOOT_M = 0.86, 1.26, 0.72  # of a board with its frame; its lower edge above the ground
_STEP = 8  # levels between thresholds
_TOLERANCES = (6.0, 9.0, 13.0, 18.0, 24.0, 32.0)  # of one paint, in sun and shade and across its letters
_LEAST_PX = (4, 5)  # width and height of what can be a board
_FARTHEST_M = 48.0
_WIDEST = 1.75  # times its height: a long word makes a longer board
_FILLED = 0.5  # of its rectangle at least; the rest is letters
_TOP = (-0.7, 1.25)  # its upper edge below the horizon, in heights of its own: eyes are 1 … 2.4 m high, bodies pitch
_BAND_FROM = 0.3  # of the picture's height: boards stand below this row
_SAME = 0.5  # overlap above which two rectangles are one thing
_POST = 0.73  # of half the width: where the posts stand
_POST_OFF = 14.0  # grey levels, darker or lighter than the ground between them
_POST_FROM, _POST_TO = 0.15, 0.72  # rows that are looked at, heights of the board below its lower edge


Color = tuple[float, float, float]  # CIE Lab as OpenCV has it in 8 bits
_Box = tuple[int, int, int, int]  # left, top, right, bottom, px


@dataclass(frozen=True, slots=True)
class NoticeBoard:
    """A board as it stands in the picture."""

    left: int  # px, as right, top and bottom
    top: int
    right: int
    bottom: int
    depth_m: float  # along the optical axis
    color: Color  # of its face

    @property
    def middle(self) -> float:
        """px, its column."""
        return 0.5 * (self.left + self.right)


def find(picture: Picture) -> list[NoticeBoard]:
    """Return the boards in a BGR picture (H, W, 3), of any paint, left to right."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    masks = []
    for channel in range(3):
        band = _band(lab)[:, :, channel]
        low, high = (int(v) for v in np.percentile(band, (0.05, 99.95)))
        for level in range(low + _STEP // 2, high, _STEP):
            masks += [band > level, band <= level]
    return _among(picture, lab, masks)


def find_like(picture: Picture, color: Color) -> list[NoticeBoard]:
    """Return the boards of one paint, left to right: more of them than `find` does, and no others."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    away = difference(_band(lab).astype(np.float32), color)
    return _among(picture, lab, [away < limit for limit in _TOLERANCES])


def difference(lab: NDArray[np.float32], color: Color) -> NDArray[np.float32]:
    """Return how far colours (…, 3) in Lab are from one, lightness counted half: it changes from sun to shade."""
    away = (lab - np.array(color, np.float32)) * np.array((0.5, 1.0, 1.0), np.float32)
    return np.asarray(np.sqrt((away**2).sum(axis=-1)), np.float32)


def _band(lab: Picture) -> Picture:
    return lab[round(_BAND_FROM * lab.shape[0]) :]


def _among(picture: Picture, lab: Picture, masks: list[Mask]) -> list[NoticeBoard]:
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    boxes: set[_Box] = set()
    for mask in masks:
        boxes.update(_rectangles(mask, lab.shape[0]))
    standing = [box for box in sorted(boxes) if _on_posts(grey, box)]
    return sorted((_board(lab, group) for group in _grouped(standing)), key=lambda b: (b.middle, b.top))


def _rectangles(mask: Mask, height: int) -> list[_Box]:
    """Return what is a filled rectangle of a board's shape and stand in a mask of the lower part of the picture."""
    width = mask.shape[1]
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)[2][1:]
    x, y, w, h, area = stats.T
    y = y + height - mask.shape[0]
    fits = (w >= _LEAST_PX[0]) & (h >= _LEAST_PX[1]) & (w <= _WIDEST * h) & (x > 0) & (x + w < width)
    fits &= (0.5 * width * HEIGHT_M < _FARTHEST_M * h) & (area >= _FILLED * w * h)
    fits &= (y - 0.5 * height >= _TOP[0] * h) & (y - 0.5 * height <= _TOP[1] * h)
    return [(int(x[k]), int(y[k]), int(x[k] + w[k]), int(y[k] + h[k])) for k in np.flatnonzero(fits)]


def _grouped(boxes: list[_Box]) -> list[list[_Box]]:
    """Return the boxes in groups that overlap by half: one thing at several thresholds."""
    groups: list[list[_Box]] = []
    for box in sorted(boxes, key=lambda b: -(b[2] - b[0]) * (b[3] - b[1])):
        for group in groups:
            if _overlap(group[0], box) > _SAME:
                group.append(box)
                break
        else:
            groups.append([box])
    return groups


def _overlap(one: _Box, other: _Box) -> float:
    """Return what two boxes share, of the smaller of them."""
    w = min(one[2], other[2]) - max(one[0], other[0])
    h = min(one[3], other[3]) - max(one[1], other[1])
    least = min((b[2] - b[0]) * (b[3] - b[1]) for b in (one, other))
    return max(0, w) * max(0, h) / least


def _board(lab: Picture, group: list[_Box]) -> NoticeBoard:
    left, top, right, bottom = (round(float(v)) for v in np.median(np.array(group), axis=0))
    face = lab[top:bottom, left:right].reshape(-1, 3)
    color = np.median(face, axis=0)
    depth = 0.5 * lab.shape[1] * HEIGHT_M / (bottom - top)
    return NoticeBoard(left, top, right, bottom, depth, (float(color[0]), float(color[1]), float(color[2])))


def _on_posts(grey: NDArray[np.float32], box: _Box) -> bool:
    """Return whether two posts stand below a board, both darker or both lighter than the ground between them."""
    left, top, right, bottom = box
    h = bottom - top
    first, last = bottom + math.ceil(_POST_FROM * h), bottom + math.floor(_POST_TO * h)
    if last > grey.shape[0]:
        last = grey.shape[0]
    if last - first < 2:
        return False
    columns = np.median(grey[first:last, max(0, left - 2) : right + 2], axis=0)
    at = np.arange(len(columns)) + max(0, left - 2) + 0.5
    off = (at - 0.5 * (left + right)) / (0.5 * (right - left))
    between = columns[np.abs(off) < 0.4]
    sides = [columns[np.abs(off - side * _POST) < max(0.25, 2.5 / (right - left))] for side in (-1, 1)]
    if not len(between) or any(not len(s) for s in sides):
        return False
    ground = float(np.median(between))
    darker = all(float(s.min()) < ground - _POST_OFF for s in sides)
    return darker or all(float(s.max()) > ground + _POST_OFF for s in sides)
