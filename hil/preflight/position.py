"""Where the vehicle is, and where it would return to."""

import math

from hil.preflight.heard import Heard
from hil.preflight.row import Row

FIX_3D = 3
SATELLITES = 6  # EKF2_REQ_NSATS, default
HDOP_MOST = 2.5  # EKF2_REQ_PDOP's default, which HDOP stays below
SPREAD_H, SPREAD_V = 3.0, 5.0  # m, EKF2_REQ_EPH and EKF2_REQ_EPV, defaults
UNKNOWN = 65535
HOME_NEAR = 10.0  # m from home within which a vehicle stands on its home, a GPS's scatter included
EARTH = 6_371_000.0  # m, mean radius


def rows(heard: Heard) -> list[Row]:
    """Return the rows of GPS and home."""
    return [_gps(heard), _home(heard)]


def _gps(heard: Heard) -> Row:
    gps = heard.message("GPS_RAW_INT")
    if gps is None or gps.fix_type == 0:
        return Row("GPS", False, "no receiver is heard", "check its cable; without a place nothing is flown")
    if gps.fix_type < FIX_3D:
        return Row("GPS", False, f"no 3-D fix, {_count(gps.satellites_visible)}", "wait under open sky")
    hdop = gps.eph / 100.0 if gps.eph != UNKNOWN else None
    spreads = [(name, value / 1000.0, most) for name, value, most in
               (("h", gps.h_acc, SPREAD_H), ("v", gps.v_acc, SPREAD_V)) if value]  # fmt: skip
    parts = [f"fix type {gps.fix_type}", _count(gps.satellites_visible)]
    parts += [f"HDOP {hdop:.1f}"] if hdop is not None else []
    parts += [f"±{value:.1f} m {'across' if name == 'h' else 'in height'}" for name, value, _ in spreads]
    poor = [] if gps.satellites_visible >= SATELLITES else [f"fewer than {SATELLITES} satellites"]
    poor += [f"HDOP above {HDOP_MOST:g}"] if hdop is not None and hdop > HDOP_MOST else []
    poor += [f"worse than {most:g} m {'across' if name == 'h' else 'in height'}" for name, value, most in spreads
             if value > most]  # fmt: skip
    if poor:
        return Row("GPS", False, f"{', '.join(parts)}: {', '.join(poor)}", "wait under open sky")
    return Row("GPS", True, ", ".join(parts))


def _count(satellites: int) -> str:
    return "satellites not told" if satellites == 255 else f"{satellites} satellites"


def _home(heard: Heard) -> Row:
    home, here = heard.message("HOME_POSITION"), heard.message("GLOBAL_POSITION_INT")
    if home is None:
        return Row("home", False, "none is set: there is nowhere to return to, and no fence to measure from",
                   "wait for a good place; PX4 sets home by itself then")  # fmt: skip
    if here is None:
        return Row("home", None, "set, but GLOBAL_POSITION_INT does not come: how far away it is, is not known")
    distance = ground_distance(home.latitude, home.longitude, here.lat, here.lon)
    height = (here.alt - home.altitude) / 1000.0
    why = f"set, {distance:.1f} m from here, {abs(height):.1f} m {'below' if height >= 0 else 'above'}"
    if distance > HOME_NEAR:
        return Row("home", False, f"{why}: it would return to another place",
                   "set it anew where the vehicle stands, or reboot the autopilot there")  # fmt: skip
    return Row("home", True, why)


def ground_distance(lat_a: int, lon_a: int, lat_b: int, lon_b: int) -> float:
    """Return the distance in m between two places in 1e-7 degrees; good for some kilometres."""
    north = math.radians((lat_b - lat_a) * 1e-7) * EARTH
    turn = ((lon_b - lon_a) * 1e-7 + 180.0) % 360.0 - 180.0
    return math.hypot(north, math.radians(turn) * EARTH * math.cos(math.radians(lat_a * 1e-7)))
