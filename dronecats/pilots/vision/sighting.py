"""The one place in a picture that looks most like the thing a command names: right colour, plausible size and stand."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.vision import likeness, paint, ranging
from dronecats.pilots.vision.ranging import BoundingBox, Range
from dronecats.pilots.vision.referent import Referent, Size

_SMALLEST_PX = 20  # of 640 × 360; a vehicle is that small at about 60 m
_FARTHEST_M = 42.0  # beyond, specks of any colour have the size that is wanted
_CANDIDATES = 12
_SAME_TINT = math.cos(math.radians(14.0))  # in the colour plane: one paint in sun and shade, not the grass beside it
_WEAKEST = 0.08  # score below which nothing is said to have been seen
_LIKELY = 0.35  # from which what looks like the catalogue's thing is taken for it
_STILL = 0.12  # from which it is still that where what is gone for must be
_ABOUT, _ABOUT_LOG = 0.12, 0.45  # of the width, and logarithm of the distance, within which that is
_KEPT = 3.0  # by which what is gone for is preferred
_LARGER = 0.3  # power of the area by which larger patches are preferred: a speck is rarely the thing
_HORIZON_SLACK = 0.05  # fraction of the width that a thing on the ground may end above the middle: a body pitches


@dataclass(frozen=True, slots=True)
class Sighting:
    """The thing, or what is taken for it."""

    box: BoundingBox
    range: Range
    score: float  # 0 … 1
    lean: float = 0.0  # fraction of the picture width by which its top falls from the left third to the right one


@dataclass(frozen=True, slots=True)
class Expected:
    """Where what is gone for must be by now."""

    bearing: float  # fraction of the picture WIDTH from its centre, + right
    depth_m: float

    def is_at(self, box: BoundingBox, there: Range) -> bool:
        """Return whether a sighting is about there."""
        aside = abs(0.5 * (box.left + box.right) - self.bearing)
        return aside < _ABOUT and abs(math.log(there.depth_m / self.depth_m)) < _ABOUT_LOG


@dataclass(frozen=True, slots=True)
class _Blob:
    left: int
    top: int
    right: int
    bottom: int
    pixels: int
    members: tuple[int, ...]  # labels


def find(
    picture: paint.Picture,
    named: Referent,
    expected: Expected | None = None,
    network: likeness.LikenessNetwork | None = None,
) -> Sighting | None:
    """Return the best sighting of `named` in a BGR picture 640 px wide or so; None when nothing will do.

    What the catalogue has is told by its looks (`network`: with this one), anything else by its size and by how much
    of its rectangle is paint. What is `expected` is held on to.
    """
    if named.size.outline in likeness.KINDS and named.color in likeness.COLORS:
        sighted = _familiar(picture, named, expected, network or likeness.network())
    else:
        sighted = _sighted(picture, named)
    best: Sighting | None = None
    best_rank = 0.0
    for seen, pixels in sighted:
        rank = seen.score * pixels**_LARGER * (_KEPT if expected and expected.is_at(seen.box, seen.range) else 1.0)
        if rank > best_rank:
            best, best_rank = seen, rank
    return best


@dataclass(frozen=True, slots=True)
class Candidate:
    """A patch of the named colour."""

    box: BoundingBox
    range: Range  # were it the named thing
    pixels: int
    lean: float  # as a sighting's


def candidates(picture: paint.Picture, named: Referent) -> tuple[list[Candidate], likeness.Floats]:
    """Return the patches of a catalogue's thing's colour, and an example of each for the network, (N, LENGTH)."""
    height, width = picture.shape[:2]
    color = named.color or ""
    mask = paint.mask(picture, color)
    layers = likeness.layers(picture, mask)
    found: list[Candidate] = []
    for blob, where in _blobs(picture, mask, color):
        core = _core(blob, where)
        box = _box(core, width, height)
        if box.bottom < -_HORIZON_SLACK:
            continue
        rng = ranging.measure(box, named.size, height / width)
        if rng.depth_m <= _FARTHEST_M:
            found.append(Candidate(box, rng, blob.pixels, _lean(core, where) / width))
    examples = [likeness.example(layers, one.box, one.range, named.size.outline, color) for one in found]
    return found, np.array(examples, np.float32).reshape(-1, likeness.LENGTH)


def _familiar(
    picture: paint.Picture, named: Referent, expected: Expected | None, network: likeness.LikenessNetwork
) -> Iterator[tuple[Sighting, int]]:
    """Yield what looks like the catalogue's thing, with its number of pixels."""
    found, examples = candidates(picture, named)
    if not found:
        return
    for one, share, factor in zip(found, *network.judge(examples), strict=True):
        there = one.range.scaled(float(factor))
        if share >= (_STILL if expected and expected.is_at(one.box, there) else _LIKELY):
            yield Sighting(one.box, there, float(share), one.lean), one.pixels


