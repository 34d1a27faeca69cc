"""Assigns to each drone of a fleet one of the things that the drones' pictures show.

The drones are about a stride apart and have the same heading. Their coordinate frames therefore differ by a shift of a
few metres at most.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

_APART_M = 4.2  # largest shift between two drones' frames, including the error of the estimates
# two drones see one thing at points that differ by less than _TOLERANCE_M + _TOLERANCE_PER_M × the thing's distance
_TOLERANCE_M, _TOLERANCE_PER_M = 0.8, 0.09

Color = tuple[float, ...]  # (3,) CIE Lab on OpenCV's 8-bit scale


@dataclass(frozen=True, slots=True)
class GroundPoint:
    """A point on the ground, in the frame of one drone's camera."""

    right_m: float  # right of the optical axis
    ahead_m: float  # along the optical axis

    def __add__(self, shift: "GroundPoint") -> "GroundPoint":
        return GroundPoint(self.right_m + shift.right_m, self.ahead_m + shift.ahead_m)

    def __sub__(self, other: "GroundPoint") -> "GroundPoint":
        return GroundPoint(self.right_m - other.right_m, self.ahead_m - other.ahead_m)

    @property
    def bearing_rad(self) -> float:
        """The angle from the optical axis, positive to the right."""
        return math.atan2(self.right_m, self.ahead_m)

    @property
    def distance_m(self) -> float:
        """The distance in the ground plane."""
        return math.hypot(self.right_m, self.ahead_m)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A thing in one drone's picture that may carry the wanted inscription."""

    left: int  # px
    top: int  # px
    right: int  # px
    bottom: int  # px
    spot: GroundPoint
    score: float = 1.0  # 0 … 1, similarity to the wanted kind
    color: Color = ()  # median colour of the face; only for boards

    @property
    def middle(self) -> float:
        """The column (px) of the rectangle's middle."""
        return 0.5 * (self.left + self.right)

    @property
    def size_px(self) -> float:
        """The side (px) of a square with the rectangle's area."""
        return math.sqrt((self.right - self.left) * (self.bottom - self.top))


@dataclass(frozen=True, slots=True)
class _SharedThing:
    """A thing and the number of pictures with it. `spot` is in the frame of the drone that sees the most things."""

    spot: GroundPoint
    views: int


def assign_things(views: Sequence[Sequence[GroundPoint]]) -> list[GroundPoint | None]:
    """Return the thing that each drone flies to, in that drone's frame; all None if no picture shows a thing.

    Drone k gets the k-th thing from the left. If there are more things than drones, things that few pictures show are
    left out; if there are fewer, the order starts again at the left.
    """
    order = sorted(range(len(views)), key=lambda k: (-len(views[k]), k))
    shared: list[_SharedThing] = []
    shifts = [GroundPoint(0.0, 0.0)] * len(views)
    for k in order:
        shifts[k] = _shift(shared, views[k])
        shared = _joined(shared, [s + shifts[k] for s in views[k]])
    if not shared:
        return [None] * len(views)
    chosen = sorted(shared, key=lambda candidate: (-candidate.views, candidate.spot.distance_m))[: len(views)]
    chosen.sort(key=lambda candidate: candidate.spot.bearing_rad)
    return [chosen[k % len(chosen)].spot - shifts[k] for k in range(len(views))]


def _gap(point: GroundPoint, reference: GroundPoint) -> float:
    """Return the distance of two points divided by the tolerance. Below 1 the points are of the same thing."""
    allowed = _TOLERANCE_M + _TOLERANCE_PER_M * min(point.distance_m, reference.distance_m)
    return (point - reference).distance_m / allowed


def _pairs(shared: Sequence[_SharedThing], points: Sequence[GroundPoint]) -> list[tuple[int, int]]:
    """Return the pairs (index in shared, index in points) of the same thing, nearest pairs first, each index once."""
    gaps = sorted((_gap(candidate.spot, s), i, j) for i, candidate in enumerate(shared) for j, s in enumerate(points))
    pairs: list[tuple[int, int]] = []
    for gap, i, j in gaps:
        if gap < 1.0 and all(i != a and j != b for a, b in pairs):
            pairs.append((i, j))
    return pairs


def _shift(shared: Sequence[_SharedThing], points: Sequence[GroundPoint]) -> GroundPoint:
    """Return the shift that moves a drone's points best onto the shared things."""
    best, most = GroundPoint(0.0, 0.0), (0, 0.0)
    for candidate in shared:
        for spot in points:
            shift = candidate.spot - spot
            if shift.distance_m > _APART_M:
                continue
            moved = [s + shift for s in points]
            pairs = _pairs(shared, moved)
            score = (len(pairs), -sum(_gap(shared[i].spot, moved[j]) for i, j in pairs))
            if score > most:
                best, most = shift, score
    return best


def _joined(shared: Sequence[_SharedThing], points: Sequence[GroundPoint]) -> list[_SharedThing]:
    pairs = dict(_pairs(shared, points))
    joined = [replace(seen, views=seen.views + 1) if i in pairs else seen for i, seen in enumerate(shared)]
    return joined + [_SharedThing(s, 1) for j, s in enumerate(points) if j not in pairs.values()]
