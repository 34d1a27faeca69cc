"""Paints a person would name, the plain materials that assets share, and procedural textures. Seeded, sRGB."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Material
from foundation.errors import UsageError
from foundation.frames import Vec3

Array = NDArray[np.float64]


def noise(shape: tuple[int, int], power: float, seed: int) -> Array:
    """Return tileable noise of mean 0 and deviation 1 whose spectrum falls with frequency**-power."""
    rng = np.random.default_rng(seed)
    rows = np.fft.fftfreq(shape[0])[:, None] * shape[0]
    columns = np.fft.fftfreq(shape[1])[None, :] * shape[1]
    radius = np.maximum(np.hypot(rows, columns), 1.0)
    spectrum = np.fft.fft2(rng.normal(size=shape)) / radius**power
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.asarray(field / field.std())


def _tinted(value: Array, color: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return grey levels around 1 times an sRGB colour."""
    return np.asarray(np.clip(value[..., None] * np.array(color), 0, 255), np.uint8)


@cache
def asphalt() -> NDArray[np.uint8]:
    """Return (512, 512, 3): dark aggregate with patches, for a repeat of 4 m."""
    value = 1.0 + 0.10 * noise((512, 512), 0.1, 11) + 0.05 * noise((512, 512), 1.6, 12)
    return _tinted(value, (84, 84, 87))


@cache
def grass() -> NDArray[np.uint8]:
    """Return (512, 512, 3): mown lawn without large patches, which would show the repeat of 4 m from above."""
    blade = noise((512, 512), 0.5, 21)
    patch = noise((512, 512), 1.5, 22)
    value = 1.0 + 0.15 * blade + 0.03 * patch
    dry = np.clip(0.5 + 0.35 * noise((512, 512), 0.7, 23), 0, 1)[..., None]
    color = (1 - 0.4 * dry) * np.array((80, 110, 50)) + 0.4 * dry * np.array((128, 130, 72))
    return np.asarray(np.clip(value[..., None] * color, 0, 255), np.uint8)


@cache
def concrete() -> NDArray[np.uint8]:
    """Return (256, 256, 3): slabs with a joint on each edge, for a repeat of 1.5 m."""
    value = 1.0 + 0.035 * noise((256, 256), 0.4, 31) + 0.035 * noise((256, 256), 1.5, 32)
    value[:3, :] *= 0.72
    value[:, :3] *= 0.72
    return _tinted(value, (176, 173, 165))


