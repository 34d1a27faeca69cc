"""The border's frame conversions, compiled for the kernels of this room."""

from foundation import frames
from foundation.compiled import njit

rotate = njit(cache=True)(frames.rotate)
rotate_inverse = njit(cache=True)(frames.rotate_inverse)
quat_normalized = njit(cache=True)(frames.quat_normalized)
ned_to_geodetic = njit(cache=True)(frames.ned_to_geodetic)
