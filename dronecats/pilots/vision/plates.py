"""Finds and reads number plates, and chooses the actions of a drone whose goal is a parked vehicle.

The drone flies to a vantage point in front of the vehicle's nearer end, reads the plate, and declares or hovers. The
vehicle's width in the picture gives its heading: a side view shows the whole length, an end view only the breadth. A
plate left or right of the vehicle's middle shows on which side the nearer end is.

The pilot has no memory, so each `go` encodes two values for the next step:

- The point is a little below the horizon if the vehicle will be to the right of the path, and a little above if the
  vehicle will be to the left. These slopes are too small for a climb or descent.
- The depth is below _READ_DEPTH_M if the pilot has read the wanted plate, and this stride takes it out of the picture.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from dronecats.pilots import actions
from dronecats.pilots.actions import LEVEL_PX, PastAction
from dronecats.pilots.vision import ocr
from dronecats.pilots.vision.colors import Mask, Picture
from dronecats.pilots.vision.command import Inscription, Size, plain_text
from dronecats.pilots.vision.division import Candidate, GroundPoint
from dronecats.pilots.vision.ocr import ReadText
from dronecats.pilots.vision.ranging import CAMERA_AHEAD_M
from foundation.protocol import BRAKE_M, FINISHED, GO, NEAR_M, NEAR_SCALE, STRIDE_MAX_M, STRIDE_MIN_M

HEIGHT_M = 0.16  # height of a plate; its digits are 0.10 m high
DIGITS = 4
_LEVELS = range(110, 250, 14)  # thresholds of lightness that separate a pale plate from paint, lamps and shade
_DULL = 34.0  # distance from grey, in Lab; a plate's colour is nearer to grey, an indicator light's farther
_SHAPE = (0.7, 4.6)  # range of width / height, from very oblique to frontal views
_LEAST_PX = (8, 4)  # px, least width and height of a plate
_FILLED = 0.5  # least share of a plate's rectangle that is pale; the digits are dark
_READABLE_PX = 9  # a plate is read only if it is at least this high; its digits are then 5.6 px high
_MOST_READ = 5  # rectangles to read per vehicle
_SAME_PX = 3  # at two thresholds, the edges of the same rectangle differ by at most this
VANTAGE_OFF_M = 2.6  # distance from a vehicle's end to the vantage point
_END_SHARE = 0.12  # a plate this far from the middle (share of the vehicle's width) shows the side of the nearer end
_LOOK_M = 16.0  # within this distance, the drone flies to an end of the vehicle; beyond it, to the middle
_ARRIVED_M = 4.5  # the drone declares within this horizontal distance of the vehicle's middle; success needs 5 m
_TOO_FAR_M = 0.15  # the drone flies one more stride if its distance exceeds _ARRIVED_M by more than this
_READ_M = 2.4  # the drone comes no nearer than this to an unread plate
_READ_DEPTH_M = 3.05  # a smaller depth of a `go` means that the wanted plate was read
_AT_VANTAGE_M = 1.4  # within this distance of a vantage point, the drone has arrived there
_FACING_RAD = math.radians(12.0)  # the drone faces a vehicle whose bearing is at most this
_WIDEST_RAD = math.radians(40.0)  # a stride has at most this bearing
_ROW = 18.0  # offset of a `go` point above or below the horizon, on a scale of 1000: a slope of 0.05 at most
_TURN_DEG = 50.0  # turn to a lost vehicle
_BROAD_RAD = math.radians(25.0)  # if `heading_rad` is less, the drone sees the end of a vehicle
_UNREAD_M = 1.9  # shortest stride to an unread plate, so that the depth of the `go` is over _READ_DEPTH_M


@dataclass(frozen=True, slots=True)
class Plate:
    """A pale rectangle that may be a plate."""

    left: int  # px, like top, right and bottom
    top: int
    right: int
    bottom: int
    reading: ReadText | None  # None if the OCR engine read nothing

    @property
    def middle(self) -> float:
        """The column (px) of the plate's middle."""
        return 0.5 * (self.left + self.right)

    @property
    def text(self) -> str:
        """The letters (in upper case) and digits of the reading."""
        return plain_text(self.reading.text) if self.reading else ""


