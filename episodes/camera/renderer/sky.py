"""Computes daylight: the sky with clouds, the sun's disc, haze, and the conversion of light to sRGB codes.

The sky of a scene is a table, computed once. A stereographic projection maps the upper half of all directions to a disc
of radius 1: direction (n, e, d) is at (n, e) / (1 − d). The zenith is the middle of the disc, the horizon is its rim.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Sun
from foundation.compiled import njit
from foundation.frames import Vec3, vec3
from foundation.kept_values import kept
from foundation.threads import once

EXPOSURE = 0.72
SHOULDER = 0.48
WHITENING = 0.09
WHITE = 2.14  # the light at which the curve of `display_table` reaches white
STEPS = 8192  # steps of `display_table`; a step is less than one code even where sRGB is steepest
HAZE_LENGTH_M = 2200.0  # distance at which haze replaces about two thirds of an object's colour
DISC_COSINE = math.cos(math.radians(0.45))  # cosine of the drawn sun's radius; the real 0.27° is too small to see
GLOW_COSINE = math.cos(math.radians(0.9))  # cosine of the radius including the soft edge
USUAL_GREY = 0.553  # mean of the default `Sun.sky`; darker skies have darker horizons

Directions = NDArray[np.floating[Any]]  # (SKY_CELLS, SKY_CELLS), one value per direction

SKY_CELLS = 1024  # cells per side of the table of the sky
CLOUD_SEED = 5
CLOUD_BASE_M, EARTH_M = 1300.0, 6.371e6
CLOUD_TILE_M, CLOUD_CELLS = 14000.0, 1024  # period of the pattern of clouds, in m and in cells
CLOUD_FADE_M = 24000.0  # at this distance along the ray, haze hides about two thirds of a cloud
# clouds fade out between these angles from the sun: the sun casts shadows, so no cloud may hide it
SUN_HOLE = math.cos(math.radians(14.0)), math.cos(math.radians(6.0))


class Daylight(NamedTuple):
    """The light sources of a scene, linear RGB."""

    toward: Vec3  # unit, NED, towards the sun
    sun: Vec3  # sun colour times strength
    ambient: Vec3  # light from above
    bounce: Vec3  # light that the ground returns
    zenith: Vec3  # the sky overhead
    horizon: Vec3  # the sky at eye level, and the haze
    disc: float  # share of the sun's disc that clouds do not hide


def daylight(sun: Sun) -> Daylight:
    """Return the light sources of `sun`."""
    n, e, d = (float(c) for c in sun.toward_ned)
    length = math.sqrt(n * n + e * e + d * d)
    toward = (n / length, e / length, d / length)
    strength = float(sun.strength)
    light = tuple(float(c) * strength for c in sun.color)
    sky = tuple(float(c) for c in sun.sky)
    high = max(-toward[2], 0.0)
    grey = sum(sky) / 3.0
    ambient = tuple(1.15 * (c + 0.3 * (grey - c)) for c in sky)  # less blue: light from walls and clouds is greyer
    bounce = tuple(0.20 * (a + c * high) * g for a, c, g in zip(ambient, light, (1.0, 0.95, 0.8), strict=True))
    zenith = tuple(2.1 * c**2.2 for c in sky)  # `sky` is the mean of all directions; the zenith is bluer
    veil = min(grey / USUAL_GREY, 1.0)
    horizon = tuple(1.2 * c + w * veil for c, w in zip(sky, (0.80, 0.95, 1.06), strict=True))
    disc = min(max((0.95 - float(sun.clouds)) / 0.2, 0.0), 1.0)
    return Daylight(toward, vec3(light), vec3(ambient), vec3(bounce), vec3(zenith), vec3(horizon), disc)


def sky_of(sun: Sun) -> NDArray[np.float32]:
    """Return the (SKY_CELLS, SKY_CELLS, 3) linear RGB of the sky of `sun`, without the sun's disc."""
    glow = vec3(sun.glow)
    return _sky(daylight(sun), float(sun.clouds), glow)


@once(2)
def _sky(day: Daylight, clouds: float, glow: Vec3) -> NDArray[np.float32]:
    given = day, clouds, glow
    return kept("sky", ["episodes/camera/renderer/sky.py"], lambda: _computed_sky(*given), given)


