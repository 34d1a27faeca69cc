"""Haze, the place of the sun, and the light below rain clouds."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics.light import Light
from episodes.camera.optics.options import Haze, SunPlace
from episodes.camera.renderer.pose import depth_per_metre, eye_of
from episodes.maps.daylight import sun_at
from episodes.maps.scene import Sun
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3

LOWEST_DEG = 3.0  # of the sun: below it shadows reach across the whole map
REDDENING = (0.02, 0.10, 0.24)  # optical depth of clear air at the zenith, RGB (Rayleigh, as 1/λ⁴ goes)
CLOUDS_M = 1500.0  # m, the base of rain clouds above the camera
RAIN_EXTINCTION = (0.000248, 0.67)  # 1/m and exponent of mm/h: 1.076 R^0.67 dB/km (Carbonneau and Wisely, 1998)


def toward_sun(place: SunPlace) -> Vec3:
    """Return the unit vector towards the sun, NED. Raises ValueError for a sun that is not up or not well said."""
    angles = (place.azimuth_deg, place.elevation_deg)
    if (place.hour is None) == (angles == (None, None)):
        raise ValueError("[sun] wants either hour, or azimuth_deg and elevation_deg")
    if place.hour is not None:
        toward = sun_at(place.latitude_deg, place.day, place.hour).toward_ned
        if -toward[2] < math.sin(math.radians(LOWEST_DEG)):
            raise ValueError(f"[sun] at hour {place.hour:g} the sun is lower than {LOWEST_DEG:g}°, too low to see by")
        return toward
    if place.azimuth_deg is None or place.elevation_deg is None:
        raise ValueError("[sun] wants azimuth_deg and elevation_deg together")
    azimuth, elevation = math.radians(place.azimuth_deg), math.radians(place.elevation_deg)
    level = math.cos(elevation)
    return (level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation))


def moved_sun(sun: Sun, place: SunPlace) -> Sun:
    """Return `sun` at another place, redder and weaker the lower it stands, and the sky darker with it.

    The colour is what clear air lets through on the way to either height, against the way overhead.
    """
    toward = toward_sun(place)

    def through(height: float) -> list[float]:
        thickness = 1.0 / (height + 0.05)  # air masses; the term keeps the horizon finite
        return [math.exp(-depth * thickness) for depth in REDDENING]

    new, old = through(-toward[2]), through(max(-sun.toward_ned[2], 0.05))
    color = [c * n / o for c, n, o in zip(sun.color, new, old, strict=True)]
    dim = min(1.0, 0.35 + 0.65 * math.sqrt(max(-toward[2], 0.0) / max(-sun.toward_ned[2], 0.05)))
    sky = [c * dim for c in sun.sky]
    return dataclasses.replace(sun, toward_ned=toward, color=_vec3(color), sky=_vec3(sky))


def overcast(sun: Sun) -> Sun:
    """Return the light below rain clouds: hardly any shadow, a grey sky."""
    grey = 0.9 * sum(sun.sky) / 3.0
    return dataclasses.replace(sun, strength=0.10 * sun.strength, sky=(0.94 * grey, 0.99 * grey, 1.06 * grey))


def veil(rate_mm_h: float) -> float:
    """Return the extinction of rain that is too far to be seen drop by drop, 1/m."""
    scale, exponent = RAIN_EXTINCTION
    return float(scale * rate_mm_h**exponent)


def path_in_layer(
    depth: NDArray[np.float32], pose: CameraPose, camera: CameraModel, height_m: float
) -> NDArray[np.float32]:
    """Return (H, W): how far each pixel's ray runs, m, through a layer that ends `height_m` above the camera.

    `depth` is planar (m, inf = sky). A ray that never leaves the layer upwards and hits nothing runs for ever: inf.
    """
    eye, per_metre = eye_of(pose, camera), depth_per_metre(camera)
    x = (np.arange(camera.width) + 0.5 - eye.center_x) / eye.focal
    y = (np.arange(camera.height) + 0.5 - eye.center_y) / eye.focal
    up = -(eye.forward[2] + x[None, :] * eye.right[2] + y[:, None] * eye.down[2]) * per_metre
    reach = np.divide(height_m, up, out=np.full(up.shape, np.inf), where=up > 1e-6)
    length: NDArray[np.float64] = np.minimum(depth / per_metre, reach)
    return length.astype(np.float32)


def add_haze(light: Light, path: NDArray[np.float32], density: float, color: Vec3) -> Light:
    """Return `light` seen through `path` metres of haze: light · exp(−density · path) + color · (1 − exp(…)).

    Source: Koschmieder's law of the visibility of distant things, 1924.
    """
    clear: NDArray[np.float32] = np.exp(-np.float32(density) * path)[..., None]
    hazy = np.asarray(color, np.float32)
    return (hazy + (light - hazy) * clear).astype(np.float32)


def haze_color(haze: Haze | None, horizon: Vec3) -> Vec3:
    """Return the colour that distance takes on: the one asked for, or the sky's at the horizon."""
    return haze.color if haze is not None and haze.color is not None else horizon


def _vec3(v: list[float]) -> Vec3:
    return (v[0], v[1], v[2])
