"""Windows to learn from: what each holds is known from where the things of a picture stand."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.shapes.campuses import Shown
from dronecats.pilots.vision import shape_detector
from dronecats.pilots.vision.colors import Picture

# A window holds a thing that stands about in its middle, at about its distance and as far under the camera …
HOLDS = (0.10, 0.36, 0.17)  # logarithm of the distance, m aside, m of height
# … is neither an example nor a counter-example where it stands near that …
NEAR = (0.26, 0.90, 0.40)
# … and what a network mistakes is no counter-example where a part of the thing itself is to be seen: places are told
# apart by which window is the surest
ABOUT = (0.60, 1.6, 0.80)
WIDE_M = {"fountain": 1.8, "tiered-fountain": 1.8, "clock-tower": 1.8, "kiosk": 1.3, "bike-rack": 1.3}  # near, aside
SEEN = (
    0.15,
    0.40,
)  # of the pixels a thing has where nothing hides it: less is nothing, less than the second no example
UNSAID = -1
ASKEW = 12  # windows of a picture that show a thing from where it does not stand
MOST_OF_A_ROW = 6  # windows of one distance and height that are taken for a mistake each
USUAL_WINDOWS = 5000.0  # of a picture


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Windows and what they hold."""

    windows: NDArray[np.float16]  # (N, rows · columns · CHANNELS)
    kinds: NDArray[np.int8]  # (N,) index into shapes.KINDS


def labels(
    strip: shape_detector.Strip,
    height: int,
    shown: Iterable[Shown],
    usual: dict[str, float],
    near_by: tuple[float, float, float] = NEAR,
) -> NDArray[np.int8]:
    """Return for each window of a strip the kind it holds, 0 for none, UNSAID where it cannot be said."""
    right = strip.rights_m()
    said = np.zeros(len(right), np.int8)
    off = np.full(len(right), np.inf)
    for one in shown:
        if one.kind not in shape_detector.KINDS:
            continue
        share = one.pixels / (one.whole * usual[one.kind])
        by = (
            abs(np.log(one.depth_m / strip.depth_m)),
            np.abs(right - one.right_m * strip.depth_m / one.depth_m),
            abs(one.below_m - shape_detector.HEIGHTS_M[height]),
        )
        # at another distance the same direction is as many metres more aside, and the same row as many more below
        if share < SEEN[0] or by[0] > near_by[0] or by[2] > near_by[2]:
            continue
        near = by[1] < max(WIDE_M.get(one.kind, 0.0), near_by[1])
        held = by[1] < HOLDS[1] if by[0] < HOLDS[0] and by[2] < HOLDS[2] and share >= SEEN[1] else np.zeros_like(near)
        far = by[0] / HOLDS[0] + by[1] / HOLDS[1] + by[2] / HOLDS[2]
        said[near & ~held & (said == 0)] = UNSAID
        better = held & (far < off)
        said[better] = shape_detector.KINDS.index(one.kind)
        off[better] = far[better]
    return said


def draw(
    picture: Picture,
    shown: tuple[Shown, ...],
    usual: dict[str, float],
    rng: np.random.Generator,
    others: int,
    network: shape_detector.ShapeNetwork | None = None,
) -> Examples:
    """Return windows of one picture: all that hold something, and `others` that do not.

    With a network the latter are those that it takes most for something, and besides there are ASKEW that show a thing
    from a place where it does not stand.
    """
    windows, kinds = list[NDArray[np.float16]](), list[NDArray[np.int8]]()
    empty, rank, askew = list[NDArray[np.float16]](), list[NDArray[np.float64]](), list[NDArray[np.float16]]()
    for strip in shape_detector.strips(picture):
        for height in range(len(shape_detector.HEIGHTS_M)):
            said = labels(strip, height, shown, usual)
            holds = np.flatnonzero(said > 0)
            nothing = np.flatnonzero(said == 0)
            if network is None:
                nothing = nothing[rng.random(len(nothing)) < others / USUAL_WINDOWS]
            if not len(holds) and not len(nothing):
                continue
            seen = strip.windows(height)
            windows.append(seen[holds].astype(np.float16))
            kinds.append(said[holds])
            if network is None:
                empty.append(seen[nothing].astype(np.float16))
                rank.append(rng.random(len(nothing)))
                continue
            about = labels(strip, height, shown, usual, ABOUT)[nothing] != 0
            askew.append(seen[rng.permutation(nothing[about])[:1]].astype(np.float16))
            clear = nothing[~about]
            mistaken = 1.0 - network.probabilities(seen[clear])[:, 0]
            worst = np.argsort(-mistaken)[:MOST_OF_A_ROW]
            empty.append(seen[clear[worst]].astype(np.float16))
            rank.append(-mistaken[worst].astype(np.float64))
    chosen = np.concatenate(empty)[np.argsort(np.concatenate(rank), kind="stable")[:others]]
    beside = rng.permutation(np.concatenate(askew))[:ASKEW] if askew else chosen[:0]
    none = np.concatenate((chosen, beside))
    return Examples(np.concatenate((*windows, none)), np.concatenate((*kinds, np.zeros(len(none), np.int8))))
