"""Finds things of the kinds in KINDS by their shapes, and their places on the ground.

For a level camera, the camera's height and a thing's distance give the row of the thing's foot, and the distance gives
the thing's scale. The picture is therefore scaled once per distance, so that a metre at that distance has a fixed
length. A small network classifies windows that stand on the ground and have a fixed size in metres. The
camera's height is unknown, so four heights are tried. `python -m dronecats.pilots.fitting shapes` fits the network
(`shape_network.npz`).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.network import Floats, Network

KINDS = (
    "nothing", "bench", "bike-rack", "bin", "bollard", "clock-tower", "delivery-robot", "fountain", "kiosk", "lamp",
    "notice-board", "person", "picnic-table", "planter", "service-cart", "statue", "tiered-fountain", "vending-machine",
)  # fmt: skip
"""The contents of a window, in the order of the network's outputs."""

CELL_M = 0.25  # side of a cell, the pixel of a `Strip`
WINDOW = (15, 14)  # cells, high and wide
BELOW = 1  # cells of the window below the thing's foot
DEPTHS_M = tuple(round(float(d), 3) for d in np.geomspace(3.2, 46.0, 22))
HEIGHTS_M = (1.25, 1.5, 1.75, 2.0)  # camera heights above the thing's foot, in steps of one cell
CHANNELS = 8  # CIE L, u, v; magnitudes of the gradient of L and of the gradient's components in four directions

_ABOVE, _UNDER = 9, 9  # rows of a `Strip` above and below the horizon
_FAR_M = 9.0  # from this distance on, only every second column has a window
_PER_CELL = 2  # px per cell in the scaled picture
_GRADIENT = 4.0  # factor that brings gradients to the magnitude of colours

LEAST_ODDS = -1.3  # a detection needs at least these log odds
_APART_LOG = 0.40  # detections in one direction are the same thing if |log(ratio of distances)| is at most this
_SAME_RAD = 0.02  # detections within this angle may be the same thing, even if the thing is narrower
_HALF_WIDTH_M = {
    "fountain": 2.2,
    "tiered-fountain": 2.6,
    "kiosk": 1.4,
    "bike-rack": 1.3,
    "clock-tower": 2.4,
    "bench": 1.0,
    "picnic-table": 1.0,
    "service-cart": 1.2,
}
_USUAL_HALF_WIDTH_M = 0.6
_LEVEL_TOLERANCE_M = 0.3  # a thing's foot is at most this far above or below the common ground level


