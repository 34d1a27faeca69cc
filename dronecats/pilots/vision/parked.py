"""Where to stand before a parked vehicle to read its plate: in front of the end that can be seen, a few metres off it.

The picture's proportions tell how the vehicle stands: as wide as it is long from the side, as wide as it is broad from
an end; on which side of its middle a plate shows tells which end is the nearer one.
"""

import math

from dronecats.pilots.vision.division import Spotted
from dronecats.pilots.vision.referent import Size

OFF_M = 2.6  # from a vehicle's end: near enough to read, and within the radius of success after one more stride
_END_SHARE = 0.12  # of the vehicle's width in the picture, off its middle, from which a plate tells the side


def heading_rad(width_px: float, depth_m: float, size: Size, focal_px: float) -> float:
    """Return the angle between a vehicle's long axis and the line of sight, 0 (from an end) … π/2 (from the side)."""
    seen = width_px * depth_m / focal_px
    whole = math.hypot(size.length_m, size.width_m)
    tilt = math.atan2(size.width_m, size.length_m)
    if seen >= whole:
        return math.pi / 2.0 - tilt
    if seen <= size.width_m:
        return 0.0
    return max(0.0, math.asin(seen / whole) - tilt)


def vantage(middle: Spotted, heading: float, nearer_end: int, size: Size) -> Spotted:
    """Return the place before a vehicle's nearer end; `nearer_end` is -1 or 1, to the left or right of its middle.

    `heading` is as `heading_rad` gives it, the place in the same terms as `middle`.
    """
    reach = 0.5 * size.length_m + OFF_M
    sight = middle.bearing_rad
    # across the line of sight to the end's side, and back along it
    across, back = nearer_end * math.sin(heading), -math.cos(heading)
    right = across * math.cos(sight) + back * math.sin(sight)
    ahead = -across * math.sin(sight) + back * math.cos(sight)
    return Spotted(middle.right_m + reach * right, middle.ahead_m + reach * ahead)


def side(plate_px: float, left_px: float, right_px: float) -> int:
    """Return -1 or 1 when a plate shows to the left or right of a vehicle's middle, 0 about it."""
    off = (plate_px - 0.5 * (left_px + right_px)) / max(1.0, right_px - left_px)
    return 0 if abs(off) < _END_SHARE else (1 if off > 0.0 else -1)