def _computed_sky(day: Daylight, clouds: float, glow: Vec3) -> NDArray[np.float32]:
    axis = np.linspace(-1.0, 1.0, SKY_CELLS, dtype=np.float32)
    x, y = axis[:, None], axis[None, :]
    square = np.minimum(x * x + y * y, 1.0)
    up = (1.0 - square) / (1.0 + square)
    north, east = x * (1.0 + up), y * (1.0 + up)
    low = _power(1.0 - up, 5)[..., None]
    zenith, horizon = np.array(day.zenith, np.float32), np.array(day.horizon, np.float32)
    table = zenith + (horizon - zenith) * low
    near_sun = np.clip(day.toward[0] * north + day.toward[1] * east - day.toward[2] * up, 0.0, 1.0)
    shine = 0.07 * _power(near_sun, 8) + 0.18 * _power(near_sun, 192)
    table += shine[..., None] * np.array(day.sun, np.float32)
    if any(glow):
        toward_glow = np.clip(day.toward[0] * north + day.toward[1] * east, 0.0, 1.0) ** 2
        table += (toward_glow * _power(1.0 - up, 6))[..., None] * np.array(glow, np.float32)
    if clouds > 0.0:
        cover, bright = _clouds(day, clouds, up, north, east)
        if clouds < 0.95:
            cover *= 1.0 - np.clip((near_sun - SUN_HOLE[0]) / (SUN_HOLE[1] - SUN_HOLE[0]), 0.0, 1.0)
        sun, ambient = np.array(day.sun, np.float32), np.array(day.ambient, np.float32)
        white = bright[..., None] * (0.42 * sun) + (0.70 + 0.30 * bright[..., None]) * (1.1 * ambient)
        white += (0.5 * bright * _power(near_sun, 6))[..., None] * (0.3 * sun)
        table += (white - table) * cover[..., None]
    return np.ascontiguousarray(table, np.float32)


def _power(base: Directions, exponent: int) -> Directions:
    """Return base ** exponent by squaring: numpy's power takes ten times as long."""
    result = np.ones_like(base)
    while exponent:
        if exponent % 2:
            result = result * base
        base, exponent = base * base, exponent // 2
    return result