@cache
def brick() -> NDArray[np.uint8]:
    """Return (256, 256, 3): eight courses of running bond, for a repeat of 0.6 m."""
    rng = np.random.default_rng(41)
    row, column = np.mgrid[0:256, 0:256]
    course = row // 32
    shifted = (column + 32 * (course % 2)) % 256
    tone = rng.uniform(0.82, 1.12, (8, 4))[course, shifted // 64]
    value = tone + 0.05 * noise((256, 256), 0.4, 42)
    image = _tinted(value, (158, 84, 64)).astype(np.float64)
    joint = (row % 32 < 4) | (shifted % 64 < 4)
    image[joint] = np.array((186, 178, 166)) * (1.0 + 0.03 * noise((256, 256), 0.4, 43))[joint][:, None]
    return np.clip(image, 0, 255).astype(np.uint8)


@cache
def siding() -> NDArray[np.uint8]:
    """Return (256, 256, 3): eight lapped boards in near white, for a repeat of 1.6 m; the colour tints it."""
    row = np.arange(256)
    lap = 0.93 + 0.07 * (row % 32) / 31.0
    lap[row % 32 >= 29] = 0.62
    value = lap[::-1, None] * (1.0 + 0.015 * noise((256, 256), 0.8, 51))
    return _tinted(value, (240, 240, 238))


@cache
def shingles() -> NDArray[np.uint8]:
    """Return (256, 256, 3): eight rows of tabs in light grey, for a repeat of 1.6 m; the material's colour tints it."""
    rng = np.random.default_rng(61)
    row, column = np.mgrid[0:256, 0:256]
    line = row // 32
    offset = rng.integers(0, 32, 8)[line]
    shifted = (column + offset) % 256
    tone = rng.uniform(0.72, 1.08, (8, 8))[line, shifted // 32]
    value = tone * (1.0 + 0.09 * noise((256, 256), 0.2, 62))
    value[(row % 32 < 4) | (shifted % 32 < 2)] *= 0.62
    return _tinted(value, (205, 205, 205))


@cache
def boards() -> NDArray[np.uint8]:
    """Return (256, 256, 3): eight upright planks, for a repeat of 1.2 m."""
    rng = np.random.default_rng(71)
    column = np.arange(256)
    tone = rng.uniform(0.82, 1.1, 8)[column // 32][None, :]
    grain = np.repeat(noise((32, 256), 0.3, 72), 8, axis=0)
    value = tone * (1.0 + 0.08 * grain)
    value[:, column % 32 < 2] *= 0.45
    return _tinted(value, (150, 112, 76))


@cache
def foliage() -> NDArray[np.uint8]:
    """Return (256, 256, 3): leaves over dark gaps in light green, for a repeat of 1.2 m; the colour tints it."""
    leaf = noise((256, 256), 0.75, 81)
    gap = np.clip(0.5 + 0.55 * noise((256, 256), 1.1, 82), 0.0, 1.0)
    value = np.clip(0.74 + 0.22 * leaf, 0.3, 1.25) * (0.55 + 0.45 * gap)
    return _tinted(value, (196, 220, 150))


@cache
def bark() -> NDArray[np.uint8]:
    """Return (128, 128, 3): upright furrows, for a repeat of 0.8 m."""
    value = 1.0 + 0.22 * np.repeat(noise((16, 128), 0.4, 91), 8, axis=0) + 0.1 * noise((128, 128), 0.6, 92)
    return _tinted(value, (102, 82, 64))


@cache
def garage_door() -> NDArray[np.uint8]:
    """Return (256, 256, 3): one sectional door, four rows of four panels, shown once."""
    row, column = np.mgrid[0:256, 0:256]
    value = np.full((256, 256), 0.97)
    r, c = row % 64, column % 64
    raised = (r > 12) & (r < 54) & (c > 8) & (c < 56)
    value[raised] = 0.92
    value[raised & ((r < 15) | (c < 11))] = 0.70
    value[raised & ((r > 51) | (c > 53))] = 1.0
    value[r < 2] = 0.6
    return _tinted(value, (240, 239, 235))


@cache
def surface(name: str, color: Vec3 = (1.0, 1.0, 1.0), specular: float = 0.0) -> Material:
    """Return the material of one of this file's textures, tinted; the same arguments give the same object."""
    makers = {f.__name__: f for f in (asphalt, grass, concrete, brick, siding, shingles, boards, foliage, bark)}
    makers["garage_door"] = garage_door
    return Material(name, color, makers[name](), specular=specular)


# sRGB as a colour picker shows them: far enough apart to be named without doubt.
PAINTS: dict[str, tuple[int, int, int]] = {
    "cyan": (0, 205, 220),
    "red": (200, 18, 24),
    "yellow": (245, 205, 10),
    "orange": (240, 110, 10),
    "blue": (20, 60, 190),
    "green": (20, 140, 50),
    "purple": (110, 35, 150),
    "pink": (240, 110, 170),
    "brown": (95, 58, 34),
    "white": (228, 230, 230),
    "silver": (166, 170, 174),
    "grey": (98, 102, 106),
    "black": (22, 23, 25),
}
NEUTRAL = ("white", "silver", "grey", "black")  # what parked vehicles wear, so that a target's colour stays its own


def linear(srgb: tuple[int, int, int]) -> Vec3:
    """Return an 8-bit sRGB colour as linear reflectance, 0 … 1 (IEC 61966-2-1)."""

    def channel(value: int) -> float:
        v = value / 255.0
        return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4

    return (channel(srgb[0]), channel(srgb[1]), channel(srgb[2]))


@cache
def paint(name: str) -> Material:
    """Return a car paint. Raises UsageError for a name that is not in PAINTS."""
    if name not in PAINTS:
        raise UsageError(f"paint '{name}' is not known: use one of {', '.join(PAINTS)}.")
    return Material(f"paint-{name}", linear(PAINTS[name]), specular=0.55)


@cache
def plain(name: str, srgb: tuple[int, int, int], specular: float = 0.0, emission: float = 0.0) -> Material:
    """Return an untextured material; the same arguments give the same object."""
    return Material(name, linear(srgb), specular=specular, emission=emission)


GLASS = plain("glass", (26, 34, 42), 0.9)
WINDOW = plain("window", (52, 66, 80), 0.9)
RUBBER = plain("rubber", (26, 26, 27), 0.05)
TRIM = plain("trim", (42, 43, 45), 0.15)
SHADOW = plain("wheel-housing", (9, 9, 10))
CHROME = plain("chrome", (200, 203, 207), 0.8)
RIM = plain("rim", (172, 175, 180), 0.6)
HEADLAMP = plain("headlamp", (236, 240, 244), 0.9, 0.15)
TAIL_LAMP = plain("tail-lamp", (170, 10, 14), 0.7, 0.12)
INDICATOR = plain("indicator", (228, 120, 20), 0.5, 0.08)
WHITE_WOOD = plain("white-wood", (232, 231, 226), 0.05)
STEEL = plain("steel", (90, 94, 98), 0.3)
