"""Who goes where: the things that several pictures show are told to be the same ones, and each drone gets one of them.

The drones stand a stride apart and look the same way, so their pictures differ by a shift of at most a few metres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

_APART_M = 4.2  # at most between two drones, with what distances are wrong by
_WRONG_M, _WRONG_SHARE = 0.8, 0.09  # that two sightings of one thing may differ by: fixed, and of the distance


@dataclass(frozen=True, slots=True)
class Spotted:
    """A place on the ground as a drone sees it."""

    right_m: float  # of the camera
    ahead_m: float

    @property
    def bearing_rad(self) -> float:
        """From the optical axis, positive to the right."""
        return math.atan2(self.right_m, self.ahead_m)

    @property
    def distance_m(self) -> float:
        """In the plane."""
        return math.hypot(self.right_m, self.ahead_m)


@dataclass(frozen=True, slots=True)
class _Known:
    """A thing in the first drone's terms, and how many pictures show it."""

    spot: Spotted
    seen: int


def divide(views: Sequence[Sequence[Spotted]]) -> list[Spotted | None]:
    """Return each drone's own thing, in that drone's own terms; None when no picture shows any.

    The things are counted from the left, and so are the drones: drone k gets the k-th, and where there are fewer
    things than drones the count begins again. `views` are the sightings of each drone's picture, in picture order.
    """
    order = sorted(range(len(views)), key=lambda k: (-len(views[k]), k))
    known: list[_Known] = []
    shifts = [Spotted(0.0, 0.0)] * len(views)
    for k in order:
        shifts[k] = _shift(known, views[k])
        known = _joined(known, [_moved(s, shifts[k]) for s in views[k]])
    if not known:
        return [None] * len(views)
    chosen = sorted(known, key=lambda one: (-one.seen, one.spot.distance_m))[: len(views)]
    chosen.sort(key=lambda one: one.spot.bearing_rad)
    return [_moved(chosen[k % len(chosen)].spot, _back(shifts[k])) for k in range(len(views))]


def _moved(spot: Spotted, by: Spotted) -> Spotted:
    return Spotted(spot.right_m + by.right_m, spot.ahead_m + by.ahead_m)


def _back(shift: Spotted) -> Spotted:
    return Spotted(-shift.right_m, -shift.ahead_m)


def _gap(one: Spotted, other: Spotted) -> float:
    """Return how far apart two sightings are, in what two sightings of one thing may be: below 1 they are the same."""
    allowed = _WRONG_M + _WRONG_SHARE * min(one.distance_m, other.distance_m)
    return math.hypot(one.right_m - other.right_m, one.ahead_m - other.ahead_m) / allowed


def _pairs(known: Sequence[_Known], seen: Sequence[Spotted]) -> list[tuple[int, int]]:
    """Return which are the same, nearest pairs first, each thing once."""
    gaps = sorted((_gap(one.spot, s), i, j) for i, one in enumerate(known) for j, s in enumerate(seen))
    pairs: list[tuple[int, int]] = []
    for gap, i, j in gaps:
        if gap < 1.0 and all(i != a and j != b for a, b in pairs):
            pairs.append((i, j))
    return pairs


def _shift(known: Sequence[_Known], seen: Sequence[Spotted]) -> Spotted:
    """Return what has to be added to a drone's sightings to lie on those that are known."""
    best, most = Spotted(0.0, 0.0), (0, 0.0)
    for one in known:
        for spot in seen:
            shift = Spotted(one.spot.right_m - spot.right_m, one.spot.ahead_m - spot.ahead_m)
            if math.hypot(shift.right_m, shift.ahead_m) > _APART_M:
                continue
            moved = [_moved(s, shift) for s in seen]
            pairs = _pairs(known, moved)
            score = (len(pairs), -sum(_gap(known[i].spot, moved[j]) for i, j in pairs))
            if score > most:
                best, most = shift, score
    return best


def _joined(known: Sequence[_Known], seen: Sequence[Spotted]) -> list[_Known]:
    pairs = dict(_pairs(known, seen))
    joined = [replace(one, seen=one.seen + 1) if i in pairs else one for i, one in enumerate(known)]
    return joined + [_Known(s, 1) for j, s in enumerate(seen) if j not in pairs.values()]
