"""The home position: where it is set, and when the vehicle has been carried away from it."""

import math
from dataclasses import dataclass

from autopilot.estimator.estimated_state import EstimatedState
from foundation.frames import Vec3

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
