"""Estimates the distance of a thing of known size from its rectangle in the picture.

Each combination of distance, heading and camera height predicts a rectangle. The estimate is the mean over all
combinations, weighted by the fit of the predicted to the detected rectangle. Predictions are also cut off at the
picture's edge, so a near thing that is cut off does not seem small.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision.command import Size

# Assumed knowledge (paper, appendix "Execution"): a level pinhole camera, 90° across, 0.5 m ahead of the body's origin.
FOCAL_PER_WIDTH = 0.5 / math.tan(math.radians(90.0) / 2.0)
CAMERA_AHEAD_M = 0.5

_DEPTHS_M = np.geomspace(1.3, 70.0, 72)
_HEADINGS_RAD = np.radians(np.arange(0.0, 180.0, 12.0))
_CAMERA_HEIGHTS_M = np.array((0.7, 1.0, 1.3, 1.6, 1.9, 2.2, 2.7, 3.4, 4.5, 6.0))
# weights of the camera heights; flights start at 1.2–2.2 m
_HEIGHT_PRIOR = np.array((0.5, 0.8, 1.0, 1.0, 1.0, 1.0, 0.7, 0.5, 0.35, 0.25))
_EDGE = 0.005  # fraction of the picture width; a rectangle this near to an edge counts as cut off
_BELOW = 1.1  # points lower than this multiple of half the picture height do not widen the predicted rectangle
_SPREAD_LOG = 0.10  # relative standard deviation of the sizes of one kind
_SPREAD_EDGE = 0.006  # fraction of picture width, standard deviation of lengths from blur, JPEG, unpainted edges
_SPREAD_HORIZON = 0.02  # fraction of picture width, standard deviation of the horizon's row from about 2.5° of pitch

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoundingBox:
    """A rectangle in the picture, in fractions of the picture WIDTH from the picture's centre, x right, y down."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True, slots=True)
class Range:
    """The estimated distance of a thing's centre."""

    depth_m: float  # planar: along the optical axis
    distance_m: float  # 3-D, from the body's origin
    spread_m: float  # standard deviation of distance_m
    fit: float  # 0 … 1, how well the best prediction fits; a small value means another kind of thing

    def scaled(self, factor: float) -> "Range":
        """Return the range with all distances multiplied."""
        return Range(self.depth_m * factor, self.distance_m * factor, self.spread_m * factor, self.fit)


def measure(box: BoundingBox, size: Size, aspect: float) -> Range:
    """Return the distance of a thing of `size` that fills `box`; `aspect` is picture height / width."""
    half = 0.5 * aspect
    left, right, top, bottom = _grid(size, round(half, 4))
    # the grid predicts a thing straight ahead: move the predictions to the rectangle
    middle = 0.5 * (box.left + box.right)
    shift = _shift(box, left, right)
    # only a rectangle that touches an edge can be cut off there
    left = np.maximum(left + shift, -0.5 if box.left < _EDGE - 0.5 else -np.inf)
    right = np.minimum(right + shift, 0.5 if box.right > 0.5 - _EDGE else np.inf)
    top = np.maximum(top, -half if box.top < _EDGE - half else -np.inf)
    bottom = np.minimum(bottom, half if box.bottom > half - _EDGE else np.inf)
    cost = _mismatch(box.right - box.left, right - left) ** 2
    cost = cost + _mismatch(box.bottom - box.top, bottom - top) ** 2
    cost += 0.5 * ((box.top - top) / (_SPREAD_HORIZON + 0.02 * (bottom - top))) ** 2
    cost += 0.5 * ((box.bottom - bottom) / (_SPREAD_HORIZON + 0.06 * (bottom - top))) ** 2
    best = float(cost.min())
    weight = np.exp(-0.5 * (cost - best)) * _HEIGHT_PRIOR[None, None, :]
    weight /= weight.sum()
    depth = _DEPTHS_M[:, None, None]
    drop = _CAMERA_HEIGHTS_M[None, None, :] - 0.5 * size.height_m
    distance = np.sqrt((depth + CAMERA_AHEAD_M) ** 2 + (depth * middle / FOCAL_PER_WIDTH) ** 2 + drop**2)
    mean = float((weight * distance).sum())
    spread = math.sqrt(float((weight * (distance - mean) ** 2).sum()))
    return Range(float((weight * depth).sum()), mean, spread, math.exp(-0.5 * max(0.0, best) / 4.0))


