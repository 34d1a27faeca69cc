"""The geofence: polygons and circles to stay in or out of, and the cylinder of GF_MAX_HOR_DIST and GF_MAX_VER_DIST.

As on PX4 a place must lie in at least one inclusion area, if there is any, and in no exclusion area.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from autopilot.commander.plan.items import Home, PlanItem, horizontal
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from foundation.frames import Vec3
from foundation.mavlink import dialect
from foundation.polygon import Point, contains

RETURN_POINT = int(dialect.MAV_CMD_NAV_FENCE_RETURN_POINT)
POLYGON_IN = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
POLYGON_OUT = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
CIRCLE_IN = int(dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)
CIRCLE_OUT = int(dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
POLYGONS = frozenset({POLYGON_IN, POLYGON_OUT})
COMMANDS = POLYGONS | {RETURN_POINT, CIRCLE_IN, CIRCLE_OUT}
MOST_VERTICES = 250


@dataclass(frozen=True, slots=True)
class FenceArea:
    """A polygon (vertices) or a circle (one centre and a radius)."""

    inclusion: bool
    vertices: tuple[Point, ...]
    radius: float = 0.0  # m, circles only

    def contains(self, north: float, east: float) -> bool:
        """Return whether the point lies inside."""
        if len(self.vertices) == 1:
            centre = self.vertices[0]
            return math.hypot(north - centre[0], east - centre[1]) < self.radius
        return contains(self.vertices, (north, east))


def well_formed(items: tuple[PlanItem, ...]) -> bool:
    """Return whether every polygon has as many consecutive vertices as its first one announces, and at least three."""
    i = 0
    while i < len(items):
        item = items[i]
        if item.command not in POLYGONS:
            i += 1
            continue
        count = item.p[0]
        if not 3 <= count <= MOST_VERTICES or i + int(count) > len(items):
            return False
        if any((v.command, v.p[0]) != (item.command, count) for v in items[i : i + int(count)]):
            return False
        i += int(count)
    return True


def areas(items: tuple[PlanItem, ...], state: EstimatedState) -> tuple[FenceArea, ...]:
    """Return the areas of a well-formed fence in the local frame."""
    found: list[FenceArea] = []
    i = 0
    while i < len(items):
        item = items[i]
        count = int(item.p[0]) if item.command in POLYGONS else 1
        if item.command != RETURN_POINT:
            # a place of (0, 0) is a real one here, though no vehicle is near it
            points = tuple(horizontal(v.x * 1e-7, v.y * 1e-7, state) for v in items[i : i + count])
            radius = item.p[0] if item.command not in POLYGONS else 0.0
            found.append(FenceArea(item.command in (POLYGON_IN, CIRCLE_IN), points, radius))
        i += count
    return tuple(found)


class Fence:
    """The areas in force, worked out once per plan and origin."""

    def __init__(self) -> None:
        self._of: tuple[int, float, float] | None = None
        self._areas: tuple[FenceArea, ...] = ()

    def areas(self, version: int, items: tuple[PlanItem, ...], state: EstimatedState) -> tuple[FenceArea, ...]:
        """Return the areas of the plan in force, whose `version` tells it from others."""
        key = (version, state.origin_lat_deg, state.origin_lon_deg)
        if key != self._of:
            self._of, self._areas = key, areas(items, state)
        return self._areas


def breach(place_ned: Vec3, home: Home | None, p: ParameterTable, areas: Iterable[FenceArea]) -> str:
    """Return which limit a local place breaks: 'height', 'distance' or 'area'; empty when none."""
    if home is not None:
        n, e, z = home.position_ned
        if 0.0 < p["GF_MAX_VER_DIST"] < z - place_ned[2]:
            return "height"
        if 0.0 < p["GF_MAX_HOR_DIST"] < math.hypot(place_ned[0] - n, place_ned[1] - e):
            return "distance"
    inclusions = [area for area in areas if area.inclusion]
    exclusions = [area for area in areas if not area.inclusion]
    if inclusions and not any(area.contains(place_ned[0], place_ned[1]) for area in inclusions):
        return "area"
    return "area" if any(area.contains(place_ned[0], place_ned[1]) for area in exclusions) else ""
