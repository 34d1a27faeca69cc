"""Whether a patch of the named colour is the paint of the named vehicle, by how it and what is round it look.

A small network was fitted to pictures of neighbourhoods that no record has (`dronecats.pilots.fitting`); its
weights are `likeness.npz`. It sees the rectangle round the patch with a margin, and where in the picture that is. It
also says by how much such a vehicle is usually nearer or farther than the rectangle alone says.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision.paint import Mask, Picture
from dronecats.pilots.vision.ranging import BoundingBox, Range

Floats = NDArray[np.float32]

KINDS = ("suv", "sedan", "hatchback", "pickup", "van", "bus", "motorcycle", "cyclist", "quadrotor")
COLORS = ("cyan", "red", "yellow", "orange", "blue", "green", "purple", "pink", "brown")
SIDE = 16  # cells of the patch, high and wide
CHANNELS = 7  # CIE Luv, the colour's mask, the gradient across and down, and whether the picture reaches so far
MARGIN = 0.35  # of the rectangle's height and width, on each side of it
MARGIN_PX = 3.0
PLAIN = 17  # numbers that tell where the rectangle is, of each example
LENGTH = SIDE * SIDE * CHANNELS + PLAIN + len(KINDS) + len(COLORS)
_GRADIENT = 3.0  # brings the gradient to the colours' order of magnitude
_EDGE = 0.005  # of the picture's width, within which a rectangle touches the picture's edge
_MOST = 0.7  # logarithm, of what the rectangle's distance is changed by


@dataclass(frozen=True, slots=True)
class LikenessNetwork:
    """One hidden layer of rectifiers, and two numbers: the logarithm of the odds, and that of the range's factor."""

    hidden: Floats  # (LENGTH, H)
    hidden_bias: Floats  # (H,)
    out: Floats  # (H, 2)
    out_bias: Floats  # (2,)

    def judge(self, examples: Floats) -> tuple[Floats, Floats]:
        """Return for examples (N, LENGTH) how likely each is the vehicle, and the factor of its distance; (N,) each."""
        raw = np.maximum(examples @ self.hidden + self.hidden_bias, 0.0) @ self.out + self.out_bias
        odds, factor = np.clip(raw[:, 0], -30.0, 30.0), np.exp(np.clip(raw[:, 1], -_MOST, _MOST))
        return np.asarray(1.0 / (1.0 + np.exp(-odds)), np.float32), np.asarray(factor, np.float32)


def read(file: Path) -> LikenessNetwork:
    """Return the network in a file that `dronecats.pilots.fitting.sightings` has written."""
    with np.load(file) as kept:
        return LikenessNetwork(
            *(kept[name].astype(np.float32) for name in ("hidden", "hidden_bias", "out", "out_bias"))
        )


@lru_cache(maxsize=1)
def network() -> LikenessNetwork:
    """Return the fitted network that ships."""
    return read(Path(__file__).with_name("likeness.npz"))


def layers(picture: Picture, mask: Mask) -> Floats:
    """Return (H, W, CHANNELS) of a BGR picture in which a colour is masked."""
    luv = cv2.cvtColor(picture.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2LUV) / np.float32(100.0)
    across, down = (np.abs(cv2.Sobel(luv[:, :, 0], cv2.CV_32F, *way, ksize=1)) * _GRADIENT for way in ((1, 0), (0, 1)))
    rest = (mask.astype(np.float32), across, down, np.ones(mask.shape, np.float32))
    return np.ascontiguousarray(np.dstack((luv, *rest)))


def example(seen: Floats, box: BoundingBox, there: Range, kind: str, color: str) -> Floats:
    """Return (LENGTH,) what the network is given of one rectangle in `layers`, taken for a `kind` in a `color`."""
    height, width = seen.shape[:2]
    aspect = height / width
    wide, high = box.right - box.left, box.bottom - box.top
    patch = _patch(seen, box)
    half = 0.5 * aspect
    where = (
        box.left, box.right, box.top, box.bottom, wide, high, 0.3 * math.log(max(wide, 1e-3)),
        0.3 * math.log(max(high, 1e-3)), 0.3 * math.log(max(wide, 1e-3) / max(high, 1e-3)),
        float(box.left < _EDGE - 0.5), float(box.right > 0.5 - _EDGE), float(box.top < _EDGE - half),
        float(box.bottom > half - _EDGE), there.fit, 0.3 * math.log(there.distance_m),
        min(1.0, there.spread_m / there.distance_m), box.bottom * there.depth_m / 1.6 - 1.0,
    )  # fmt: skip
    told = [float(kind == k) for k in KINDS] + [float(color == c) for c in COLORS]
    return np.concatenate((patch.ravel(), np.clip(where, -3.0, 3.0), told)).astype(np.float32)


def _patch(seen: Floats, box: BoundingBox) -> Floats:
    """Return (SIDE, SIDE, CHANNELS) of the rectangle with its margin; beyond the picture there is nothing."""
    height, width = seen.shape[:2]
    left, right = ((x + 0.5) * width for x in (box.left, box.right))
    top, bottom = (y * width + 0.5 * height for y in (box.top, box.bottom))
    beside, over = (max(MARGIN_PX, MARGIN * size) for size in (right - left, bottom - top))
    x0, x1 = math.floor(left - beside), math.ceil(right + beside)
    y0, y1 = math.floor(top - over), math.ceil(bottom + over)
    part = seen[max(0, y0) : max(0, y1), max(0, x0) : max(0, x1)]
    beyond = (max(0, -y0), max(0, y1 - height), max(0, -x0), max(0, x1 - width))
    filled = np.pad(part, (beyond[:2], beyond[2:], (0, 0)))
    # OpenCV resizes four channels at a time
    small = [cv2.resize(filled[:, :, k : k + 4], (SIDE, SIDE), interpolation=cv2.INTER_AREA) for k in (0, 4)]
    return np.asarray(np.concatenate(small, axis=2), np.float32)