def middle_to_near_end_m(box: BoundingBox, estimate: Range, size: Size) -> float:
    """Return the distance (m) from a thing's middle to its near end.

    The result is half the thing's width if the picture shows its side, half its length if it shows the front or back,
    and between them otherwise.
    """
    width_m = (box.right - box.left) * estimate.depth_m / FOCAL_PER_WIDTH
    span = size.length_m - size.width_m
    sideways = min(1.0, max(0.0, (width_m - size.width_m) / span)) if span > 0.0 else 1.0
    return 0.5 * (size.length_m - sideways * span)


def _shift(box: BoundingBox, left: Array, right: Array) -> Array:
    """Return the shift of the predictions onto the detected rectangle, using the sides that are not cut off."""
    cut_left, cut_right = box.left < _EDGE - 0.5, box.right > 0.5 - _EDGE
    if cut_left and not cut_right:
        return box.right - right
    if cut_right and not cut_left:
        return box.left - left
    return 0.5 * (box.left + box.right) - 0.5 * (left + right)


def _mismatch(length: float, predicted: Array) -> Array:
    """Return the difference of two lengths in standard deviations (of blur and of the sizes of the kind)."""
    return (length - predicted) / np.hypot(_SPREAD_EDGE, _SPREAD_LOG * predicted)


def outline(size: Size) -> tuple[Array, Array, Array]:
    """Return points on the outside of the painted body: metres forward, right and above the ground, (P,) each.

    The points come from outlines.npz if the kind has an outline, otherwise from the usual size.
    """
    if size.outline:
        with np.load(Path(__file__).with_name("outlines.npz")) as arrays:
            x, y, z = arrays[size.outline].astype(np.float64).T
        return x, y, z
    along = np.repeat(np.linspace(-0.5, 0.5, 6), 2) * size.length_m
    across = np.tile((0.5, -0.5), 6) * size.width_m
    waist = size.paint_from_m + 0.5 * (size.paint_to_m - size.paint_from_m)
    # As on a vehicle, sill and waist have the full footprint, and the roof has a smaller one.
    # Points along the whole sides keep the far part in the prediction if the picture cuts off the near part.
    return (
        np.concatenate((along, along, 0.7 * along)),
        np.concatenate((across, across, 0.85 * across)),
        np.repeat((size.paint_from_m, waist, size.paint_to_m), len(along)),
    )


@lru_cache(maxsize=16)
def _grid(size: Size, half: float) -> tuple[Array, Array, Array, Array]:
    """Return the left, right, top and bottom of predicted rectangles of a thing straight ahead.

    In fractions of the picture width. The axes of each array are depth, heading and camera height.
    """
    x, y, z = outline(size)
    c, s = np.cos(_HEADINGS_RAD)[:, None], np.sin(_HEADINGS_RAD)[:, None]
    ahead, right = c * x - s * y, s * x + c * y  # (headings, points)
    depth = np.maximum(_DEPTHS_M[:, None, None] + ahead[None], 0.25)
    u = FOCAL_PER_WIDTH * right[None] / depth
    v = FOCAL_PER_WIDTH * (_CAMERA_HEIGHTS_M[:, None] - z)[None, None] / depth[:, :, None, :]
    # only points inside the picture set the width, because the picture cuts off the lower body of a near thing
    inside = (v < _BELOW * half) | (v <= v.min(axis=-1, keepdims=True))
    u = np.broadcast_to(u[:, :, None, :], v.shape)
    left = np.where(inside, u, np.inf).min(axis=-1)
    rightmost = np.where(inside, u, -np.inf).max(axis=-1)
    return left, rightmost, v.min(axis=-1), v.max(axis=-1)
