"""Finds the thing of a named colour and kind in a picture, and estimates its distance.

The candidates are patches of the colour. If kind and colour are in KINDS and COLORS, a small network scores each patch
with its surroundings, and corrects the distance computed from its size. Otherwise the score is a product: the fit of
the patch's size, the vividness of its colour, and its solidity (few holes).
`python -m dronecats.pilots.fitting colors` fits the network (`patch_network.npz`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision import colors, ranging
from dronecats.pilots.vision.colors import Mask, Picture
from dronecats.pilots.vision.command import Referent, Size
from dronecats.pilots.vision.network import Floats, Network
from dronecats.pilots.vision.ranging import BoundingBox, Range

KINDS = ("suv", "sedan", "hatchback", "pickup", "van", "bus", "motorcycle", "cyclist", "quadrotor")
COLORS = ("cyan", "red", "yellow", "orange", "blue", "green", "purple", "pink", "brown")
SIDE = 16  # a patch is resampled to SIDE × SIDE cells
CHANNELS = 7  # CIE L, u, v; mask of the colour; gradient of L across, and down; 1 inside the picture and 0 outside
MARGIN = 0.35  # margin on each side of a patch's rectangle, as a fraction of the rectangle's width or height
MARGIN_PX = 3.0  # the margin has at least this width
BOX_FEATURES = 17  # numbers that describe the rectangle and its estimated distance
LENGTH = SIDE * SIDE * CHANNELS + BOX_FEATURES + len(KINDS) + len(COLORS)
_GRADIENT = 3.0  # factor that brings gradients to the magnitude of colours
_PICTURE_EDGE = 0.005  # fraction of the picture's width; a rectangle closer to an edge counts as touching it
_FACTOR_LIMIT_LOG = 0.7  # limit (±) of the log of the network's factor on the distance

_SMALLEST_PX = 20  # a patch has at least this many pixels (640 × 360 picture), like a vehicle at about 60 m
_FARTHEST_M = 42.0  # farther patches are ignored: at such a distance, any speck has the size of a target
_MOST_PATCHES = 12
_SAME_TINT = math.cos(math.radians(14.0))  # sun and shade change a paint's tint by under 14°; grass differs by more
_LEAST_SCORE = 0.08  # a detection without the network needs at least this score
_LIKELY_SCORE = 0.35  # a detection by the network needs at least this score
_EXPECTED_SCORE = 0.12  # at the expected place, this score is enough
_EXPECTED_ASIDE, _EXPECTED_DEPTH_LOG = 0.12, 0.45  # tolerances: fraction of the picture's width, log of the depth
_EXPECTED_PREFERENCE = 3.0  # factor on the rank of a detection at the expected place
_AREA_POWER = 0.3  # exponent of a patch's number of pixels in the rank; larger patches are preferred
_HORIZON_SLACK = 0.05  # fraction of the width; a patch whose bottom is farther than this above the middle is ignored

_Box = tuple[int, int, int, int]  # left, top, right, bottom, px


class PatchNetwork(Network):
    """The network with LENGTH inputs and two outputs: log odds of the target, log of the factor on the distance."""

    __slots__ = ()
    FILE = "patch_network.npz"

    def classify(self, examples: Floats) -> tuple[Floats, Floats]:
        """Return the probability of the target and the factor on its distance, (N,) each, for examples (N, LENGTH)."""
        raw = self.outputs(examples)
        odds = np.clip(raw[:, 0], -30.0, 30.0)
        factor = np.exp(np.clip(raw[:, 1], -_FACTOR_LIMIT_LOG, _FACTOR_LIMIT_LOG))
        return np.asarray(1.0 / (1.0 + np.exp(-odds)), np.float32), np.asarray(factor, np.float32)


def picture_layers(picture: Picture, mask: Mask) -> Floats:
    """Return the layers (H, W, CHANNELS) made from a BGR picture and the mask of a colour."""
    luv = cv2.cvtColor(picture.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2LUV) / np.float32(100.0)
    across, down = (np.abs(cv2.Sobel(luv[:, :, 0], cv2.CV_32F, *way, ksize=1)) * _GRADIENT for way in ((1, 0), (0, 1)))
    rest = (mask.astype(np.float32), across, down, np.ones(mask.shape, np.float32))
    return np.ascontiguousarray(np.dstack((luv, *rest)))


def network_input(layers: Floats, box: BoundingBox, estimate: Range, kind: str, color: str) -> Floats:
    """Return the network's input (LENGTH,) for one rectangle of `layers`, as a candidate for this kind and colour."""
    height, width = layers.shape[:2]
    aspect = height / width
    wide, high = box.right - box.left, box.bottom - box.top
    patch = _resample(layers, box)
    half = 0.5 * aspect
    where = (
        box.left, box.right, box.top, box.bottom, wide, high, 0.3 * math.log(max(wide, 1e-3)),
        0.3 * math.log(max(high, 1e-3)), 0.3 * math.log(max(wide, 1e-3) / max(high, 1e-3)),
        float(box.left < _PICTURE_EDGE - 0.5), float(box.right > 0.5 - _PICTURE_EDGE),
        float(box.top < _PICTURE_EDGE - half), float(box.bottom > half - _PICTURE_EDGE),
        estimate.fit, 0.3 * math.log(estimate.distance_m),
        min(1.0, estimate.spread_m / estimate.distance_m), box.bottom * estimate.depth_m / 1.6 - 1.0,
    )  # fmt: skip
    classes = [float(kind == k) for k in KINDS] + [float(color == c) for c in COLORS]
    return np.concatenate((patch.ravel(), np.clip(where, -3.0, 3.0), classes)).astype(np.float32)