def _lean(core: tuple[int, int, int, int], where: paint.Mask) -> float:
    """Return by how many pixels the upper edge falls from the left third to the right one."""
    left, top, right, bottom = core
    region = where[top:bottom, left:right]
    third = max(1, (right - left) // 3)
    tops = np.where(region.any(axis=0), region.argmax(axis=0), bottom - top)
    return float(np.median(tops[-third:]) - np.median(tops[:third]))


def every(picture: paint.Picture, named: Referent) -> list[Sighting]:
    """Return all sightings in such a picture of what has about the size of `named`, left to right.

    Which of the catalogue's kinds it is does not count: it is for whoever reads what is written on it.
    """
    about = replace(named, size=replace(named.size, outline=""))
    return sorted((seen for seen, _ in _sighted(picture, about)), key=lambda s: s.box.left + s.box.right)


def _sighted(picture: paint.Picture, named: Referent) -> Iterator[tuple[Sighting, int]]:
    """Yield what will do, with its number of pixels."""
    if named.color is None:
        return
    height, width = picture.shape[:2]
    mask = paint.mask(picture, named.color)
    saturation = paint.saturation(picture)
    for blob, where in _blobs(picture, mask, named.color):
        seen = _judge(blob, where, saturation, named, width, height)
        if seen is not None:
            yield seen, blob.pixels


def _blobs(picture: paint.Picture, mask: paint.Mask, color: str) -> Iterator[tuple[_Blob, paint.Mask]]:
    """Yield the largest patches of a masked colour, and where each is."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    tint = paint.tint(picture, labels, count) if paint.BANDS[color].vivid else None
    for blob in _grouped(stats, count, tint):
        yield blob, np.isin(labels, blob.members)


def _grouped(stats: NDArray[np.int32], count: int, tint: NDArray[np.float64] | None) -> list[_Blob]:
    """Return the largest patches of colour, each with the patches that belong to the same thing.

    Glass, pillars and trim cut the paint of one vehicle into roof, doors and bonnet: patches within a share of the
    large one's own size, and of the same tint as far as there is one, are its own.
    """
    blobs: list[_Blob] = []
    order = sorted(range(1, count), key=lambda i: (-int(stats[i, cv2.CC_STAT_AREA]), i))
    taken: set[int] = set()
    for seed in order:
        if seed in taken or stats[seed, cv2.CC_STAT_AREA] < _SMALLEST_PX // 2 or len(blobs) == _CANDIDATES:
            continue
        x, y, w, h, area = (int(v) for v in stats[seed])
        blob = _Blob(x, y, x + w, y + h, area, (seed,))
        taken.add(seed)
        alike = order if tint is None else [i for i in order if float(tint[i] @ tint[seed]) > _SAME_TINT]
        for _ in range(3):  # what has been added reaches a little farther
            grown = _absorb(blob, stats, alike, taken)
            if grown == blob:
                break
            blob = grown
        if blob.pixels >= _SMALLEST_PX:
            blobs.append(blob)
    return blobs


def _absorb(blob: _Blob, stats: NDArray[np.int32], order: list[int], taken: set[int]) -> _Blob:
    w, h = blob.right - blob.left, blob.bottom - blob.top
    reach_x, reach_y = max(2, 0.06 * w), max(2, min(0.45 * h, 0.25 * w))
    left, top, right, bottom = blob.left, blob.top, blob.right, blob.bottom
    pixels, members = blob.pixels, list(blob.members)
    for i in order:
        if i in taken:
            continue
        x, y, iw, ih, area = (int(v) for v in stats[i])
        near = (
            x < blob.right + reach_x
            and x + iw > blob.left - reach_x
            and y < blob.bottom + reach_y
            and y + ih > blob.top - reach_y
        )
        if near and area >= max(4, 0.01 * blob.pixels):
            taken.add(i)
            members.append(i)
            left, top, right, bottom = min(left, x), min(top, y), max(right, x + iw), max(bottom, y + ih)
            pixels += area
    return _Blob(left, top, right, bottom, pixels, tuple(members))


def _judge(
    blob: _Blob, where: paint.Mask, saturation: NDArray[np.uint8], named: Referent, width: int, height: int
) -> Sighting | None:
    left, top, right, bottom = core = _core(blob, where)
    box = _box(core, width, height)
    if box.bottom < -_HORIZON_SLACK:
        return None
    rng = ranging.measure(box, named.size, height / width)
    if rng.depth_m > _FARTHEST_M:
        return None
    color = _vividness(saturation[where], named.color or "")
    solid = _solidity(where[top:bottom, left:right], named.size)
    score = rng.fit * color * solid
    return Sighting(box, rng, score) if score >= _WEAKEST else None


def _box(core: tuple[int, int, int, int], width: int, height: int) -> BoundingBox:
    """Return a rectangle of pixels (left, top, right, bottom) in fractions of the width."""
    left, top, right, bottom = core
    return BoundingBox(
        (left - 0.5 * width) / width,
        (top - 0.5 * height) / width,
        (right - 0.5 * width) / width,
        (bottom - 0.5 * height) / width,
    )


def _core(blob: _Blob, where: paint.Mask) -> tuple[int, int, int, int]:
    """Return the rectangle of the blob without its thin outliers: the rows and columns that hold 1 … 99 % of it."""
    region = where[blob.top : blob.bottom, blob.left : blob.right]
    columns, rows = np.cumsum(region.sum(axis=0)), np.cumsum(region.sum(axis=1))
    total = columns[-1]
    x0, x1 = (int(v) for v in np.searchsorted(columns, (0.006 * total, 0.994 * total)))
    y0, y1 = (int(v) for v in np.searchsorted(rows, (0.006 * total, 0.994 * total)))
    return blob.left + x0, blob.top + y0, blob.left + x1 + 1, blob.top + y1 + 1


def _vividness(saturation: NDArray[np.uint8], color: str) -> float:
    """Return 0 … 1: whether the most colourful part is paint rather than a tint of grass, shade or brick."""
    vivid = paint.BANDS[color].vivid
    if vivid == 0:
        return 0.8  # colours without colour: size and shape have to decide
    strong = float(np.percentile(saturation, 75))
    return float(np.clip(0.2 + 0.8 * (strong - 0.6 * vivid) / (0.4 * vivid), 0.05, 1.0))


def _solidity(region: paint.Mask, size: Size) -> float:
    """Return 0 … 1: paint is a few large pieces, leaves and grass are many holes."""
    filled = float(region.mean())
    edges = float((region[:, 1:] != region[:, :-1]).sum() + (region[1:] != region[:-1]).sum())
    # edge length over what one plain rectangle of that size would have; windows double it, foliage multiplies it
    rough = edges / (2.0 * sum(region.shape))
    least = 0.3 if size.height_m < 4.0 else 0.2
    return float(np.clip(filled / least, 0.0, 1.0) ** 1.5 * np.clip(4.0 / max(rough, 1e-3), 0.0, 1.0))
