"""Finds the free places of the residential neighbourhood: kerbs, drives, lawns, and lanes to drive or walk along."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from episodes.maps import residential_plan as plan
from episodes.maps.residential import KERBSIDE_OUT, Furnishing, bays, furnishings, heading
from episodes.maps.residential_plan import LOWER, MAIN, SECOND, UPPER, Plot, Street
from episodes.maps.scene import Array, Lane, Places, Spot
from foundation.frames import Vec3, course

# place → length and width (m) that must be free
ROOM = {"kerb": (5.9, 2.2), "bus stop": (12.0, 2.6), "drive": (5.9, 2.2), "lawn": (2.0, 2.0), "pavement": (1.2, 1.2)}
GAP = 0.4  # m, free space around an object on a spot; at a kerb, only ahead and behind
TALLEST = 2.4  # m; parts above this height (crowns of trees, arms of lamps) are no obstacles
LANE_OFFSET_M = 0.6  # m, offset of lanes to the right of the centre line
TURN = 6.0  # m, radius of a lane at a corner
DRIVE_TURN = 3.4  # m, radius of a lane out of a drive
LANE_LENGTH_M = 108.0  # a target covers less: 90 m in 300 s at the paper's 0.3 m/s
POINT_SPACING_M = 0.25  # m between the points of a lane before it is thinned
LANE_TOLERANCE_M = 0.008  # m, greatest distance from a thinned lane to the points left out
LANE_WIDTH = {"road": 2.4, "drive": 2.2, "pavement": 1.2}  # m, by kind of lane


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Footprints of all furnishings: rectangles of any direction."""

    middle: Array  # (N, 2) m, north and east
    half: Array  # (N, 2) m, along and across `yaw`
    yaw: Array  # (N,) rad

    def hit(self, north: float, east: float, yaw: float, length: float, width: float) -> bool:
        """Return whether a rectangle overlaps any footprint (separating axis test)."""
        gap = self.middle - (north, east)
        near = np.hypot(gap[:, 0], gap[:, 1]) < np.hypot(*self.half.T) + math.hypot(length, width) / 2
        if not near.any():
            return False
        gap, half, turn = gap[near], self.half[near], self.yaw[near]
        apart = np.zeros(len(gap), dtype=bool)
        axes = np.stack([np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)], axis=1).reshape(-1, 2, 2)
        own_axes = np.array([(math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))])
        reach = np.array((length / 2, width / 2))
        for axis in (axes[:, 0], axes[:, 1], *(np.broadcast_to(m, gap.shape) for m in own_axes)):
            span = np.abs(np.einsum("nk,nak->na", axis, axes)) * half
            own = np.abs(axis @ own_axes.T) @ reach
            apart |= np.abs(np.einsum("nk,nk->n", gap, axis)) > span.sum(axis=1) + own
        return bool((~apart).any())


def _footprints(meshes: Sequence[Furnishing]) -> _Boxes:
    """Return the ground that all furnishings cover, without parts above TALLEST."""
    middle, half, yaw = [], [], []
    for placed in meshes:
        low_part = placed.mesh.vertices[placed.mesh.vertices[:, 2] > -TALLEST, :2]
        low, high = low_part.min(axis=0).astype(float), low_part.max(axis=0).astype(float)
        c, s = math.cos(placed.yaw), math.sin(placed.yaw)
        x, y = (low + high) / 2
        middle.append((placed.north + c * x - s * y, placed.east + s * x + c * y))
        half.append((high - low) / 2)
        yaw.append(placed.yaw)
    return _Boxes(np.array(middle), np.array(half), np.array(yaw))


def _spots(homes: tuple[Plot, ...]) -> Iterator[tuple[str, float, float, float]]:
    """Yield (place, north, east, yaw) of every spot, free or not."""
    for way, along, side in bays(homes):
        yield "kerb", *way.at(along, side * KERBSIDE_OUT), heading(way, side)
    for way, side in ((UPPER, -1), (LOWER, 1)):
        for along in (22.0, 42.0):
            yield "bus stop", *way.at(along, side * 2.6), heading(way, side)
    for plot in homes:
        yield "drive", *plot.at(plot.drive, 10.5), plot.yaw + math.pi
        off = math.copysign(1.0, plot.along - plot.drive)
        for along in (plot.along + 1.5 * off, plot.along + 4.5 * off, plot.along + 7.5 * off):
            yield "lawn", *plot.at(along, 10.3), plot.yaw
        for along in (plot.along - 6.0, plot.along, plot.along + 6.0):
            yield "pavement", *plot.at(along, 6.25), plot.yaw