def find(picture: Picture, box: tuple[int, int, int, int], height_px: float) -> Plate | None:
    """Return the best plate of the vehicle in `box` (left, top, right, bottom, px); None if none is found.

    An unreadable plate counts only if it is the only candidate. height_px: height of a plate at the vehicle's distance.
    """
    candidates = _pale_rectangles(picture, box, height_px)[:_MOST_READ]
    plates = [Plate(*rectangle, _read(picture, rectangle)) for rectangle in candidates]
    best = max(plates, key=_rank, default=None)
    return best if best is not None and (best.reading is not None or len(plates) == 1) else None


def _rank(plate: Plate) -> tuple[bool, float]:
    has_digits = len(plate.text) == DIGITS and plate.text.isdigit()
    return has_digits, plate.reading.confidence if plate.reading else 0.0


def _pale_rectangles(
    picture: Picture, box: tuple[int, int, int, int], height_px: float
) -> list[tuple[int, int, int, int]]:
    """Return the rectangles that may be a plate, sorted by the difference of their height from height_px."""
    height, width = picture.shape[:2]
    left, right = max(0, box[0] - 4), min(width, box[2] + 4)
    top, bottom = max(0, box[1] + (box[3] - box[1]) // 4), min(height, box[3] + max(4, (box[3] - box[1]) // 8))
    if right - left < _LEAST_PX[0] or bottom - top < _LEAST_PX[1]:
        return []
    lab = cv2.cvtColor(np.ascontiguousarray(picture[top:bottom, left:right]), cv2.COLOR_BGR2LAB).astype(np.float32)
    dull = np.hypot(lab[..., 1] - 128.0, lab[..., 2] - 128.0) < _DULL
    rectangles: list[tuple[int, int, int, int]] = []
    for level in _LEVELS:
        for x0, y0, x1, y1 in _rectangles(dull & (lab[..., 0] > level), height_px):
            rectangle = (x0 + left, y0 + top, x1 + left, y1 + top)
            if all(max(abs(a - b) for a, b in zip(rectangle, kept, strict=True)) > _SAME_PX for kept in rectangles):
                rectangles.append(rectangle)
    return sorted(rectangles, key=lambda b: (abs(b[3] - b[1] - height_px), b))


def _rectangles(mask: Mask, height_px: float) -> list[tuple[int, int, int, int]]:
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)[2][1:]
    x, y, w, h, area = stats.T
    fits = (w >= _LEAST_PX[0]) & (h >= _LEAST_PX[1]) & (w >= _SHAPE[0] * h) & (w <= _SHAPE[1] * h)
    fits &= (h >= 0.45 * height_px) & (h <= 1.9 * height_px) & (area >= _FILLED * w * h)
    return [(int(x[k]), int(y[k]), int(x[k] + w[k]), int(y[k] + h[k])) for k in np.flatnonzero(fits)]


def _read(picture: Picture, box: tuple[int, int, int, int]) -> ReadText | None:
    left, top, right, bottom = box
    h, w = bottom - top, right - left
    if h < _READABLE_PX:
        return None
    part = picture[max(0, top - 1) : bottom + 1, max(0, left - 2) : right + 2]
    texts = ocr.read_line(part, min(max(2.6 * h / w, 1.0), 3.0))
    return max(texts, key=lambda r: r.confidence) if texts else None


def heading_rad(width_px: float, depth_m: float, size: Size, focal_px: float) -> float:
    """Return the angle between a vehicle's long axis and the line of sight, 0 (from an end) … π/2 (from the side)."""
    width_m = width_px * depth_m / focal_px
    diagonal_m = math.hypot(size.length_m, size.width_m)
    tilt = math.atan2(size.width_m, size.length_m)
    if width_m >= diagonal_m:
        return math.pi / 2.0 - tilt
    if width_m <= size.width_m:
        return 0.0
    return max(0.0, math.asin(width_m / diagonal_m) - tilt)


