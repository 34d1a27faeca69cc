"""Which way a drone may look from a place: with a thing wholly in its picture, or with none of it there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Mesh
from episodes.world.visibility import turn
from foundation.camera import CameraModel
from foundation.frames import Vec3

Array = NDArray[np.float64]
STEP_DEG = 0.1
EDGE_DEG = 1.0  # kept between a thing and the edge of the picture that shows it whole
CAMERA = CameraModel()
HALF_VIEW_DEG = math.degrees(math.atan(CAMERA.width / 2.0 / CAMERA.focal_px))


@dataclass(frozen=True, slots=True, eq=False)
class Framing:
    """What becomes of a thing in a level drone's picture as the drone turns, in steps of STEP_DEG."""

    off_deg: Array  # (N,) yaw of the nose off the thing's bearing, -180 … 180, + to the right of it
    left_deg: Array  # (N,) azimuth of the thing's left end from the optical axis, + to the right …
    middle_deg: Array  # (N,) … of the middle of its box …
    right_deg: Array  # (N,) … and of its right end; left <= middle <= right, which may lie beyond ±180

    def whole(self) -> NDArray[np.bool_]:
        """Return (N,) where the thing is wholly within the picture's sides."""
        inside = HALF_VIEW_DEG - EDGE_DEG
        return np.asarray((self.left_deg >= -inside) & (self.right_deg <= inside))

    def hidden(self) -> NDArray[np.bool_]:
        """Return (N,) where no part of the thing is in the picture, whichever way it stands in its box."""
        outside = HALF_VIEW_DEG + STEP_DEG
        beyond = (self.left_deg > outside) & (self.right_deg < 360.0 - outside)
        return np.asarray(beyond | ((self.right_deg < -outside) & (self.left_deg > outside - 360.0)))


def framing(corners_ned: Array, place: Vec3) -> Framing:
    """Return the framing of a box, corners (8, 3) in m NED, for a drone whose body origin is at `place` (m, NED)."""
    middle = corners_ned.mean(axis=0)
    ahead = math.atan2(middle[1] - place[1], middle[0] - place[0])
    off = np.arange(-180.0, 180.0, STEP_DEG)
    yaw = ahead + np.radians(off)
    lever = CAMERA.offset_frd[0]
    eye = np.stack([place[0] + lever * np.cos(yaw), place[1] + lever * np.sin(yaw)], axis=1)
    way = corners_ned[None, :, :2] - eye[:, None, :]
    to_middle = middle[None, :2] - eye
    centre = _wrap(np.degrees(np.arctan2(to_middle[:, 1], to_middle[:, 0]) - yaw))
    bearing = np.degrees(np.arctan2(way[..., 1], way[..., 0]) - yaw[:, None])
    beside = _wrap(bearing - centre[:, None])
    return Framing(off, centre + beside.min(axis=1), centre, centre + beside.max(axis=1))


def box_corners(mesh: Mesh, position_ned: Vec3, yaw: float) -> Array:
    """Return the corners (8, 3) in m NED of a placed mesh's box; `yaw` in rad."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    corners = np.array([[(low, high)[k >> b & 1][b] for b in range(3)] for k in range(8)], dtype=np.float64)
    return np.asarray(corners @ turn(yaw).T + np.array(position_ned))


def across(framing: Framing, share: float) -> float | None:
    """Return the yaw off a thing's bearing (deg) at which its middle stands at a share (0 … 1) of its way across.

    The way is that from one side of the picture to the other with the thing whole in it, even in columns of the
    picture and not in degrees. None for a thing too wide for the picture.
    """
    return _at(framing, framing.whole(), share)


def across_all(framings: Sequence[Framing], ahead_deg: Sequence[float], share: float) -> float | None:
    """Return the compass yaw (deg) of drones that have every thing whole in the picture, at a share of that range.

    `ahead_deg`: the bearing that each framing's `off_deg` counts from. None when no yaw shows them all.
    """
    first = ahead_deg[0]
    common = np.ones(len(framings[0].off_deg), dtype=bool)
    for one, ahead in zip(framings, ahead_deg, strict=True):
        turned = round(math.remainder(first - ahead, 360.0) / STEP_DEG)
        common &= np.roll(one.whole(), -turned)
    good = np.flatnonzero(common)
    if len(good) == 0:
        return None
    low, high = framings[0].off_deg[good[0]], framings[0].off_deg[good[-1]]
    return first + float(low + share * (high - low))


def away(framing: Framing, share: float) -> float | None:
    """Return the yaw off a thing's bearing (deg, 0 … 360) at a share (0 … 1) of the range that hides it; None: none."""
    hidden = np.flatnonzero(framing.hidden())
    if len(hidden) == 0:
        return None
    round_about = np.sort(framing.off_deg[hidden] % 360.0)  # from just out of sight on one side to the other side
    return float(round_about[0] + share * (round_about[-1] - round_about[0]))


def _at(framing: Framing, allowed: NDArray[np.bool_], share: float) -> float | None:
    good = np.flatnonzero(allowed)
    if len(good) == 0:
        return None
    column = np.tan(np.radians(framing.middle_deg[good]))
    wanted = column.max() - share * (column.max() - column.min())  # from the right of the picture to its left
    return float(framing.off_deg[good[np.argmin(np.abs(column - wanted))]])


def _wrap(degrees: Array) -> Array:
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)