def _clouds(
    day: Daylight, clouds: float, up: Directions, north: Directions, east: Directions
) -> tuple[Directions, Directions]:
    """Return the share of the sky that clouds hide in each direction, and how sunlit they are there, 0 … 1.

    The clouds are a layer at one height above a round earth, so that they end at the horizon. Haze hides distant ones.
    """
    rise = EARTH_M * up
    path = np.sqrt(rise * rise + 2.0 * EARTH_M * CLOUD_BASE_M + CLOUD_BASE_M**2) - rise
    scale = np.float32(CLOUD_CELLS / CLOUD_TILE_M)
    rows, columns = path * north * scale, path * east * scale
    cover, bright = _cloud_pattern(clouds, day.toward)
    # distant clouds are smaller than the cells of the table: use their mean
    blur = np.clip(0.5 * np.log2(np.maximum(path * (scale * 2.4 / SKY_CELLS) / np.maximum(up, 0.02), 1.0)), 0.0, 2.0)
    rows, columns = np.asarray(rows % CLOUD_CELLS, np.float32), np.asarray(columns % CLOUD_CELLS, np.float32)
    shown = []
    for pattern in (cover, bright):
        levels = [pattern]
        for sigma in (2.5, 10.0):
            padded = cv2.copyMakeBorder(pattern, 32, 32, 32, 32, cv2.BORDER_WRAP)
            levels.append(cv2.GaussianBlur(padded, (0, 0), sigma)[32:-32, 32:-32])
        total = np.zeros_like(path)
        for k, level in enumerate(levels):
            weight = np.clip(1.0 - np.abs(blur - k), 0.0, 1.0)
            read = cv2.remap(level, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            total += weight * read
        shown.append(total)
    return shown[0] * np.exp(-path / CLOUD_FADE_M).astype(np.float32), shown[1]


def _cloud_pattern(clouds: float, toward: Vec3) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return a layer of clouds seen from directly below: its cover and how sunlit it is, each (N, N), 0 … 1."""
    side = CLOUD_CELLS
    rng = np.random.default_rng(CLOUD_SEED)
    frequency = np.fft.fftfreq(side) * side
    radius = np.hypot(frequency[:, None], frequency[None, : side // 2 + 1])
    spectrum = np.fft.rfft2(rng.normal(size=(side, side))) / np.maximum(radius, 5.0) ** 1.75
    spectrum[0, 0] = 0.0
    field = np.fft.irfft2(spectrum, s=(side, side))
    field = (field / field.std()).astype(np.float32)
    level = float(np.quantile(field, 1.0 - min(clouds, 1.0)))
    thick = np.maximum(field - level, 0.0)
    cover = np.clip(thick / (0.9 if clouds < 1.0 else 0.01), 0.0, 1.0)
    cover = 1.0 - (1.0 - cover) ** 2.2
    # clouds towards the sun take light away, and thick clouds are darker in the middle
    flat = math.hypot(toward[0], toward[1]) or 1.0
    shade = np.zeros_like(thick)
    for step in (4, 9, 15):
        moved = (-round(toward[0] / flat * step), -round(toward[1] / flat * step))
        shade += np.roll(thick, moved, (0, 1))
    bright = np.exp(-0.22 * shade - 0.30 * thick)
    return cover.astype(np.float32), bright.astype(np.float32)


@njit(cache=True, nogil=True)
def sky_color(day: Daylight, sky: NDArray[np.float32], n: float, e: float, d: float) -> Vec3:
    """Return the linear (r, g, b) of the sky in the unit direction (n, e, d), NED, from the table `sky`."""
    per = 1.0 / (1.0 - min(d, 0.0))
    x, y = n * per, e * per
    below = 0.0
    if d > 0.0:  # below eye level, where the table has no cells: mix the horizon's colour with the darker zenith's
        per = 1.0 / math.sqrt(max(x * x + y * y, 1e-12))
        x, y = x * per, y * per
        below = 0.35 * min(d * 8.0, 1.0)
    r, g, b = read_half(sky, x, y)
    r += (day.zenith[0] - r) * below
    g += (day.zenith[1] - g) * below
    b += (day.zenith[2] - b) * below
    near_sun = day.toward[0] * n + day.toward[1] * e + day.toward[2] * d
    if near_sun > GLOW_COSINE:
        shine = 6.0 * day.disc * min((near_sun - GLOW_COSINE) / (DISC_COSINE - GLOW_COSINE), 1.0)
        r += day.sun[0] * shine
        g += day.sun[1] * shine
        b += day.sun[2] * shine
    return r, g, b


@njit(cache=True, nogil=True, inline="always")
def read_half(table: NDArray[np.float32], x: float, y: float) -> Vec3:
    """Return the bilinear value of a table (N, N, 3) at the place (x, y) of its disc of radius 1."""
    half = 0.5 * (table.shape[0] - 1)
    px = min(max((x + 1.0) * half, 0.0), table.shape[0] - 1.001)
    py = min(max((y + 1.0) * half, 0.0), table.shape[1] - 1.001)
    i, j = int(px), int(py)
    fx, fy = px - i, py - j
    a, b, c, d = (1.0 - fx) * (1.0 - fy), (1.0 - fx) * fy, fx * (1.0 - fy), fx * fy
    p, q = table[i], table[i + 1]
    return (
        a * p[j, 0] + b * p[j + 1, 0] + c * q[j, 0] + d * q[j + 1, 0],
        a * p[j, 1] + b * p[j + 1, 1] + c * q[j, 1] + d * q[j + 1, 1],
        a * p[j, 2] + b * p[j + 1, 2] + c * q[j, 2] + d * q[j + 1, 2],
    )


def display_table() -> NDArray[np.uint8]:
    """Return the (STEPS + 1,) sRGB codes of equally spaced lights 0 … WHITE.

    The tone curve of the exposed light x is x (1 + WHITENING x) / (1 + SHOULDER x), which has the form of Reinhard's
    extended curve. It is linear in the dark and approaches white slowly. Encoding: IEC 61966-2-1.
    """
    x = EXPOSURE * WHITE * np.arange(STEPS + 1) / STEPS
    y = np.clip(x * (1.0 + WHITENING * x) / (1.0 + SHOULDER * x), 0.0, 1.0)
    return np.rint(255.0 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1.0 / 2.4) - 0.055)).astype(np.uint8)