def _resample(layers: Floats, box: BoundingBox) -> Floats:
    """Return the rectangle with its margin as (SIDE, SIDE, CHANNELS); 0 outside the picture."""
    height, width = layers.shape[:2]
    left, right = ((x + 0.5) * width for x in (box.left, box.right))
    top, bottom = (y * width + 0.5 * height for y in (box.top, box.bottom))
    beside, over = (max(MARGIN_PX, MARGIN * size) for size in (right - left, bottom - top))
    x0, x1 = math.floor(left - beside), math.ceil(right + beside)
    y0, y1 = math.floor(top - over), math.ceil(bottom + over)
    part = layers[max(0, y0) : max(0, y1), max(0, x0) : max(0, x1)]
    beyond = (max(0, -y0), max(0, y1 - height), max(0, -x0), max(0, x1 - width))
    filled = np.pad(part, (beyond[:2], beyond[2:], (0, 0)))
    # OpenCV resizes at most four channels at a time
    small = [cv2.resize(filled[:, :, k : k + 4], (SIDE, SIDE), interpolation=cv2.INTER_AREA) for k in (0, 4)]
    return np.asarray(np.concatenate(small, axis=2), np.float32)


@dataclass(frozen=True, slots=True)
class Detection:
    """A patch of a colour in a picture that may be the target."""

    box: BoundingBox
    range: Range  # estimate for a thing with the size of the referent (see `find`)
    score: float = 0.0  # 0 … 1
    lean: float = 0.0  # (upper edge of the right third − upper edge of the left third, y down) / picture width
    pixels: int = 0


@dataclass(frozen=True, slots=True)
class ExpectedPlace:
    """The place in the new picture at which the target of the last action is expected."""

    bearing: float  # horizontal offset from the picture's centre, fraction of the picture's width, + right
    depth_m: float

    def matches(self, box: BoundingBox, estimate: Range) -> bool:
        """Return whether a detection is near this place."""
        aside = abs(0.5 * (box.left + box.right) - self.bearing)
        return aside < _EXPECTED_ASIDE and abs(math.log(estimate.depth_m / self.depth_m)) < _EXPECTED_DEPTH_LOG


def find(
    picture: Picture, referent: Referent, expected: ExpectedPlace | None = None, network: PatchNetwork | None = None
) -> Detection | None:
    """Return the best detection of a referent (the thing that the command names); None without a detection.

    picture: BGR, about 640 px wide. expected: detections at this place have priority. network: None: the shipped one.
    """
    if referent.size.outline in KINDS and referent.color in COLORS:
        detections = _detect_by_look(picture, referent, expected, network or PatchNetwork.shipped())
    else:
        detections = _detect_by_size(picture, referent)

    def rank(detection: Detection) -> float:
        is_expected = expected is not None and expected.matches(detection.box, detection.range)
        weight = math.pow(detection.pixels, _AREA_POWER)
        return detection.score * weight * (_EXPECTED_PREFERENCE if is_expected else 1.0)

    return max(detections, key=rank, default=None)


def _patches(picture: Picture, referent: Referent, mask: Mask) -> Iterator[tuple[Detection, Mask, _Box]]:
    """Yield the patches of `mask` (the referent's colour) without a score, each with own mask and rectangle (px)."""
    height, width = picture.shape[:2]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    tint = colors.tint(picture, labels, count) if colors.BANDS[referent.color or ""].vivid else None
    for members in _grouped(stats, tint):
        where = np.isin(labels, members)
        core = _core(where)
        left, top, right, bottom = core
        box = BoundingBox(
            (left - 0.5 * width) / width,
            (top - 0.5 * height) / width,
            (right - 0.5 * width) / width,
            (bottom - 0.5 * height) / width,
        )
        if box.bottom < -_HORIZON_SLACK:
            continue
        estimate = ranging.measure(box, referent.size, height / width)
        if estimate.depth_m <= _FARTHEST_M:
            yield Detection(box, estimate, pixels=int(where.sum())), where, core


def color_patches(picture: Picture, referent: Referent) -> tuple[list[Detection], Floats]:
    """Return the patches of a referent's colour, and the network's inputs (N, LENGTH), one row per patch."""
    color = referent.color or ""
    mask = colors.mask(picture, color)
    layers = picture_layers(picture, mask)
    patches = [
        replace(patch, lean=_lean(core, where) / mask.shape[1])
        for patch, where, core in _patches(picture, referent, mask)
    ]
    examples = [network_input(layers, patch.box, patch.range, referent.size.outline, color) for patch in patches]
    return patches, np.array(examples, np.float32).reshape(-1, LENGTH)