def vantage_point(middle: GroundPoint, heading: float, nearer_end: int, size: Size) -> GroundPoint:
    """Return the point in front of a vehicle's nearer end.

    heading: the result of `heading_rad`. nearer_end: -1 left, 1 right of the vehicle's middle.
    """
    reach = 0.5 * size.length_m + VANTAGE_OFF_M
    bearing = middle.bearing_rad
    # the direction to the end: across the line of sight, and along it towards the camera
    across, back = nearer_end * math.sin(heading), -math.cos(heading)
    right = across * math.cos(bearing) + back * math.sin(bearing)
    ahead = -across * math.sin(bearing) + back * math.cos(bearing)
    return middle + GroundPoint(reach * right, reach * ahead)


def plate_side(plate_px: float, left_px: float, right_px: float) -> int:
    """Return -1 or 1 if a plate is to the left or right of a vehicle's middle, 0 near the middle."""
    off = (plate_px - 0.5 * (left_px + right_px)) / max(1.0, right_px - left_px)
    return 0 if abs(off) < _END_SHARE else (1 if off > 0.0 else -1)


def decide(picture: Picture, vehicle: Candidate, wanted: Inscription, past: tuple[PastAction, ...], size: Size) -> str:
    """Return the next action of a drone that sees its vehicle."""
    focal = 0.5 * picture.shape[1]
    if vehicle.spot.ahead_m > _LOOK_M:
        return _stride_to(vehicle.spot.bearing_rad, STRIDE_MAX_M, vehicle.spot.distance_m, 0)
    if past and past[-1].kind == FINISHED:
        return _declare_again(vehicle, past)
    end_m = max(1.5, vehicle.spot.ahead_m - 0.45 * size.length_m)
    plate = find(picture, (vehicle.left, vehicle.top, vehicle.right, vehicle.bottom), focal * HEIGHT_M / end_m)
    is_wanted = ocr.matches(wanted, [plate.reading]) if plate and plate.reading else None
    if is_wanted is False:
        return actions.think()
    if plate is not None and is_wanted:
        return _arrive(plate, size, focal)
    if was_plate_read(past):
        return actions.finished()
    return _approach_end(vehicle, plate, past, size, focal)


def decide_unseen(past: tuple[PastAction, ...]) -> str:
    """Return the next action of a drone that does not see its vehicle: usually a turn to the vehicle's side."""
    if was_plate_read(past):
        return actions.finished()
    if past[-1].kind == FINISHED:
        return actions.think() if len(past) >= 2 and past[-2].kind == FINISHED else actions.finished()
    for action in reversed(past):
        if action.kind == GO:
            return actions.rotate(math.copysign(_TURN_DEG, action.y_px - LEVEL_PX))
    return actions.rotate(_TURN_DEG)


def was_plate_read(past: tuple[PastAction, ...]) -> bool:
    """Return whether the pilot read the wanted plate before the last stride, which led to the plate."""
    return bool(past) and past[-1].kind == GO and past[-1].depth_m < _READ_DEPTH_M


def _declare_again(vehicle: Candidate, past: tuple[PastAction, ...]) -> str:
    """Return the action after a declaration: declare twice, fly one stride nearer, declare twice again, then think.

    The stride corrects an error of the estimated distance.
    """
    declared = [action.kind == FINISHED for action in past]
    if not (len(declared) >= 2 and declared[-2]):
        return actions.finished()
    if len(declared) >= 4 and declared[-4]:
        return actions.think()
    return _stride_to(vehicle.spot.bearing_rad, STRIDE_MIN_M, 0.0, 0)


