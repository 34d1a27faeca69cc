"""The catalogue's things in a picture, by their shapes: what stands where, from the camera.

A level camera at a known height sees the foot of a thing that is so far away in one row and its size in one scale.
So the picture is looked at once per distance, scaled so that a metre there is always as long, in windows of a fixed
size in metres that stand on the ground. What is in a window a small network says that was fitted to pictures of
campuses that do not exist (`dronecats.pilots.fitting`); its weights are `shapes.npz`. The camera's height is
unknown, so four are tried.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision.paint import Picture

KINDS = (
    "nothing", "bench", "bike-rack", "bin", "bollard", "clock-tower", "delivery-robot", "fountain", "kiosk", "lamp",
    "notice-board", "person", "picnic-table", "planter", "service-cart", "statue", "tiered-fountain", "vending-machine",
)  # fmt: skip
"""What a window may hold, in the order of the network's outputs."""

Floats = NDArray[np.float32]

CELL_M = 0.25
WINDOW = (15, 14)  # cells, high and wide
BELOW = 1  # cells of the window under the foot
DEPTHS_M = tuple(round(float(d), 3) for d in np.geomspace(3.2, 46.0, 22))
HEIGHTS_M = (1.25, 1.5, 1.75, 2.0)  # of the camera over the foot: a cell apart
CHANNELS = 8  # CIE Luv, the gradient's size, and its size in four directions

_ABOVE, _UNDER = 9, 9  # cells over and under the horizon that some window reaches
_FAR_M = 9.0  # from here on every second column is looked at: a window's middle need not be exact
_PER_CELL = 2  # px of the scaled picture
_GRADIENT = 4.0  # brings the gradient to the colours' order of magnitude


@dataclass(frozen=True, slots=True)
class Network:
    """One hidden layer of rectifiers, and a share for each of KINDS."""

    hidden: Floats  # (rows · columns · CHANNELS, H)
    hidden_bias: Floats  # (H,)
    out: Floats  # (H, len(KINDS))
    out_bias: Floats  # (len(KINDS),)

    def shares(self, windows: Floats) -> Floats:
        """Return for windows (N, rows · columns · CHANNELS) how likely each of KINDS is, (N, K), each row's sum 1."""
        active = np.maximum(windows @ self.hidden + self.hidden_bias, 0.0)
        raw = active @ self.out + self.out_bias
        share = np.exp(raw - raw.max(axis=1, keepdims=True))
        return np.asarray(share / share.sum(axis=1, keepdims=True), np.float32)


def read(file: Path) -> Network:
    """Return the network in a file that `dronecats.pilots.fitting.shapes` has written."""
    with np.load(file) as kept:
        return Network(*(kept[name].astype(np.float32) for name in ("hidden", "hidden_bias", "out", "out_bias")))


@lru_cache(maxsize=1)
def network() -> Network:
    """Return the fitted network that ships."""
    return read(Path(__file__).with_name("shapes.npz"))


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """What a picture shows at one distance, in cells of CELL_M; the horizon lies under row _ABOVE."""

    depth_m: float
    cells: Floats  # (_ABOVE + _UNDER, columns, CHANNELS)

    def windows(self, height: int) -> Floats:
        """Return the windows (N, rows · columns · CHANNELS) whose foot is as far under the horizon as this height."""
        foot = _ABOVE + round(HEIGHTS_M[height] / CELL_M)
        part = self.cells[foot + BELOW - WINDOW[0] : foot + BELOW]
        padded = np.pad(part, ((0, 0), (WINDOW[1] // 2, WINDOW[1] // 2), (0, 0)), mode="edge")
        seen = np.lib.stride_tricks.sliding_window_view(padded, WINDOW[1], axis=1)  # (rows, columns + 1, C, wide)
        step = self.step
        return np.ascontiguousarray(seen[:, ::step].transpose(1, 0, 3, 2)).reshape(-1, WINDOW[0] * WINDOW[1] * CHANNELS)

    @property
    def step(self) -> int:
        """Columns between neighbouring windows."""
        return 1 if self.depth_m < _FAR_M else 2

    def rights_m(self) -> NDArray[np.float64]:
        """Return how far right of the optical axis the middle of each window is: they lie on the cells' borders."""
        columns = self.cells.shape[1]
        return np.asarray((np.arange(0, columns + 1, self.step) - 0.5 * columns) * CELL_M)


def strips(picture: Picture) -> list[Strip]:
    """Return the picture (H, W, 3), BGR and 90° across, at every distance of DEPTHS_M."""
    luv = cv2.cvtColor(picture.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2LUV) / np.float32(100.0)
    return [_strip(luv, depth) for depth in DEPTHS_M]


def _strip(luv: Floats, depth_m: float) -> Strip:
    height, width = luv.shape[:2]
    scale = depth_m * _PER_CELL / (CELL_M * 0.5 * width)  # the focal length is half the width
    columns = max(2, round(width * scale / _PER_CELL))
    scale = columns * _PER_CELL / width
    reach = max(_ABOVE, _UNDER) + 1
    rows = min(height // 2, math.ceil(reach * _PER_CELL / scale))
    seen = luv[height // 2 - rows : height // 2 + rows]
    half = max(1, round(rows * scale))
    small = cv2.resize(
        seen, (columns * _PER_CELL, 2 * half), interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    )
    missing = reach * _PER_CELL - half
    if missing > 0:
        small = cv2.copyMakeBorder(small, missing, missing, 0, 0, cv2.BORDER_REPLICATE)
    middle = small.shape[0] // 2
    small = small[middle - reach * _PER_CELL : middle + reach * _PER_CELL]
    down, across = (cv2.Sobel(small[:, :, 0], cv2.CV_32F, *way, ksize=1) * _GRADIENT for way in ((0, 1), (1, 0)))
    layers = [small, np.hypot(down, across)[:, :, None]]
    for angle in (0.0, 45.0, 90.0, 135.0):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        layers.append(np.abs(c * across + s * down)[:, :, None])
    full = np.concatenate(layers, axis=2)
    cells = cv2.resize(full[:, :, :4], (columns, 2 * reach), interpolation=cv2.INTER_AREA)
    more = cv2.resize(full[:, :, 4:], (columns, 2 * reach), interpolation=cv2.INTER_AREA)
    joined = np.concatenate((cells, more), axis=2)
    return Strip(depth_m, np.ascontiguousarray(joined[reach - _ABOVE : reach + _UNDER], np.float32))