class ShapeNetwork(Network):
    """The network with the rows · columns · CHANNELS numbers of a window as inputs and one output per kind of KINDS."""

    __slots__ = ()
    FILE = "shape_network.npz"

    def probabilities(self, windows: Floats) -> Floats:
        """Return the probabilities (N, K) of KINDS for windows (N, rows · columns · CHANNELS)."""
        raw = self.outputs(windows)
        weight = np.exp(raw - raw.max(axis=1, keepdims=True))
        return np.asarray(weight / weight.sum(axis=1, keepdims=True), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """A picture at the scale of one distance, in cells of CELL_M. The first _ABOVE rows are above the horizon."""

    depth_m: float
    cells: Floats  # (_ABOVE + _UNDER, columns, CHANNELS)

    def windows(self, height: int) -> Floats:
        """Return the windows (N, rows · columns · CHANNELS) on the ground for the camera height HEIGHTS_M[height]."""
        foot = _ABOVE + round(HEIGHTS_M[height] / CELL_M)
        part = self.cells[foot + BELOW - WINDOW[0] : foot + BELOW]
        padded = np.pad(part, ((0, 0), (WINDOW[1] // 2, WINDOW[1] // 2), (0, 0)), mode="edge")
        views = np.lib.stride_tricks.sliding_window_view(padded, WINDOW[1], axis=1)  # (rows, columns, C, wide)
        step = self.step
        length = WINDOW[0] * WINDOW[1] * CHANNELS
        return np.ascontiguousarray(views[:, ::step].transpose(1, 0, 3, 2)).reshape(-1, length)

    @property
    def step(self) -> int:
        """The number of columns between neighbouring windows."""
        return 1 if self.depth_m < _FAR_M else 2

    def rights_m(self) -> NDArray[np.float64]:
        """Return the distance (m) of each window's middle to the right of the optical axis."""
        columns = self.cells.shape[1]
        return np.asarray((np.arange(0, columns + 1, self.step) - 0.5 * columns) * CELL_M)


def strips(picture: Picture) -> list[Strip]:
    """Return a picture (H, W, 3), BGR and 90° across, scaled for each distance of DEPTHS_M."""
    luv = cv2.cvtColor(picture.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2LUV) / np.float32(100.0)
    return [_strip(luv, depth) for depth in DEPTHS_M]


def _strip(luv: Floats, depth_m: float) -> Strip:
    height, width = luv.shape[:2]
    scale = depth_m * _PER_CELL / (CELL_M * 0.5 * width)  # the focal length is half the width
    columns = max(2, round(width * scale / _PER_CELL))
    scale = columns * _PER_CELL / width
    reach = max(_ABOVE, _UNDER) + 1
    rows = min(height // 2, math.ceil(reach * _PER_CELL / scale))
    band = luv[height // 2 - rows : height // 2 + rows]
    half = max(1, round(rows * scale))
    small = cv2.resize(
        band, (columns * _PER_CELL, 2 * half), interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
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


@dataclass(frozen=True, slots=True)
class PlacedThing:
    """A detected thing and its place relative to the camera."""

    kind: str  # of KINDS
    depth_m: float  # along the optical axis, to the thing's middle
    right_m: float  # right of the optical axis
    below_m: float  # height of the camera above the foot
    odds: float  # log odds


def half_width_m(kind: str) -> float:
    return _HALF_WIDTH_M.get(kind, _USUAL_HALF_WIDTH_M)


def find(picture: Picture, kinds: Iterable[str], network: ShapeNetwork) -> list[PlacedThing]:
    """Return the things of these kinds in a picture (H, W, 3), BGR and 90° across, highest odds first.

    A thing's place is the mean of the windows that detect the thing, weighted by their odds.
    """
    peaks = _window_peaks(picture, tuple(kinds), network)
    level = _ground_below_m(peaks)
    groups: list[list[PlacedThing]] = []
    for peak in sorted((s for s in peaks if abs(s.below_m - level) <= _LEVEL_TOLERANCE_M), key=lambda s: -s.odds):
        group = next((g for g in groups if _are_same(peak, g[0])), None)
        if group is None:
            groups.append([peak])
        elif peak.kind == group[0].kind:
            group.append(peak)
    return [_merge(group) for group in groups]


def _merge(group: list[PlacedThing]) -> PlacedThing:
    """Return the mean of the detections of one thing. The first detection must have the highest odds."""
    first = group[0]
    weight = [math.exp(detection.odds - first.odds) for detection in group]
    total = sum(weight)
    depth = math.exp(sum(w * math.log(detection.depth_m) for w, detection in zip(weight, group, strict=True)) / total)
    aside = sum(w * detection.right_m / detection.depth_m for w, detection in zip(weight, group, strict=True)) / total
    below = sum(w * detection.below_m for w, detection in zip(weight, group, strict=True)) / total
    return PlacedThing(first.kind, depth, aside * depth, below, first.odds)


def _window_peaks(picture: Picture, kinds: tuple[str, ...], network: ShapeNetwork) -> list[PlacedThing]:
    """Return the detections of windows that have higher odds than the windows left and right of them."""
    peaks: list[PlacedThing] = []
    indices = [(kind, KINDS.index(kind)) for kind in kinds]
    for strip in strips(picture):
        rights = strip.rights_m()
        for height, below in enumerate(HEIGHTS_M):
            probability = network.probabilities(strip.windows(height))
            for kind, k in indices:
                odds = np.log(probability[:, k] / (1.0 - probability[:, k] + 1e-6) + 1e-6)
                padded = np.pad(odds, 1, constant_values=-np.inf)
                is_peak = (odds >= LEAST_ODDS) & (odds >= padded[:-2]) & (odds > padded[2:])
                for column in np.flatnonzero(is_peak):
                    peaks.append(PlacedThing(kind, strip.depth_m, float(rights[column]), below, float(odds[column])))
    return peaks


def _ground_below_m(peaks: list[PlacedThing]) -> float:
    """Return how far (m) the ground is below the camera; 1.6 without peaks.

    The result is a weighted mean of HEIGHTS_M. The weight is the squared sum of (log odds − LEAST_ODDS) over the peaks
    with this height.
    """
    if not peaks:
        return 1.6
    evidence = {h: sum(s.odds - LEAST_ODDS for s in peaks if s.below_m == h) for h in HEIGHTS_M}
    total = sum(v * v for v in evidence.values()) or 1.0
    return sum(h * v * v for h, v in evidence.items()) / total


def _are_same(first: PlacedThing, second: PlacedThing) -> bool:
    """Return whether two detections show the same thing, or two kinds at the same place."""
    if abs(math.log(first.depth_m / second.depth_m)) > _APART_LOG:
        return False
    half = half_width_m(second.kind) if first.kind == second.kind else 0.5 * _USUAL_HALF_WIDTH_M
    aside = abs(first.right_m / first.depth_m - second.right_m / second.depth_m)
    return aside <= max(_SAME_RAD, half / second.depth_m)
