"""Finds the pixels of a named colour in a picture. A colour is a band of hue, saturation and value.

Hue and saturation are ratios of the channels, so they are the same in sun and shade. The value in shade is a third of
the value in the sun.
The bands follow ordinary colour naming on OpenCV's scale (hue 0–179, saturation and value 0–255).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]  # (H, W, 3), OpenCV's BGR order


@dataclass(frozen=True, slots=True)
class Band:
    """A box in HSV. The hue range may wrap through red."""

    hue: tuple[int, int]
    saturation: tuple[int, int]
    value: tuple[int, int]
    vivid: int  # a patch is paint if its 75th percentile of saturation reaches this; 0: white, grey, black


BANDS: dict[str, Band] = {
    "red": Band((171, 8), (105, 255), (40, 255), 140),
    "orange": Band((8, 20), (120, 255), (60, 255), 160),
    "yellow": Band((20, 34), (110, 255), (70, 255), 150),
    "green": Band((59, 83), (105, 255), (35, 255), 130),
    "cyan": Band((82, 101), (80, 255), (40, 255), 115),
    "blue": Band((101, 128), (110, 255), (35, 255), 140),
    "purple": Band((125, 152), (70, 255), (30, 255), 95),
    "magenta": Band((140, 171), (90, 255), (45, 255), 125),
    "pink": Band((145, 178), (40, 200), (90, 255), 60),
    "brown": Band((4, 20), (60, 190), (30, 150), 80),
    "white": Band((0, 179), (0, 60), (160, 255), 0),
    "grey": Band((0, 179), (0, 45), (75, 200), 0),
    "black": Band((0, 179), (0, 110), (0, 50), 0),
}
"""The keys are the values of `command.COLORS`."""

_SKY_STEP = 3  # neighbouring pixels of the sky differ by at most this, in grey levels
_SKY_HUE, _SKY_SATURATION = (
    (85, 125),
    170,
)  # hues and largest saturation of the sky; car paint of these hues is more saturated
_SKY_VALUE = 110  # by day, the sky has at least this value


def mask(picture: Picture, color: str) -> Mask:
    """Return the pixels of a picture that may be of this colour, without the sky and small specks."""
    band = BANDS[color]
    hsv = cv2.cvtColor(cv2.GaussianBlur(picture, (3, 3), 0), cv2.COLOR_BGR2HSV)
    low, high = band.hue
    spans = [(low, high)] if low <= high else [(low, 179), (0, high)]
    pixels = np.zeros(hsv.shape[:2], np.uint8)
    for first, last in spans:
        floor = np.array((first, band.saturation[0], band.value[0]), np.uint8)
        ceiling = np.array((last, band.saturation[1], band.value[1]), np.uint8)
        pixels |= cv2.inRange(hsv, floor, ceiling)
    pixels[sky(picture)] = 0
    opened: NDArray[np.uint8] = cv2.morphologyEx(pixels, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return opened > 0


def saturation(picture: Picture) -> NDArray[np.uint8]:
    """Return the saturation (H, W), 0–255."""
    hsv: NDArray[np.uint8] = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    return hsv[:, :, 1]


def tint(picture: Picture, labels: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """Return each labelled region's mean colour as a unit vector in the a-b plane of CIE Lab: (count, 2)."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    flat = labels.ravel()
    plane = [np.bincount(flat, lab[:, :, k].ravel().astype(np.float64) - 128.0, count) for k in (1, 2)]
    mean: NDArray[np.float64] = np.stack(plane, axis=1)
    length: NDArray[np.float64] = np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    return mean / length


def sky(picture: Picture) -> Mask:
    """Return the pixels of the sky: bright, blue or grey, and connected with the upper edge of the picture.

    The sky is at most the upper 0.55 of the picture, because a level camera has the horizon in the middle.
    """
    height, width = picture.shape[:2]
    smooth = cv2.GaussianBlur(picture, (5, 5), 0)
    hsv = cv2.cvtColor(smooth, cv2.COLOR_BGR2HSV)
    hue, saturated, value = hsv[:, :, 0], hsv[:, :, 1], hsv[:, :, 2]
    tinted = (saturated > 40) & ((hue < _SKY_HUE[0]) | (hue > _SKY_HUE[1]))
    blocked = np.zeros((height + 2, width + 2), np.uint8)
    blocked[1:-1, 1:-1] = (value < _SKY_VALUE) | (saturated > _SKY_SATURATION) | tinted
    blocked[1 + round(0.55 * height) :] = 1
    step = (_SKY_STEP,) * 3
    flags = 4 | cv2.FLOODFILL_MASK_ONLY | (2 << 8)
    for x in range(2, width, 16):
        if blocked[1, x + 1] == 0:
            cv2.floodFill(smooth, blocked, (x, 0), (0, 0, 0), step, step, flags)
    filled = (blocked[1:-1, 1:-1] == 2).astype(np.uint8)
    grown: NDArray[np.uint8] = cv2.dilate(filled, np.ones((5, 5), np.uint8))
    return grown > 0
