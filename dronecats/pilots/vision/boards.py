"""Finds notice boards of any paint, and chooses the actions of a drone whose goal is a notice board.

A board is a plain rectangle near the horizon with two thin posts below it. Assumed dimensions: with its frame, a board
is about 0.86 m high and up to 1.3 m wide; its lower edge is 0.72 m above the ground; its posts stand a little inside
its sides. The apparent height does not depend on the viewing angle, so it gives the distance. The apparent width gives
the viewing angle.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots import actions
from dronecats.pilots.vision import ocr
from dronecats.pilots.vision.colors import Mask, Picture
from dronecats.pilots.vision.command import Inscription
from dronecats.pilots.vision.division import Candidate, Color, GroundPoint
from dronecats.pilots.vision.ocr import ReadText
from dronecats.pilots.vision.ranging import CAMERA_AHEAD_M
from foundation.protocol import NEAR_M, STRIDE_MAX_M, STRIDE_MIN_M

HEIGHT_M, WIDTH_M = 0.86, 1.26  # of a board with its frame
_LEVEL_STEP = 8  # step between two thresholds of a Lab channel (0 … 255)
_TOLERANCES = (6.0, 9.0, 13.0, 18.0, 24.0, 32.0)  # limits of color_difference that `_find_of_color` tries
_LEAST_PX = (4, 5)  # px, least width and height of a board
_FARTHEST_M = 48.0
_WIDEST = 1.75  # a board is at most this many times as wide as it is high; a long word makes it wider
_FILLED = 0.5  # at least this share of a board's rectangle is paint and not letters
# range of the distance of a board's upper edge below the horizon, in board heights; for a camera at 1 … 2.4 m height
_TOP_RANGE = (-0.7, 1.25)
_BAND_FROM = 0.3  # fraction of the picture's height; the search uses the rows below
_SAME_LOOKS = 26.0  # largest color_difference between sun and shade of the same paint
_SAME_OVERLAP = 0.5  # overlap above which two rectangles are the same board
_POST = 0.73  # distance of the posts from the board's middle, in half board widths
_POST_OFF = 14.0  # the posts differ from the ground between them by more than this many grey levels
_POST_FROM, _POST_TO = 0.15, 0.72  # rows searched for posts, in board heights below the lower edge
_READ_M = 9.0  # within this distance, letters are large enough to read
_ARRIVED_M = 4.55  # the drone declares within this distance of a board's middle; success needs 5 m
_STOP_M = 3.3  # distance from the camera to the board at the end of the last stride
_BELOW_M = 1.0  # assumed height of the camera above a board's middle: large, so that no declaration is early
_LINE_ROWS = (0.27, 0.73)  # rows of the text on a board with one line, in board heights
_STRETCH_MAX = 3.0  # largest widening of a board seen at an angle

_Box = tuple[int, int, int, int]  # left, top, right, bottom, px


def find(picture: Picture) -> list[Candidate]:
    """Return the boards in a BGR picture (H, W, 3), of any paint, left to right."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    masks = []
    for channel in range(3):
        band = _band(lab)[:, :, channel]
        low, high = (int(v) for v in np.percentile(band, (0.05, 99.95)))
        for level in range(low + _LEVEL_STEP // 2, high, _LEVEL_STEP):
            masks += [band > level, band <= level]
    return _boards_in(picture, lab, masks)


def _find_of_color(picture: Picture, color: Color) -> list[Candidate]:
    """Return the boards of one paint, left to right. It finds more boards of this paint than `find`."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    away = color_difference(_band(lab).astype(np.float32), color)
    return _boards_in(picture, lab, [away < limit for limit in _TOLERANCES])


def find_alike(pictures: Sequence[Picture], most: int) -> list[list[Candidate]]:
    """Return each picture's boards of the most frequent paint, left to right.

    most: one picture counts for at most this many boards of a paint.
    """
    views = [find(picture) for picture in pictures]
    all_boards = [board for view in views for board in view]
    if not all_boards:
        return views
    board_colors = np.array([board.color for board in all_boards], np.float32)
    view_of_board = np.repeat(np.arange(len(views)), [len(view) for view in views])
    same = [color_difference(board_colors, board.color) < _SAME_LOOKS for board in all_boards]
    counts = [np.minimum(np.bincount(view_of_board[s], minlength=len(views)), most).sum() for s in same]
    color = tuple(np.median(board_colors[same[int(np.argmax(counts))]], axis=0).tolist())
    alike = []
    for view, picture in zip(views, pictures, strict=True):
        more = [
            board
            for board in _find_of_color(picture, color)
            if all(board.right <= first.left or board.left >= first.right for first in view)
        ]
        both = sorted(view + more, key=lambda board: (board.middle, board.top))
        alike.append([b for b in both if color_difference(np.array(b.color, np.float32), color) < _SAME_LOOKS])
    return alike


def color_difference(lab: NDArray[np.float32], color: Color) -> NDArray[np.float32]:
    """Return the distance of Lab colours (…, 3) from `color`. Lightness, which sun and shade change, counts half."""
    away = (lab - np.array(color, np.float32)) * np.array((0.5, 1.0, 1.0), np.float32)
    return np.asarray(np.sqrt((away**2).sum(axis=-1)), np.float32)


def _band(lab: Picture) -> Picture:
    return lab[round(_BAND_FROM * lab.shape[0]) :]


def _boards_in(picture: Picture, lab: Picture, masks: list[Mask]) -> list[Candidate]:
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    boxes: set[_Box] = set()
    for mask in masks:
        boxes.update(_rectangles(mask, lab.shape[0]))
    on_posts = [box for box in sorted(boxes) if _on_posts(grey, box)]
    return sorted((_board(lab, group) for group in _grouped(on_posts)), key=lambda b: (b.middle, b.top))


def _rectangles(mask: Mask, height: int) -> list[_Box]:
    """Return the filled rectangles with a board's shape and position in a mask of the picture's lower part."""
    width = mask.shape[1]
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)[2][1:]
    x, y, w, h, area = stats.T
    y = y + height - mask.shape[0]
    fits = (w >= _LEAST_PX[0]) & (h >= _LEAST_PX[1]) & (w <= _WIDEST * h) & (x > 0) & (x + w < width)
    fits &= (0.5 * width * HEIGHT_M < _FARTHEST_M * h) & (area >= _FILLED * w * h)
    fits &= (y - 0.5 * height >= _TOP_RANGE[0] * h) & (y - 0.5 * height <= _TOP_RANGE[1] * h)
    return [(int(x[k]), int(y[k]), int(x[k] + w[k]), int(y[k] + h[k])) for k in np.flatnonzero(fits)]


def _grouped(boxes: list[_Box]) -> list[list[_Box]]:
    """Return the boxes in groups; a group is one board at several thresholds.

    Each box of a group overlaps the largest box of the group by more than _SAME_OVERLAP.
    """
    groups: list[list[_Box]] = []
    for box in sorted(boxes, key=lambda b: -(b[2] - b[0]) * (b[3] - b[1])):
        for group in groups:
            if _overlap(group[0], box) > _SAME_OVERLAP:
                group.append(box)
                break
        else:
            groups.append([box])
    return groups


def _overlap(a: _Box, b: _Box) -> float:
    """Return the common area of two boxes divided by the area of the smaller box."""
    w = min(a[2], b[2]) - max(a[0], b[0])
    h = min(a[3], b[3]) - max(a[1], b[1])
    least = min((box[2] - box[0]) * (box[3] - box[1]) for box in (a, b))
    return max(0, w) * max(0, h) / least


def _board(lab: Picture, group: list[_Box]) -> Candidate:
    left, top, right, bottom = (round(float(v)) for v in np.median(np.array(group), axis=0))
    face = lab[top:bottom, left:right].reshape(-1, 3)
    half = 0.5 * lab.shape[1]
    depth = half * HEIGHT_M / (bottom - top)
    spot = GroundPoint((0.5 * (left + right) - half) / half * depth, depth)
    return Candidate(left, top, right, bottom, spot, color=tuple(np.median(face, axis=0).tolist()))


def _on_posts(grey: NDArray[np.float32], box: _Box) -> bool:
    """Return whether a board has two posts below it, both darker or both lighter than the ground between them."""
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


def decide(picture: Picture, board: Candidate, wanted: Inscription) -> str:
    """Return the action for the board that a drone flies to: `think` at a wrong text, a stride, or a declaration."""
    is_wanted = ocr.matches(wanted, read_board(picture, board)) if board.spot.ahead_m <= _READ_M else None
    if is_wanted is False:
        return actions.think()
    away = math.hypot(board.spot.ahead_m + CAMERA_AHEAD_M, board.spot.right_m, _BELOW_M)
    return actions.finished() if is_wanted and away <= _ARRIVED_M else stride_towards(board.spot)


def stride_towards(spot: GroundPoint) -> str:
    """Return a stride to a point. A full stride has the point's depth; the last one stops _STOP_M before the point."""
    u = 500.0 + 500.0 * spot.right_m / spot.ahead_m
    travel = spot.ahead_m - _STOP_M
    if travel >= STRIDE_MAX_M + STRIDE_MIN_M:
        return actions.go(u, 500.0, max(spot.ahead_m, NEAR_M))
    return actions.go(u, 500.0, actions.depth_of_stride(actions.short_stride_m(travel)))


def read_board(picture: Picture, board: Candidate) -> list[ReadText]:
    """Return the text of a board: the line across its middle, or all lines if no reading of that line is sure."""
    w, h = board.right - board.left, board.bottom - board.top
    stretch = min(max(WIDTH_M / HEIGHT_M * h / w, 1.0), _STRETCH_MAX)
    part = picture[max(0, board.top) : board.bottom, max(0, board.left) : board.right]
    line = ocr.read_line(part[round(_LINE_ROWS[0] * h) : round(_LINE_ROWS[1] * h)], stretch)
    return line if any(r.confidence >= ocr.SURE_CONFIDENCE for r in line) else ocr.read_lines(part, stretch)
