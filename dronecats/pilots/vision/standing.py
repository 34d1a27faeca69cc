"""What stands before the drone: every thing of a known kind in a picture, with its place on the ground."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dronecats.pilots.vision import shapes
from dronecats.pilots.vision.paint import Picture

LEAST = -1.3  # logarithm of the odds from which a thing is taken to be there
_APART = 0.40  # logarithm of the ratio of two distances from which two sightings in one direction are two things
_SAME_RAD = 0.02  # so near in direction, two sightings of one kind are one thing whatever its width
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
_LEVEL = 0.3  # m, by which a thing's foot may lie off the level on which the others stand


@dataclass(frozen=True, slots=True)
class PlacedThing:
    """One thing, in the ground plane of the camera."""

    kind: str  # of shapes.KINDS
    depth_m: float  # planar, along the optical axis, to its middle
    right_m: float  # of the optical axis
    below_m: float  # of the camera, its foot
    odds: float  # logarithm, of being this rather than nothing

    @property
    def distance_m(self) -> float:
        """m in plan, from the camera."""
        return math.hypot(self.depth_m, self.right_m)


def half_width_m(kind: str) -> float:
    """Return about how far (m) a thing reaches from its middle."""
    return _HALF_WIDTH_M.get(kind, _USUAL_HALF_WIDTH_M)


def find(picture: Picture, kinds: Iterable[str], network: shapes.Network) -> list[PlacedThing]:
    """Return the things of these kinds in a picture (H, W, 3), BGR and 90° across, the surest first.

    Neighbouring windows see the same thing at other distances and from other heights; it is where they put it on
    average, each as far as it is sure.
    """
    seen = _sightings(picture, tuple(kinds), network)
    level = _level(seen)
    groups: list[list[PlacedThing]] = []
    for one in sorted((s for s in seen if abs(s.below_m - level) <= _LEVEL), key=lambda s: -s.odds):
        group = next((g for g in groups if _same(one, g[0])), None)
        if group is None:
            groups.append([one])
        elif one.kind == group[0].kind:
            group.append(one)
    return [_together(group) for group in groups]


def _together(group: list[PlacedThing]) -> PlacedThing:
    """Return one thing for all sightings of it, the surest of which is the first."""
    first = group[0]
    weight = [math.exp(one.odds - first.odds) for one in group]
    total = sum(weight)
    depth = math.exp(sum(w * math.log(one.depth_m) for w, one in zip(weight, group, strict=True)) / total)
    aside = sum(w * one.right_m / one.depth_m for w, one in zip(weight, group, strict=True)) / total
    below = sum(w * one.below_m for w, one in zip(weight, group, strict=True)) / total
    return PlacedThing(first.kind, depth, aside * depth, below, first.odds)


def _sightings(picture: Picture, kinds: tuple[str, ...], network: shapes.Network) -> list[PlacedThing]:
    """Return what the windows hold that hold more of a kind than their neighbours."""
    found: list[PlacedThing] = []
    wanted = [(kind, shapes.KINDS.index(kind)) for kind in kinds]
    for strip in shapes.strips(picture):
        rights = strip.rights_m()
        for height, below in enumerate(shapes.HEIGHTS_M):
            share = network.shares(strip.windows(height))
            for kind, k in wanted:
                odds = np.log(share[:, k] / (1.0 - share[:, k] + 1e-6) + 1e-6)
                padded = np.pad(odds, 1, constant_values=-np.inf)
                peak = (odds >= LEAST) & (odds >= padded[:-2]) & (odds > padded[2:])
                for column in np.flatnonzero(peak):
                    found.append(PlacedThing(kind, strip.depth_m, float(rights[column]), below, float(odds[column])))
    return found


def _level(seen: list[PlacedThing]) -> float:
    """Return how far (m) under the camera things stand: the height for which most speaks."""
    if not seen:
        return 1.6
    for_each = {h: sum(s.odds - LEAST for s in seen if s.below_m == h) for h in shapes.HEIGHTS_M}
    total = sum(v * v for v in for_each.values()) or 1.0
    return sum(h * v * v for h, v in for_each.items()) / total


def _same(one: PlacedThing, other: PlacedThing) -> bool:
    """Return whether two sightings are of one thing, or of what stands in one place."""
    if abs(math.log(one.depth_m / other.depth_m)) > _APART:
        return False
    half = half_width_m(other.kind) if one.kind == other.kind else 0.5 * _USUAL_HALF_WIDTH_M
    aside = abs(one.right_m / one.depth_m - other.right_m / other.depth_m)
    return aside <= max(_SAME_RAD, half / other.depth_m)