def _detect_by_look(
    picture: Picture, referent: Referent, expected: ExpectedPlace | None, network: PatchNetwork
) -> Iterator[Detection]:
    """Yield the network's detections of a referent with a kind in KINDS and a colour in COLORS."""
    patches, examples = color_patches(picture, referent)
    if not patches:
        return
    for patch, share, factor in zip(patches, *network.classify(examples), strict=True):
        estimate = patch.range.scaled(float(factor))
        if share >= (_EXPECTED_SCORE if expected and expected.matches(patch.box, estimate) else _LIKELY_SCORE):
            yield replace(patch, range=estimate, score=float(share))


def _lean(core: _Box, where: Mask) -> float:
    """Return `Detection.lean` in px."""
    left, top, right, bottom = core
    region = where[top:bottom, left:right]
    third = max(1, (right - left) // 3)
    tops = np.where(region.any(axis=0), region.argmax(axis=0), bottom - top)
    return float(np.median(tops[-third:]) - np.median(tops[:third]))


def find_all(picture: Picture, referent: Referent) -> list[Detection]:
    """Return all detections of a referent's colour and size, left to right, without the network."""
    any_look = replace(referent, size=replace(referent.size, outline=""))
    return sorted(_detect_by_size(picture, any_look), key=lambda d: d.box.left + d.box.right)


def _detect_by_size(picture: Picture, referent: Referent) -> Iterator[Detection]:
    """Yield the detections of a referent by colour and size."""
    if referent.color is None:
        return
    saturation = colors.saturation(picture)
    for patch, where, (left, top, right, bottom) in _patches(picture, referent, colors.mask(picture, referent.color)):
        color = _vividness(saturation[where], referent.color)
        solid = _solidity(where[top:bottom, left:right], referent.size)
        score = patch.range.fit * color * solid
        if score >= _LEAST_SCORE:
            yield replace(patch, score=score)


def _grouped(stats: NDArray[np.int32], tint: NDArray[np.float64] | None) -> Iterator[NDArray[np.int64]]:
    """Yield the labels of the largest patches of colour, each joined with near patches of the same tint.

    One vehicle has several patches, because glass, pillars and trim divide its paint.
    """
    left, top, wide, high, area = stats.T
    right, bottom = left + wide, top + high
    free = np.arange(len(stats)) > 0  # label 0 is the background
    blobs = 0
    for seed in np.argsort(-area, kind="stable"):
        if not free[seed] or area[seed] < _SMALLEST_PX // 2 or blobs == _MOST_PATCHES:
            continue
        members = np.array([seed])
        free[seed] = False
        same_tint = True if tint is None else np.array([float(other @ tint[seed]) > _SAME_TINT for other in tint])
        for _ in range(3):  # an added patch extends the reach
            x0, y0, x1, y1 = left[members].min(), top[members].min(), right[members].max(), bottom[members].max()
            reach_x, reach_y = max(2, 0.06 * (x1 - x0)), max(2, min(0.45 * (y1 - y0), 0.25 * (x1 - x0)))
            near = (left < x1 + reach_x) & (right > x0 - reach_x) & (top < y1 + reach_y) & (bottom > y0 - reach_y)
            near &= free & same_tint & (area >= max(4, 0.01 * area[members].sum()))
            free &= ~near
            members = np.append(members, np.flatnonzero(near))
        if area[members].sum() >= _SMALLEST_PX:
            blobs += 1
            yield members


def _core(where: Mask) -> _Box:
    """Return the rectangle of a patch without thin outliers: 0.6 % of the pixels are cut off on each side."""
    columns, rows = np.cumsum(where.sum(axis=0)), np.cumsum(where.sum(axis=1))
    total = columns[-1]
    x0, x1 = (int(v) for v in np.searchsorted(columns, (0.006 * total, 0.994 * total)))
    y0, y1 = (int(v) for v in np.searchsorted(rows, (0.006 * total, 0.994 * total)))
    return x0, y0, x1 + 1, y1 + 1


def _vividness(saturation: NDArray[np.uint8], color: str) -> float:
    """Return a score 0 … 1; it is high for paint, and low for the weaker colours of grass, shade or brick."""
    vivid = colors.BANDS[color].vivid
    if vivid == 0:
        return 0.8  # colours without hue: size and shape decide
    strong = float(np.percentile(saturation, 75))
    return float(np.clip(0.2 + 0.8 * (strong - 0.6 * vivid) / (0.4 * vivid), 0.05, 1.0))


def _solidity(region: Mask, size: Size) -> float:
    """Return a score 0 … 1; it is high for a few large pieces (paint), low for many holes (leaves and grass)."""
    filled = float(region.mean())
    edges = float((region[:, 1:] != region[:, :-1]).sum() + (region[1:] != region[:-1]).sum())
    # the patch's edge length / that of a plain rectangle: about 2 with windows, much more for foliage
    rough = edges / (2.0 * sum(region.shape))
    least = 0.3 if size.height_m < 4.0 else 0.2
    return float(np.clip(filled / least, 0.0, 1.0) ** 1.5 * np.clip(4.0 / max(rough, 1e-3), 0.0, 1.0))
