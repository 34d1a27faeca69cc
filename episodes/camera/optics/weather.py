"""Computes haze and rain."""

import math

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import eye_of
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3

Light = NDArray[np.float32]  # (H, W, 3) linear RGB, 0 … `sky.WHITE`

CLOUDS_M = 1500.0  # m, height of the base of rain clouds above the camera
# factor (1/m) and exponent of the rate R (mm/h): 1.076 R^0.67 dB/km (Carbonneau and Wisely, 1998)
RAIN_EXTINCTION = (0.000248, 0.67)

NEAR_M, FAR_M = 0.4, 7.0  # depth of drops that are drawn, along the optical axis; `veil` stands for farther drops
SMALLEST_MM = 0.8  # smaller drops are invisible
SHUTTER_S = 0.008  # s, exposure time of streaks if there is no exposure option
BRIGHTNESS = 1.25  # brightness of a drop / brightness of the haze: a drop refracts light of the whole sky


def veil(rate_mm_h: float) -> float:
    """Return the extinction (1/m) of distant rain, whose drops are too small to see."""
    scale, exponent = RAIN_EXTINCTION
    return float(scale * rate_mm_h**exponent)


def pixel_slopes(camera: CameraModel) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return x / z (1, W) and y / z (H, 1) of the rays through the middles of the pixels."""
    x = (np.arange(camera.width) + 0.5 - 0.5 * camera.width) / camera.focal_px
    y = (np.arange(camera.height) + 0.5 - 0.5 * camera.height) / camera.focal_px
    return x[None, :], y[:, None]


def path_in_layer(
    depth: NDArray[np.float32], pose: CameraPose, camera: CameraModel, height_m: float
) -> NDArray[np.float32]:
    """Return (H, W) the length (m) of each pixel's ray in a layer that ends `height_m` above the camera.

    `depth` is planar (m, inf = sky). The length of a ray that neither leaves the layer nor hits anything is inf.
    """
    eye, (x, y) = eye_of(pose, camera), pixel_slopes(camera)
    # cosine of the angle between each pixel's ray and the optical axis: depth / distance
    per_metre = (1.0 / np.sqrt(1.0 + x**2 + y**2)).astype(np.float32)
    up = -(eye.forward[2] + x * eye.right[2] + y * eye.down[2]) * per_metre
    reach = np.divide(height_m, up, out=np.full(up.shape, np.inf), where=up > 1e-6)
    length: NDArray[np.float64] = np.minimum(depth / per_metre, reach)
    return length.astype(np.float32)


def add_haze(light: Light, path: NDArray[np.float32], density: float, color: Vec3) -> Light:
    """Return `light` seen through `path` metres of haze: light · exp(−density · path) + color · (1 − exp(…)).

    Source: Koschmieder's law of visibility, 1924.
    """
    clear: NDArray[np.float32] = np.exp(-np.float32(density) * path)[..., None]
    hazy = np.asarray(color, np.float32)
    return (hazy + (light - hazy) * clear).astype(np.float32)


def drops_per_m3(rate_mm_h: float) -> tuple[float, float]:
    """Return the number of drops above SMALLEST_MM per m³, and the mean of their diameters minus SMALLEST_MM (mm).

    Source: Marshall and Palmer, "The distribution of raindrops with size", 1948: N(D) = 8000 e^(−Λ D) per m³ and mm
    with Λ = 4.1 R^−0.21 per mm.
    """
    slope = 4.1 * rate_mm_h**-0.21
    return 8000.0 / slope * float(np.exp(-slope * SMALLEST_MM)), 1.0 / slope


def fall_speed(diameter_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terminal speed (m/s) of drops. Source: Atlas, Srivastava and Sekhon, 1973: 9.65 − 10.3 e^(−0.6 D)."""
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
    """Return (H, W) the share of each pixel's light that comes from drops in front of the scene.

    `depth` is the planar depth (m) of the scene, and `velocity_ned` (m/s) the velocity of the camera. A drop that moves
    during the exposure makes a streak. A drop of width D in the picture that moves by L covers each place of its streak
    for the share D / (D + L) of the exposure.
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
    """Return the mask (H, W) of streaks from `first` to `last` (px from the middle), `wide` px wide and `z` m away.

    A streak is drawn as parallel rows of dots that are half a pixel apart. It has one row per pixel of its width, and
    the four pixels around a dot share its weight. The weights of a drop's dots add up to the area of its disc, for
    any exposure.
    """
    along = last - first
    length = np.hypot(along[:, 0], along[:, 1])
    ends = (0.5 * wide / np.maximum(length, 1e-9))[:, None] * along  # half a drop beyond both ends of its path
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
    """Return `light` with drops of the haze's `color` in front of it."""
    drop = BRIGHTNESS * np.asarray(color, np.float32)
    return (light + (drop - light) * mask[..., None]).astype(np.float32)