def _loop(clockwise: bool) -> list[tuple[float, float]]:
    """Return the corners (north, east) of the way round the block, on the right of the road."""
    inset = LANE_OFFSET_M if clockwise else -LANE_OFFSET_M
    low, high, west, east = LOWER.middle + inset, UPPER.middle - inset, MAIN.middle + inset, SECOND.middle - inset
    ring = [(low, west), (high, west), (high, east), (low, east)]
    return ring if clockwise else [ring[0], *ring[:0:-1]]


def _onward(start: tuple[float, float], yaw: float, clockwise: bool) -> list[tuple[float, float]]:
    """Return the next three corners round the block from `start` in the direction `yaw` (rad); [] if there are none."""
    ring = _loop(clockwise)
    for k in range(4):
        a, b = ring[k], ring[(k + 1) % 4]
        if abs(math.remainder(course(a, b) - yaw, 2 * math.pi)) < 0.1:
            ahead = (b[0] - start[0]) * math.cos(yaw) + (b[1] - start[1]) * math.sin(yaw)
            if ahead > 2 * TURN:
                return [ring[(k + j) % 4] for j in range(1, 4)]
    return []


def _rounded(corners: Sequence[tuple[float, float]], radii: Sequence[float]) -> Array:
    """Return points (N, 2) every POINT_SPACING_M along the lines through `corners`, rounded by arcs of `radii` (m)."""
    ways: list[Array] = [np.array([corners[0]])]
    for before, corner, after, radius in zip(corners, corners[1:], corners[2:], radii, strict=False):
        p, q, r = np.array(before), np.array(corner), np.array(after)
        back, on = (p - q) / np.linalg.norm(p - q), (r - q) / np.linalg.norm(r - q)
        turn = math.acos(float(np.clip(back @ on, -1.0, 1.0)))
        reach = radius / math.tan(turn / 2)
        centre = q + (back + on) / np.linalg.norm(back + on) * radius / math.sin(turn / 2)
        first, last = q + back * reach - centre, q + on * reach - centre
        share = np.linspace(0.0, 1.0, 2 + int(radius * (math.pi - turn) / POINT_SPACING_M))[:, None]
        span = math.pi - turn
        ways.append(centre + (np.sin((1 - share) * span) * first + np.sin(share * span) * last) / math.sin(span))
    ways.append(np.array([corners[-1]]))
    points = np.concatenate(ways)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    along = np.linspace(0.0, reached[-1], 1 + math.ceil(reached[-1] / POINT_SPACING_M))
    return np.column_stack([np.interp(along, reached, points[:, k]) for k in (0, 1)])


