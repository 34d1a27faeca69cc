"""Drops near the camera: where they are, how far they fall while the shutter is open, what they hide."""

import math

import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics.light import Light
from episodes.camera.renderer.pose import eye_of
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3

NEAR_M, FAR_M = 0.4, 7.0  # along the optical axis; farther drops are the veil of `weather.veil`
SMALLEST_MM = 0.8  # smaller drops are seen by nobody
SHUTTER_S = 0.008  # where no exposure is asked for
BRIGHTNESS = 1.25  # of a drop over the haze's colour: it shows the whole sky at once


def drops_per_m3(rate_mm_h: float) -> tuple[float, float]:
    """Return how many drops above SMALLEST_MM a cubic metre holds, and the mean of their diameters beyond it (mm).

    Source: Marshall and Palmer, "The distribution of raindrops with size", 1948: N(D) = 8000 e^(−Λ D) per m³ and mm
    with Λ = 4.1 R^−0.21 per mm.
    """
    slope = 4.1 * rate_mm_h**-0.21
    return 8000.0 / slope * float(np.exp(-slope * SMALLEST_MM)), 1.0 / slope


def fall_speed(diameter_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terminal speed, m/s. Source: Atlas, Srivastava and Sekhon, 1973: 9.65 − 10.3 e^(−0.6 D)."""
    return 9.65 - 10.3 * np.exp(-0.6 * diameter_mm)


def streaks(
    depth: NDArray[np.float32],
    pose: CameraPose,
    velocity_ned: Vec3,
    wind_ned: Vec3,
    rate_mm_h: float,
    shutter_s: float,
    camera: CameraModel,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return (H, W): the share of each pixel's light that drops before the scene at planar `depth` (m) replace.

    A drop of diameter D that moves by L over the picture while the shutter is open covers a place of its streak for
    the share D / (D + L) of the exposure. `velocity_ned` (m/s) is the camera's.
    """
    eye = eye_of(pose, camera)
    half_w, half_h = 0.5 * camera.width / eye.focal, 0.5 * camera.height / eye.focal
    per_m3, beyond = drops_per_m3(rate_mm_h)
    count = rng.poisson(per_m3 * 4.0 * half_w * half_h * (FAR_M**3 - NEAR_M**3) / 3.0)
    z = np.cbrt(rng.uniform(NEAR_M**3, FAR_M**3, count))
    place = np.stack((rng.uniform(-half_w, half_w, count) * z, rng.uniform(-half_h, half_h, count) * z, z), axis=1)
    diameter = SMALLEST_MM + rng.exponential(beyond, count)
    axes = np.array((eye.right, eye.down, eye.forward))
    motion = np.asarray(wind_ned) - np.asarray(velocity_ned) + fall_speed(diameter)[:, None] * np.array((0.0, 0.0, 1.0))
    half_way = 0.5 * shutter_s * motion @ axes.T
    begin, end = place - half_way, place + half_way
    ahead = (begin[:, 2] > 0.5 * NEAR_M) & (end[:, 2] > 0.5 * NEAR_M)
    first = eye.focal * begin[ahead, :2] / begin[ahead, 2:]
    last = eye.focal * end[ahead, :2] / end[ahead, 2:]
    wide = eye.focal * 1e-3 * diameter[ahead] / z[ahead]
    return _drawn(first, last, wide, z[ahead], depth, camera)


def _drawn(
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    wide: NDArray[np.float64],
    z: NDArray[np.float64],
    depth: NDArray[np.float32],
    camera: CameraModel,
) -> NDArray[np.float32]:
    """Return (H, W) of the streaks from `first` to `last` (px from the middle), `wide` px wide and `z` m away.

    Every streak is a row of dots half a pixel apart, as many rows side by side as it is wide, each dot shared by the
    four pixels about it. All dots of a drop together hide its disc, however long the shutter is open.
    """
    along = last - first
    length = np.hypot(along[:, 0], along[:, 1])
    ends = (0.5 * wide / np.maximum(length, 1e-9))[:, None] * along  # half a drop beyond the way of its middle
    first, along, length = first - ends, along + 2.0 * ends, length + wide
    rows = np.ceil(wide).astype(np.int64)
    dots = np.ceil(2.0 * length).astype(np.int64) + 1
    total = rows * dots
    which = np.repeat(np.arange(len(total)), total)
    number = np.arange(int(total.sum())) - np.repeat(np.cumsum(total) - total, total)
    at, row = number % dots[which], number // dots[which]
    share = (at + 0.5) / dots[which]
    across = (row + 0.5 - 0.5 * rows[which])[:, None] * np.stack((-along[:, 1], along[:, 0]), axis=1)[which]
    across *= (wide / rows / np.maximum(length, 1e-9))[which, None]
    spot = first[which] + share[:, None] * along[which] + across
    weight = (0.25 * math.pi * wide**2 / total)[which]
    x, y = spot[:, 0] + 0.5 * camera.width - 0.5, spot[:, 1] + 0.5 * camera.height - 0.5
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    seen = (i >= 0) & (i < camera.width - 1) & (j >= 0) & (j < camera.height - 1)
    x, y, i, j, weight, far = x[seen] - i[seen], y[seen] - j[seen], i[seen], j[seen], weight[seen], z[which][seen]
    weight = np.where(far < depth[j, i], weight, 0.0)
    size = camera.width * camera.height
    mask = np.zeros(size)
    for dj, di, part in ((0, 0, (1 - x) * (1 - y)), (0, 1, x * (1 - y)), (1, 0, (1 - x) * y), (1, 1, x * y)):
        mask += np.bincount((j + dj) * camera.width + i + di, weight * part, size)
    return np.minimum(mask, 0.9).reshape(camera.height, camera.width).astype(np.float32)


def add_streaks(light: Light, mask: NDArray[np.float32], color: Vec3) -> Light:
    """Return `light` with drops of the haze's `color` before it."""
    drop = BRIGHTNESS * np.asarray(color, np.float32)
    return (light + (drop - light) * mask[..., None]).astype(np.float32)
