"""Suggests a target's path over the ground, an inscription and an instruction to the user of the editor."""

import itertools
import math
from collections.abc import Callable, Sequence

from episodes import maps
from episodes.authoring.check.referring import nouns
from episodes.maps.scene import Scene
from episodes.records.record import HIDDEN, MOVING, EpisodeRecord
from foundation.errors import UsageError
from foundation.frames import Vec3

OFF_M = 0.005  # m, largest distance of a path from the ground, above or below, between two waypoints
STEP_M = 0.25  # m between samples of the ground

Knot = tuple[float, float]  # m north, m east
Knots = tuple[Knot, ...]  # the clicked points of a path


def draped(knots: Sequence[Knot], on_ground: Callable[[float, float], Vec3]) -> tuple[Vec3, ...]:
    """Return waypoints (m, NED) on the ground: the knots, and points between them where the ground bends."""
    points = [on_ground(*knots[0])]
    for a, b in itertools.pairwise(knots):
        count = max(1, math.ceil(math.dist(a, b) / STEP_M))
        shares = [k / count for k in range(count + 1)]
        fine = [on_ground(a[0] + (b[0] - a[0]) * u, a[1] + (b[1] - a[1]) * u) for u in shares]

        def off(i: int, j: int, k: int, fine: Sequence[Vec3] = fine) -> float:
            return abs(fine[k][2] - (fine[i][2] + (fine[j][2] - fine[i][2]) * (k - i) / (j - i)))

        points.extend(fine[k] for k in _needed(len(fine), off, OFF_M)[1:])
    return tuple(points)


def corners(points: Sequence[Knot], off_m: float = 0.002) -> Knots:
    """Return the points of a line, seen from above, without those that are within `off_m` of the remaining line.

    The default of 2 mm keeps the shape, because positions are rounded to 1 mm. Source: Douglas and Peucker, 1973.
    """

    def off(a: int, b: int, k: int) -> float:
        (n0, e0), (n1, e1), (n, e) = points[a], points[b], points[k]
        span = math.dist(points[a], points[b])
        if span < 1e-9:
            return math.dist(points[a], points[k])
        return abs((n1 - n0) * (e - e0) - (e1 - e0) * (n - n0)) / span

    return tuple(points[k] for k in _needed(len(points), off, off_m))


def _needed(count: int, off: Callable[[int, int, int], float], most: float) -> list[int]:
    """Return the indices to keep, so that off(a, b, k) ≤ `most` for each dropped k between kept neighbours a, b."""
    kept = {0, count - 1}
    waiting = [(0, count - 1)]
    while waiting:
        a, b = waiting.pop()
        worst = max(range(a + 1, b), key=lambda k: off(a, b, k), default=a)
        if worst > a and off(a, b, worst) > most:
            kept.add(worst)
            waiting += [(a, worst), (worst, b)]
    return sorted(kept)


LANE_OFF_M = 0.25  # m, largest distance of a suggested path from its lane, so that the path has few points


def way(scene: Scene, record: EpisodeRecord, here: Knot, yaw: float, length_m: float) -> Knots:
    """Return the suggested path of the target: the nearest lane of at least `length_m`.

    Without such a lane, the path is straight ahead, `length_m` long but not beyond the edge of the ground.
    """
    try:
        lanes = [lane for lane in maps.places(record.map, record.map_seed).lanes if lane.length_m >= length_m]
    except UsageError:  # no lanes are known, as for a user's own map
        lanes = []
    if lanes:
        nearest = min(lanes, key=lambda lane: math.dist(lane.waypoints_ned[0][:2], here))
        return corners([(n, e) for n, e, _ in nearest.waypoints_ned], LANE_OFF_M)
    field = scene.terrain
    low = (field.origin_north, field.origin_east)
    high = tuple(low[k] + field.cell_m * (field.down.shape[k] - 1) for k in (0, 1))
    ahead = (math.cos(yaw), math.sin(yaw))
    room = [((high if ahead[k] > 0 else low)[k] - here[k]) / ahead[k] for k in (0, 1) if abs(ahead[k]) > 1e-6]
    reach = max(min(length_m, *room), 1.0)
    return (here, (here[0] + reach * ahead[0], here[1] + reach * ahead[1]))


def inscription(taken: set[str | None]) -> str:
    """Return the first inscription that is not taken."""
    return next(text for k in itertools.count() if (text := f"DC {1000 + 111 * k}") not in taken)


def instruction(record: EpisodeRecord) -> str:
    """Return an instruction that names the target."""
    target, noun = record.target, nouns(record.target.asset)[0]
    if record.cell == "commanding":
        mark = "that says" if target.asset == "sign" else "with the plate"
        return f"go to the {noun} {mark} {target.inscription}"
    verb = "follow" if record.cell in MOVING else "go to"
    if record.cell in HIDDEN:
        verb = "find and follow" if record.cell in MOVING else "find and go to"
    return f"{verb} the {noun}" if target.paint is None else f"{verb} the {target.paint} {noun}"
