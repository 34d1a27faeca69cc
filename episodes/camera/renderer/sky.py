"""The light of a clear day: sky, sun disc, haze, and how bright light becomes a displayable value."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Sun
from foundation.compiled import njit
from foundation.frames import Vec3

EXPOSURE = 0.72
SHOULDER = 0.48
WHITENING = 0.09
WHITE = 2.14  # the light at which the curve of `display_table` reaches white
STEPS = 8192  # of the table: less than one code each where sRGB is steepest
HAZE_LENGTH_M = 2200.0  # distance after which about two thirds of a thing's colour is lost in the air
DISC_COSINE = math.cos(math.radians(0.45))  # a little larger than the real 0.27°, so that it is seen at all
GLOW_COSINE = math.cos(math.radians(0.9))


class Daylight(NamedTuple):
    """The lights of a scene, linear RGB."""

    toward: Vec3  # unit, NED
    sun: Vec3  # sun colour times strength
    ambient: Vec3  # from above
    bounce: Vec3  # from below: sky and sun light returned by the ground
    zenith: Vec3  # the sky overhead
    horizon: Vec3  # the sky at eye level, and the haze


def daylight(sun: Sun) -> Daylight:
    """Return the lights that belong to `sun`."""
    n, e, d = (float(c) for c in sun.toward_ned)
    length = math.sqrt(n * n + e * e + d * d)
    toward = (n / length, e / length, d / length)
    strength = float(sun.strength)
    light = tuple(float(c) * strength for c in sun.color)
    sky = tuple(float(c) for c in sun.sky)
    high = max(-toward[2], 0.0)
    grey = sum(sky) / 3.0
    ambient = tuple(1.15 * (c + 0.3 * (grey - c)) for c in sky)  # walls and clouds wash out the blue
    bounce = tuple(0.20 * (a + c * high) * g for a, c, g in zip(ambient, light, (1.0, 0.95, 0.8), strict=True))
    zenith = tuple(2.1 * c**2.2 for c in sky)  # deeper than the mean that `sky` stands for
    horizon = tuple(1.2 * c + w for c, w in zip(sky, (0.80, 0.95, 1.06), strict=True))
    return Daylight(toward, _vec3(light), _vec3(ambient), _vec3(bounce), _vec3(zenith), _vec3(horizon))


def _vec3(v: tuple[float, ...]) -> Vec3:
    return (v[0], v[1], v[2])


@njit(cache=True, nogil=True)
def sky_color(day: Daylight, n: float, e: float, d: float) -> Vec3:
    """Return the linear (r, g, b) of the sky in the unit direction (n, e, d), NED."""
    up = max(-d, 0.0)
    low = (1.0 - up) * (1.0 - up)
    low = low * low * (1.0 - up)
    if d > 0.0:
        low *= 1.0 - 0.35 * min(d * 8.0, 1.0)  # below eye level, where the map ends
    r = day.zenith[0] + (day.horizon[0] - day.zenith[0]) * low
    g = day.zenith[1] + (day.horizon[1] - day.zenith[1]) * low
    b = day.zenith[2] + (day.horizon[2] - day.zenith[2]) * low
    near_sun = day.toward[0] * n + day.toward[1] * e + day.toward[2] * d
    if near_sun > 0.0:
        s = near_sun * near_sun
        s = s * s
        s8 = s * s
        s64 = s8 * s8 * s8 * s8 * s8 * s8 * s8 * s8
        glow = 0.07 * s8 + 0.18 * s64 * s64 * s64
        if near_sun > GLOW_COSINE:
            glow += 6.0 * min((near_sun - GLOW_COSINE) / (DISC_COSINE - GLOW_COSINE), 1.0)
        r += day.sun[0] * glow
        g += day.sun[1] * glow
        b += day.sun[2] * glow
    return r, g, b


def display_table() -> NDArray[np.uint8]:
    """Return the (STEPS + 1,) sRGB codes of equally spaced lights 0 … WHITE.

    After the exposure the light is bent by x (1 + a x) / (1 + b x), straight in the dark and slowly reaching white
    (the form of Reinhard's extended curve), and encoded as IEC 61966-2-1 says.
    """
    x = EXPOSURE * WHITE * np.arange(STEPS + 1) / STEPS
    y = np.clip(x * (1.0 + WHITENING * x) / (1.0 + SHOULDER * x), 0.0, 1.0)
    return np.rint(255.0 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1.0 / 2.4) - 0.055)).astype(np.uint8)
