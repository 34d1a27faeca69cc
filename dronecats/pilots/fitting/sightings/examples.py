"""Rectangles to learn from: what each patch of a colour is, is known from where the target's pixels are."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.sightings.neighbourhoods import NOUNS, PAINTS, Target
from dronecats.pilots.vision import color_detector
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.command import read_referent
from dronecats.pilots.vision.ranging import BoundingBox

# Intersection over union from which a rectangle is the target; share of it in the target's up to which it is not.
# What is between, as one door of a bus, is no example.
IS, IS_NOT = 0.5, 0.2
OTHERS = 4  # instructions of each picture whose target is not there
LIKE_BRICK = ("brown", "red", "orange")  # asked for more often: houses and fences have them


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Rectangles and what they are."""

    seen: NDArray[np.float16]  # (N, likeness.LENGTH)
    there: NDArray[np.float32]  # (N,) 1: the target, 0: anything else
    factor: NDArray[np.float32]  # (N,) logarithm, true distance over the one by size; 0 of anything else


def joined(each: Iterable[Examples]) -> Examples:
    """Return all of them as one."""
    every = list(each)
    return Examples(*(np.concatenate([getattr(e, name) for e in every]) for name in ("seen", "there", "factor")))


def draw(picture: Picture, target: Target, rng: np.random.Generator) -> Examples:
    """Return the rectangles of one picture's own instruction and of some others."""
    asked = [(target.asset, target.paint)]
    while len(asked) <= OTHERS:
        paints = LIKE_BRICK if rng.random() < 0.5 else PAINTS
        other = (str(rng.choice(list(NOUNS))), str(rng.choice(paints)))
        if other[1] != target.paint:
            asked.append(other)
    seen, there, factor = [], [], []
    for asset, paint in asked:
        found, examples = color_detector.color_patches(picture, read_referent(f"go to the {paint} {NOUNS[asset]}"))
        lies = [shares(one.box, target.box, picture.shape[:2]) for one in found]
        mine = (asset, paint) == (target.asset, target.paint)
        for one, (union, inside), example in zip(found, lies, examples, strict=True):
            is_it = inside > IS_NOT
            if (mine and union >= IS) or not is_it:
                seen.append(example)
                there.append(float(is_it))
                factor.append(np.log(target.distance_m / one.range.distance_m) if is_it else 0.0)
    rows = np.array(seen, np.float16).reshape(-1, color_detector.LENGTH)
    return Examples(rows, np.array(there, np.float32), np.array(factor, np.float32))


def shares(box: BoundingBox, true: tuple[int, int, int, int] | None, shape: tuple[int, int]) -> tuple[float, float]:
    """Return how much of their union two rectangles have in common, and how much of the first lies in the second."""
    if true is None:
        return 0.0, 0.0
    height, width = shape
    left, right = ((x + 0.5) * width for x in (box.left, box.right))
    top, bottom = (y * width + 0.5 * height for y in (box.top, box.bottom))
    wide = max(0.0, min(right, true[2]) - max(left, true[0]))
    common = wide * max(0.0, min(bottom, true[3]) - max(top, true[1]))
    own, other = (right - left) * (bottom - top), (true[2] - true[0]) * (true[3] - true[1])
    return common / max(1e-9, own + other - common), common / max(1e-9, own)
