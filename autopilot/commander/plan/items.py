"""One item of a plan, as MISSION_ITEM_INT carries it, the home position, and where an item is in the local frame."""

import math
from dataclasses import dataclass

from autopilot.estimator.estimated_state import EstimatedState
from foundation.frames import Vec3, geodetic_to_ned
from foundation.mavlink import dialect

MOVED_HORIZONTAL_M = 1.0
MOVED_VERTICAL_M = 0.5


@dataclass(frozen=True, slots=True)
class Home:
    """Where the vehicle returns to."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad
    lat_deg: float
    lon_deg: float
    alt_m: float  # m above mean sea level


def home_at(state: EstimatedState, position_ned: Vec3 | None = None) -> Home | None:
    """Return a home at a local position (m), here by default; None while the global position is not known."""
    if not state.global_valid:
        return None
    place = position_ned or state.position_ned
    return Home(place, state.yaw, *state.geodetic(place))


def moved(home: Home, state: EstimatedState) -> bool:
    """Return whether the vehicle stands clearly elsewhere, so that home should follow it while it is disarmed."""
    n, e, z = state.position_ned
    away = math.hypot(n - home.position_ned[0], e - home.position_ned[1])
    return away > MOVED_HORIZONTAL_M or abs(z - home.position_ned[2]) > MOVED_VERTICAL_M


MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE
KINDS = (MISSION, FENCE, RALLY)
NOT_GIVEN = (1 << 31) - 1  # INT32_MAX in x or y
DEGREES = 1e-7

FRAME_MISSION = int(dialect.MAV_FRAME_MISSION)
ABOVE_SEA = frozenset({int(dialect.MAV_FRAME_GLOBAL), int(dialect.MAV_FRAME_GLOBAL_INT)})
ABOVE_HOME = frozenset({int(dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT), int(dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)})
GLOBAL_FRAMES = ABOVE_SEA | ABOVE_HOME


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One item. x and y are kept as they came, so that a download returns the very bits of the upload."""

    command: int  # MAV_CMD
    frame: int  # MAV_FRAME
    p: tuple[float, float, float, float]
    x: int  # 1e-7 deg of latitude in the global frames
    y: int  # 1e-7 deg of longitude
    z: float  # m, above sea level or home as the frame says
    autocontinue: int = 1

    @property
    def lat_deg(self) -> float:
        """Latitude, nan where the item names no place."""
        return math.nan if self._nowhere else self.x * DEGREES

    @property
    def lon_deg(self) -> float:
        """Longitude, nan where the item names no place."""
        return math.nan if self._nowhere else self.y * DEGREES

    @property
    def _nowhere(self) -> bool:
        # (0, 0) is what clients send for 'where you are' in landings and take-offs
        return NOT_GIVEN in (self.x, self.y) or (self.x == 0 and self.y == 0)


def horizontal(lat_deg: float, lon_deg: float, state: EstimatedState) -> tuple[float, float]:
    """Return (north, east) in m of a place in the local frame, nan for nan."""
    if not (math.isfinite(lat_deg) and math.isfinite(lon_deg)):
        return (math.nan, math.nan)
    north, east, _ = geodetic_to_ned(state.origin_lat_deg, state.origin_lon_deg, 0.0, lat_deg, lon_deg, 0.0)
    return (north, east)


def local_place(item: PlanItem, state: EstimatedState, home: Home | None) -> Vec3:
    """Return the item's place in the local frame (m, NED), nan for what it does not say or what has no reference."""
    if item.frame not in GLOBAL_FRAMES:
        return (math.nan, math.nan, math.nan)
    north, east = horizontal(item.lat_deg, item.lon_deg, state)
    if not abs(item.z) < 1e5:
        return (north, east, math.nan)
    if item.frame in ABOVE_HOME:
        return (north, east, home.position_ned[2] - item.z if home is not None else math.nan)
    return (north, east, state.origin_alt_m - item.z)
