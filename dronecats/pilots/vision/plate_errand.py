"""What a drone does about the vehicle it was sent to: stand before its nearer end, read the plate, declare or stay.

Two things must be known from one picture to the next. A `go` whose point lies a little under the horizon says that the
vehicle will be to the right of where it leads, one a little over it to the left: neither is steep enough to be climbed.
A stride shorter than `_SURE_DEPTH_M` says that the plate was the named one; on that stride it leaves the picture below.
"""

import math

from dronecats.pilots import reply
from dronecats.pilots.briefing import LEVEL_PX, PastAction
from dronecats.pilots.vision import inscription, parked, plates
from dronecats.pilots.vision.alike import LookAlike
from dronecats.pilots.vision.inscription import Inscription
from dronecats.pilots.vision.paint import Picture
from dronecats.pilots.vision.plates import Plate
from dronecats.pilots.vision.ranging import CAMERA_AHEAD_M
from dronecats.pilots.vision.referent import Size
from foundation.protocol import BRAKE_M, FINISHED, GO, NEAR_M, NEAR_SCALE, STRIDE_MAX_M, STRIDE_MIN_M

_LOOKS_M = 16.0  # within this, the way leads to before an end; farther off, to the vehicle
_ARRIVED_M = 4.5  # from the body to the vehicle's middle, in the plane; the verifier's radius is 5 m
_TOO_FAR_M = 0.15  # beyond that, and a stride more is flown
_READS_M = 2.4  # no nearer to a plate that has not been read
_SURE_DEPTH_M = 3.05
_THERE_M = 1.4  # from a vantage point: there
_FACING_RAD = math.radians(12.0)
_WIDEST_RAD = math.radians(40.0)  # off the axis, that a point in the picture is chosen
_ROW = 18.0  # of a thousand, over or under the horizon; a slope of 0.05 at the most
_TURN_DEG = 50.0
_BROAD_RAD = math.radians(25.0)  # a vehicle that is turned less than this shows an end
_UNREAD_M = 1.9  # a stride that does not say that the plate was read


def decide(picture: Picture, car: LookAlike, wanted: Inscription, past: tuple[PastAction, ...], size: Size) -> str:
    """Return the next action of a drone whose own vehicle is in its picture."""
    focal = 0.5 * picture.shape[1]
    if car.spot.ahead_m > _LOOKS_M:
        return _go(car.spot.bearing_rad, STRIDE_MAX_M, car.spot.distance_m, 0)
    if past and past[-1].kind == FINISHED:
        return _again(car, past)
    end_m = max(1.5, car.spot.ahead_m - 0.45 * size.length_m)
    plate = plates.find(picture, (car.left, car.top, car.right, car.bottom), focal * plates.HEIGHT_M / end_m)
    known = _known(plate, wanted)
    if known is False:
        return reply.think()
    if plate is not None and known:
        return _arrive(plate, size, focal)
    if was_sure(past):
        return reply.finished()
    return _closer(car, plate, past, size, focal)


def lost(past: tuple[PastAction, ...]) -> str:
    """Return the next action of a drone whose vehicle is not in the picture: turn to the side where it must be."""
    if was_sure(past):
        return reply.finished()
    if past[-1].kind == FINISHED:
        return reply.think() if len(past) >= 2 and past[-2].kind == FINISHED else reply.finished()
    for action in reversed(past):
        if action.kind == GO:
            return reply.rotate(math.copysign(_TURN_DEG, action.y_px - LEVEL_PX))
    return reply.rotate(_TURN_DEG)