def _arrive(plate: Plate, size: Size, focal: float) -> str:
    """Return a stride towards the wanted plate, or a declaration if the drone is near enough."""
    depth = focal * HEIGHT_M / (plate.bottom - plate.top)
    travel = depth + CAMERA_AHEAD_M + 0.5 * size.length_m - _ARRIVED_M
    if travel <= _TOO_FAR_M:
        return actions.finished()
    bearing = math.atan((plate.middle - focal) / focal)
    if travel <= NEAR_SCALE * STRIDE_MAX_M:
        return _stride_to(bearing, max(travel, STRIDE_MIN_M), 0.0, 0)
    return _stride_to(bearing, min(max(0.5 * travel, _UNREAD_M), STRIDE_MAX_M), depth, 0)  # then read the plate again


def _approach_end(
    vehicle: Candidate, plate: Plate | None, past: tuple[PastAction, ...], size: Size, focal: float
) -> str:
    """Return the next action on the way to the nearer end's vantage point, or straight to a plate."""
    heading = heading_rad(vehicle.right - vehicle.left, vehicle.spot.ahead_m, size, focal)
    end = plate_side(plate.middle, vehicle.left, vehicle.right) if plate is not None else 0
    if plate is not None and (end == 0 or heading < _BROAD_RAD):
        bearing = math.atan((plate.middle - focal) / focal)
        travel = focal * HEIGHT_M / (plate.bottom - plate.top) - _READ_M
        if travel > 0.4:
            return _stride_to(bearing, min(max(travel, _UNREAD_M), STRIDE_MAX_M), vehicle.spot.distance_m, 0)
    if end == 0:  # side view: the end of the last strides, else the end nearer to the optical axis
        end = _chosen_end(past) or (-1 if vehicle.spot.bearing_rad > 0.0 else 1)
    vantage = vantage_point(vehicle.spot, heading, end, size)
    if vantage.distance_m <= _AT_VANTAGE_M or vantage.ahead_m <= 0.3:
        if abs(vehicle.spot.bearing_rad) > _FACING_RAD:
            return actions.rotate(math.degrees(vehicle.spot.bearing_rad))
        if vehicle.spot.ahead_m <= NEAR_M:
            # this side has no readable plate: fly round the vehicle
            return _stride_to(vehicle.spot.bearing_rad + end * _WIDEST_RAD, STRIDE_MAX_M, NEAR_M, -end)
        return _stride_to(vehicle.spot.bearing_rad, _UNREAD_M, 0.0, 0)
    bearing = _clip_bearing(vantage.bearing_rad)
    aside = 1 if vehicle.spot.bearing_rad > bearing else -1
    return _stride_to(bearing, min(max(vantage.distance_m, _UNREAD_M), STRIDE_MAX_M), vehicle.spot.distance_m, aside)


def _chosen_end(past: tuple[PastAction, ...]) -> int:
    """Return the end (-1 left, 1 right, 0 unknown) that the last strides went to.

    On the way to the left end, the vehicle is to the right of the path.
    """
    for action in reversed(past):
        if action.kind == GO and abs(action.y_px - LEVEL_PX) > 4.0:
            return -1 if action.y_px > LEVEL_PX else 1
    return 0


def _clip_bearing(bearing: float) -> float:
    return min(max(bearing, -_WIDEST_RAD), _WIDEST_RAD)


def _stride_to(bearing: float, stride_m: float, distance_m: float, aside: int) -> str:
    """Return a `go` in a direction. distance_m: the vehicle's distance, which gives the depth of a full stride.

    aside: 1 or -1 if the vehicle will be to the right or left of the path, else 0.
    """
    bearing = _clip_bearing(bearing)
    u = 500.0 + 500.0 * math.tan(bearing)
    if stride_m >= STRIDE_MAX_M:
        return actions.go(u, 500.0 + _ROW * aside, max(distance_m * math.cos(bearing), NEAR_M))
    depth = max(stride_m / NEAR_SCALE * math.cos(bearing), BRAKE_M) + 0.01
    if stride_m >= _UNREAD_M:
        depth = max(depth, _READ_DEPTH_M + 0.05)
    return actions.go(u, 500.0 + _ROW * aside, min(depth, NEAR_M - 0.05))
