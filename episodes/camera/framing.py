"""Where a box lies in a camera's picture, as a detector would report it: by its eight corners, past nothing."""

import itertools
from collections.abc import Iterable, Iterator, Sequence

from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3, rotate_inverse
from foundation.measurement import InPicture
from foundation.protocol import POINT_SPAN

NEAR_M = 0.05  # as the renderer's near plane
EDGES = tuple(
    (a, b) for a, b in itertools.combinations(range(8), 2) if (a ^ b).bit_count() == 1
)  # of a box whose corners are numbered by the bits of (x, y, z)


def in_camera(point_ned: Vec3, pose: CameraPose) -> Vec3:
    """Return a point (m, NED) in camera axes: forward, right, down, m from the optical centre."""
    x, y, z = pose.position_ned
    return rotate_inverse(pose.attitude, (point_ned[0] - x, point_ned[1] - y, point_ned[2] - z))


def picture_box(corners: Sequence[Vec3], camera: CameraModel) -> InPicture | None:
    """Return the smallest upright box in the picture around a box whose corners (camera axes, m) are numbered by EDGES.

    It is cut at the picture's edges and counts nothing as hidden. None when no part of it is in the picture.
    """
    across, under = 2.0 * camera.focal_px / camera.width, 2.0 * camera.focal_px / camera.height
    shown = [(across * y / x, under * z / x) for x, y, z in _ahead(corners)]  # -1 … 1 within the picture
    if not shown:
        return None
    x0, x1 = _cut(x for x, _ in shown)
    y0, y1 = _cut(y for _, y in shown)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def _ahead(corners: Sequence[Vec3]) -> Iterator[Vec3]:
    """Yield the corners of what is left of a box before the near plane."""
    yield from (corner for corner in corners if corner[0] >= NEAR_M)
    for a, b in ((corners[a], corners[b]) for a, b in EDGES):
        if (a[0] < NEAR_M) != (b[0] < NEAR_M):
            part = (NEAR_M - a[0]) / (b[0] - a[0])
            yield (NEAR_M, a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2]))


def _cut(values: Iterable[float]) -> tuple[float, float]:
    """Return the least and the greatest on 0 … 1000, cut there."""
    told = list(values)
    low, high = max(min(told), -1.0), min(max(told), 1.0)
    return 0.5 * POINT_SPAN * (low + 1.0), 0.5 * POINT_SPAN * (high + 1.0)