def was_sure(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last stride was one to a plate that had been read."""
    return bool(past) and past[-1].kind == GO and past[-1].depth_m < _SURE_DEPTH_M


def _known(plate: Plate | None, wanted: Inscription) -> bool | None:
    return inscription.agrees(wanted, [plate.reading]) if plate is not None and plate.reading is not None else None


def _again(car: LookAlike, past: tuple[PastAction, ...]) -> str:
    """Declare twice, twice more from a stride nearer, since the distance may have been misjudged, and then no more."""
    said = [action.kind == FINISHED for action in past]
    if not (len(said) >= 2 and said[-2]):
        return reply.finished()
    if len(said) >= 4 and said[-4]:
        return reply.think()
    return _go(car.spot.bearing_rad, STRIDE_MIN_M, 0.0, 0)


def _arrive(plate: Plate, size: Size, focal: float) -> str:
    """Fly up to a plate that is the named one, and declare before it."""
    depth = focal * plates.HEIGHT_M / (plate.bottom - plate.top)
    travel = depth + CAMERA_AHEAD_M + 0.5 * size.length_m - _ARRIVED_M
    if travel <= _TOO_FAR_M:
        return reply.finished()
    bearing = math.atan((plate.middle - focal) / focal)
    if travel <= NEAR_SCALE * STRIDE_MAX_M:
        return _go(bearing, max(travel, STRIDE_MIN_M), 0.0, 0)
    return _go(bearing, min(max(0.5 * travel, _UNREAD_M), STRIDE_MAX_M), depth, 0)  # and then it is read again


def _closer(car: LookAlike, plate: Plate | None, past: tuple[PastAction, ...], size: Size, focal: float) -> str:
    """Go to before the nearer end, or up to the plate itself where it shows about the middle."""
    heading = parked.heading_rad(car.right - car.left, car.spot.ahead_m, size, focal)
    end = parked.side(plate.middle, car.left, car.right) if plate is not None else 0
    if plate is not None and (end == 0 or heading < _BROAD_RAD):
        bearing = math.atan((plate.middle - focal) / focal)
        off = focal * plates.HEIGHT_M / (plate.bottom - plate.top) - _READS_M
        if off > 0.4:
            return _go(bearing, min(max(off, _UNREAD_M), STRIDE_MAX_M), car.spot.distance_m, 0)
    if end == 0:  # from the side, either end will do: the one that was chosen before, or the one that is farther ahead
        end = _chosen(past) or (-1 if car.spot.bearing_rad > 0.0 else 1)
    there = parked.vantage(car.spot, heading, end, size)
    if there.distance_m <= _THERE_M or there.ahead_m <= 0.3:
        if abs(car.spot.bearing_rad) > _FACING_RAD:
            return reply.rotate(math.degrees(car.spot.bearing_rad))
        return _go(car.spot.bearing_rad, _UNREAD_M, 0.0, 0) if car.spot.ahead_m > NEAR_M else _round(car, end)
    bearing = _clipped(there.bearing_rad)
    aside = 1 if car.spot.bearing_rad > bearing else -1
    return _go(bearing, min(max(there.distance_m, _UNREAD_M), STRIDE_MAX_M), car.spot.distance_m, aside)


def _round(car: LookAlike, end: int) -> str:
    """Go on round a vehicle that shows nothing to read from here."""
    return _go(_clipped(car.spot.bearing_rad + end * _WIDEST_RAD), STRIDE_MAX_M, NEAR_M, -end)


def _chosen(past: tuple[PastAction, ...]) -> int:
    """Return the end that the last strides led to: a vehicle to their right has its nearer end to the left."""
    for action in reversed(past):
        if action.kind == GO and abs(action.y_px - LEVEL_PX) > 4.0:
            return -1 if action.y_px > LEVEL_PX else 1
    return 0


def _clipped(bearing: float) -> float:
    return min(max(bearing, -_WIDEST_RAD), _WIDEST_RAD)


def _go(bearing: float, stride_m: float, distance_m: float, aside: int) -> str:
    """Return a `go` of a stride in a direction; a full one has the vehicle's distance for its depth.

    `aside` is 1 or -1 where the vehicle will be to the right or left of the way, else 0.
    """
    bearing = _clipped(bearing)
    u = 500.0 + 500.0 * math.tan(bearing)
    if stride_m >= STRIDE_MAX_M:
        return reply.go(u, 500.0 + _ROW * aside, max(distance_m * math.cos(bearing), NEAR_M))
    depth = max(stride_m / NEAR_SCALE * math.cos(bearing), BRAKE_M) + 0.01
    if stride_m >= _UNREAD_M:
        depth = max(depth, _SURE_DEPTH_M + 0.05)
    return reply.go(u, 500.0 + _ROW * aside, min(depth, NEAR_M - 0.05))