def _thinned(points: Array, loose: float = LANE_TOLERANCE_M) -> Array:
    """Return some of the points (N, 3); their polyline is within `loose` (m) of all points (Douglas and Peucker)."""
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    todo = [(0, len(points) - 1)]
    while todo:
        a, b = todo.pop()
        if b - a < 2:
            continue
        line = points[b] - points[a]
        between = points[a + 1 : b] - points[a]
        share = np.clip(between @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
        off = np.linalg.norm(between - share[:, None] * line, axis=1)
        worst = int(np.argmax(off))
        if off[worst] > loose:
            keep[a + 1 + worst] = True
            todo += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return points[keep]


def _routes(homes: tuple[Plot, ...]) -> Iterator[tuple[str, str, Array]]:
    """Yield (kind, name, points (N, 2)) of every lane, free or not, before it is cut to LANE_LENGTH_M."""
    for clockwise in (True, False):
        ring = _loop(clockwise)
        lap = np.concatenate([[0.0], np.cumsum([math.dist(a, b) for a, b in itertools.pairwise([*ring, ring[0]])])])
        for k, begin in enumerate(np.arange(12.0, lap[-1] - 6.0, 16.0)):
            leg = int(np.searchsorted(lap, begin, side="right")) - 1
            left = lap[leg + 1] - begin
            if left < TURN + 2.0:
                continue  # no lane begins in a corner
            a, b = ring[leg], ring[(leg + 1) % 4]
            share = (begin - lap[leg]) / math.dist(a, b)
            start = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
            corners = [start, *(ring[(leg + j) % 4] for j in range(1, 4))]
            sense = "clockwise" if clockwise else "anticlockwise"
            yield "road", f"round the block, {sense}, {k + 1}", _rounded(corners, (TURN, TURN))
    for way in (UPPER, LOWER):
        for side in (1, -1):
            yaw = heading(way, side)
            low, high = way.ends[0] + 4.0, way.ends[1] - 4.0
            ends = (low, high) if yaw > 0.0 else (high, low)
            for k, shift in enumerate((0.0, 24.0, 48.0)):
                begin = ends[0] + math.copysign(shift, yaw)
                bound = "eastbound" if yaw > 0.0 else "westbound"
                points = _rounded([way.at(begin, side * LANE_OFFSET_M), way.at(ends[1], side * LANE_OFFSET_M)], ())
                yield "road", f"{way.name}, {bound}, {k + 1}", points
    for plot in homes:
        for turn in ("left", "right"):
            way_out = _from_drive(plot, turn)
            if way_out is not None:
                yield "drive", f"from drive {plot.number + 1}, to the {turn}", way_out
    for number, (way, side, low, high) in enumerate(_walks(), 1):
        for name, (first, last) in (("there", (low, high)), ("back", (high, low))):
            points = _rounded([way.at(first, side * 6.25), way.at(last, side * 6.25)], ())
            where = ("east" if side > 0 else "west") if way.north else ("north" if side > 0 else "south")
            yield "pavement", f"{way.name}, {where} pavement {number}, {name}", points


def _walks() -> Iterator[tuple[Street, int, float, float]]:
    for way in (MAIN, SECOND):
        for side in (-1, 1):
            yield way, side, -56.0, 56.0
    for way, side in ((UPPER, 1), (LOWER, -1)):
        yield way, side, -50.0, 60.0
        yield way, side, 4.0, 114.0


def _from_drive(plot: Plot, turn: str) -> Array | None:
    """Return the points of a lane out of a drive and along the road; None if no road goes on for LANE_LENGTH_M."""
    out = plot.yaw
    yaw = math.remainder(out + (math.pi / 2 if turn == "right" else -math.pi / 2), 2 * math.pi)
    lane = LANE_OFFSET_M if math.cos(heading(plot.street, 1) - yaw) > 0.5 else -LANE_OFFSET_M
    join = plot.street.at(plot.drive, lane)
    begin = plot.at(plot.drive, 10.5)
    for clockwise in (True, False):
        corners = _onward(join, yaw, clockwise)
        ring = _loop(clockwise)
        on_ring = any(abs(join[plot.street.north] - p[plot.street.north]) < 0.01 for p in ring)
        inside = plot.street.north or 0.0 < join[1] < SECOND.middle
        if corners and on_ring and inside:
            return _rounded([begin, join, *corners[:2]], (DRIVE_TURN, TURN))
    end = plot.street.ends[1] - 4.0 if math.sin(yaw) > 0.0 else plot.street.ends[0] + 4.0
    if plot.street.north or abs(end - plot.drive) < LANE_LENGTH_M:
        return None
    return _rounded([begin, join, plot.street.at(end, lane)], (DRIVE_TURN,))


def _cut(points: Array, length: float) -> Array:
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return points[reached <= length]


def _free(points: Array, width: float, taken: _Boxes) -> bool:
    """Return whether an object of this width can follow the points without touching a footprint."""
    step = points[:: round(1.0 / POINT_SPACING_M)]
    for a, b in itertools.pairwise(step):
        yaw = math.atan2(b[1] - a[1], b[0] - a[0])
        if taken.hit(float(a[0] + b[0]) / 2, float(a[1] + b[1]) / 2, yaw, 1.6, width):
            return False
    return True


def places(seed: int = 1) -> Places:
    """Return the free spots and lanes of the map that `residential.build` makes from the same seed."""
    homes = plan.plots(seed)
    ground = plan.terrain(homes)
    taken = _footprints(furnishings(homes, seed, ground))

    def on_ground(north: float, east: float) -> Vec3:
        return (round(north, 3), round(east, 3), round(ground.at(round(north, 3), round(east, 3)), 4))

    spots = []
    for place, north, east, yaw in _spots(homes):
        length, width = ROOM[place]
        if not taken.hit(north, east, yaw, length + 2 * GAP, width + 2 * GAP * (place != "kerb")):
            spots.append(Spot(on_ground(north, east), math.remainder(yaw, 2 * math.pi), place))
    lanes = []
    for kind, name, points in _routes(homes):
        route = _cut(points, LANE_LENGTH_M)
        reach = float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())
        if reach < LANE_LENGTH_M - 1.0 or not _free(route, LANE_WIDTH[kind], taken):
            continue
        laid = np.array([on_ground(float(n), float(e)) for n, e in route])
        way = tuple((float(n), float(e), float(d)) for n, e, d in _thinned(laid))
        lanes.append(Lane(name, way, LANE_WIDTH[kind]))
    return Places(tuple(spots), tuple(lanes))
