"""Makes paints, plain materials that assets share, and procedural sRGB textures with fixed seeds.

A texture "for a repeat of 4 m" covers 4 m × 4 m, then repeats.
"""

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Array, Material, Picture
from foundation.errors import UsageError
from foundation.frames import Vec3

Srgb = tuple[int, int, int]

# sRGB; the colours are far enough apart that each has an unambiguous name
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
# neutral paint → its shades. Parked vehicles have only these paints, so that a target's colour is unique
SHADES: dict[str, tuple[Srgb, ...]] = {
    "white": (PAINTS["white"], (226, 222, 212), (206, 210, 214)),
    "silver": (PAINTS["silver"], (174, 172, 168), (144, 148, 152)),
    "grey": (PAINTS["grey"], (74, 78, 82), (110, 109, 107)),
    "black": (PAINTS["black"], (31, 34, 38), (38, 37, 36)),
}


def noise(shape: tuple[int, int], power: float, seed: int, stretch: float = 1.0) -> Array:
    """Return tileable noise of mean 0 and deviation 1 whose spectrum falls with frequency**-power.

    Its features are `stretch` times as long down the picture as across it.
    """
    rng = np.random.default_rng(seed)
    rows = np.fft.fftfreq(shape[0])[:, None] * shape[0]
    columns = np.fft.fftfreq(shape[1])[None, :] * shape[1]
    radius = np.maximum(np.hypot(rows * stretch, columns), 1.0)
    spectrum = np.fft.fft2(rng.normal(size=shape)) / radius**power
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.asarray(field / field.std())


def _fine(value: Array) -> Array:
    """Return noise without its low frequencies, which would make the repeats of a texture visible from above."""
    slow = cv2.GaussianBlur(np.tile(value, (2, 2)), (0, 0), value.shape[0] / 40.0)
    half = [side // 2 for side in value.shape]
    back = np.roll(slow[half[0] : 3 * half[0], half[1] : 3 * half[1]], half, (0, 1))
    fine = value - back
    return np.asarray(fine / fine.std())


def fill_holes(picture: Picture, there: NDArray[np.bool_]) -> None:
    """Set the holes of a picture (H, W, 3) to the mean colour of its opaque texels, in place.

    `there` (H, W) is true for opaque texels. The original colours of holes would show as specks at their edges.
    """
    if there.any():
        picture[~there] = picture[there].mean(axis=0).astype(np.uint8)


def tinted(value: Array, color: tuple[float, float, float]) -> Picture:
    """Return the product of grey levels (H, W) around 1 and an sRGB colour, as a picture."""
    return np.asarray(np.clip(value[..., None] * np.array(color), 0, 255), np.uint8)


_TEXTURES: dict[str, Callable[[], Picture]] = {}


def texture(draw: Callable[[], Picture]) -> Callable[[], Picture]:
    """Make the texture that a function draws available to `surface`, under the function's name."""
    _TEXTURES[draw.__name__] = cache(draw)
    return _TEXTURES[draw.__name__]


@texture
def asphalt() -> Picture:
    """Return (512, 512, 3): dark aggregate with patches, for a repeat of 4 m."""
    value = 1.0 + 0.10 * noise((512, 512), 0.1, 11) + 0.04 * _fine(noise((512, 512), 1.0, 12))
    return tinted(value, (84, 84, 87))


@texture
def grass() -> Picture:
    """Return (512, 512, 3): mown lawn, for a repeat of 4 m. Its fine grain hides the repeats.

    `Material.drift` adds larger patches.
    """
    value = 1.0 + 0.15 * _fine(noise((512, 512), 0.5, 21))
    dry = np.clip(0.5 + 0.35 * _fine(noise((512, 512), 0.7, 23)), 0, 1)[..., None]
    color = (1 - 0.4 * dry) * np.array((80, 110, 50)) + 0.4 * dry * np.array((128, 130, 72))
    return np.asarray(np.clip(value[..., None] * color, 0, 255), np.uint8)


@texture
def concrete() -> Picture:
    """Return (256, 256, 3): slabs with a joint on each edge, for a repeat of 1.5 m."""
    value = 1.0 + 0.035 * noise((256, 256), 0.4, 31) + 0.035 * noise((256, 256), 1.5, 32)
    value[:3, :] *= 0.72
    value[:, :3] *= 0.72
    return tinted(value, (176, 173, 165))


@texture
def brick() -> Picture:
    """Return (256, 256, 3): eight courses of running bond, for a repeat of 0.6 m."""
    rng = np.random.default_rng(41)
    row, column = np.mgrid[0:256, 0:256]
    course = row // 32
    shifted = (column + 32 * (course % 2)) % 256
    tone = rng.uniform(0.82, 1.12, (8, 4))[course, shifted // 64]
    value = tone + 0.05 * noise((256, 256), 0.4, 42)
    image = tinted(value, (158, 84, 64)).astype(np.float64)
    joint = (row % 32 < 4) | (shifted % 64 < 4)
    image[joint] = np.array((186, 178, 166)) * (1.0 + 0.03 * noise((256, 256), 0.4, 43))[joint][:, None]
    return np.clip(image, 0, 255).astype(np.uint8)


@texture
def siding() -> Picture:
    """Return (256, 256, 3): eight lapped boards in near white, for a repeat of 1.6 m; the material tints it."""
    row = np.arange(256)
    lap = 0.93 + 0.07 * (row % 32) / 31.0
    lap[row % 32 >= 29] = 0.62
    value = lap[::-1, None] * (1.0 + 0.015 * noise((256, 256), 0.8, 51))
    return tinted(value, (240, 240, 238))


@texture
def shingles() -> Picture:
    """Return (256, 256, 3): eight rows of tabs in light grey, for a repeat of 1.6 m; the material tints it."""
    rng = np.random.default_rng(61)
    row, column = np.mgrid[0:256, 0:256]
    line = row // 32
    offset = rng.integers(0, 32, 8)[line]
    shifted = (column + offset) % 256
    tone = rng.uniform(0.72, 1.08, (8, 8))[line, shifted // 32]
    value = tone * (1.0 + 0.09 * noise((256, 256), 0.2, 62))
    value[(row % 32 < 4) | (shifted % 32 < 2)] *= 0.62
    return tinted(value, (205, 205, 205))


@texture
def boards() -> Picture:
    """Return (256, 256, 3): eight upright planks, for a repeat of 1.2 m."""
    rng = np.random.default_rng(71)
    column = np.arange(256)
    tone = rng.uniform(0.82, 1.1, 8)[column // 32][None, :]
    grain = np.repeat(noise((32, 256), 0.3, 72), 8, axis=0)
    value = tone * (1.0 + 0.08 * grain)
    value[:, column % 32 < 2] *= 0.45
    return tinted(value, (150, 112, 76))


@texture
def garage_door() -> Picture:
    """Return (256, 256, 3): one sectional door, four rows of four panels; the texture does not repeat."""
    row, column = np.mgrid[0:256, 0:256]
    value = np.full((256, 256), 0.97)
    r, c = row % 64, column % 64
    raised = (r > 12) & (r < 54) & (c > 8) & (c < 56)
    value[raised] = 0.92
    value[raised & ((r < 15) | (c < 11))] = 0.70
    value[raised & ((r > 51) | (c > 53))] = 1.0
    value[r < 2] = 0.6
    return tinted(value, (240, 239, 235))


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
def shade(name: str, number: int) -> Material:
    """Return one of the shades of a neutral car paint."""
    return Material(f"paint-{name}", linear(SHADES[name][number % len(SHADES[name])]), specular=0.55)


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


def _slabs(count: int, joint: int, spread: float, shift: bool, seed: int) -> Array:
    """Return (512, 512) grey levels of `count` × `count` slabs of varied tone; `shift` lays them in running bond."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[0:512, 0:512]
    side = 512 // count
    line = row // side
    shifted = (column + (line % 2) * (side // 2 if shift else 0)) % 512
    value = rng.uniform(1.0 - spread, 1.0 + spread, (count, count))[line, shifted // side]
    # the grain is tiled 2 × 2, which takes a quarter of the time; the joints hide the repeat
    value += np.tile(0.03 * noise((256, 256), 0.5, seed + 1) + 0.02 * noise((256, 256), 1.4, seed + 2), (2, 2))
    value[(row % side < joint) | (shifted % side < joint)] *= 0.74
    return np.asarray(value)


@texture
def paving() -> Picture:
    """Return (512, 512, 3): square slabs of warm grey, for a repeat of 3 m."""
    return tinted(_slabs(4, 4, 0.06, False, 101), (186, 178, 164))


@texture
def setts() -> Picture:
    """Return (512, 512, 3): small stone setts, for a repeat of 2 m."""
    return tinted(_slabs(16, 3, 0.14, True, 111), (142, 132, 124))


@texture
def ashlar() -> Picture:
    """Return (512, 512, 3): dressed stone blocks in near white, for a repeat of 2.4 m; the material tints it."""
    return tinted(_slabs(4, 4, 0.05, True, 121), (236, 230, 216))


@texture
def panels() -> Picture:
    """Return (512, 512, 3): smooth concrete panels, for a repeat of 3.6 m; the material tints it."""
    return tinted(_slabs(2, 3, 0.025, False, 131), (226, 225, 220))


@texture
def curtain() -> Picture:
    """Return (256, 256, 3): one storey of a glass wall, three panes above a dark spandrel, for a repeat of 3.6 m."""
    row, column = np.mgrid[0:256, 0:256]
    rng = np.random.default_rng(141)
    tone = rng.uniform(0.9, 1.12, 3)[np.minimum(column // 86, 2)]
    up = row / 255.0
    glass = (tone * (1.15 - 0.35 * up))[..., None] * np.array((96, 124, 142))
    image = np.where((row > 196)[..., None], np.array((62, 72, 80)), glass)
    image[(column % 86 < 4) | (row < 4) | (np.abs(row - 196) < 3)] = (176, 180, 182)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@cache
def window(frame: Srgb, columns: int, blind: float) -> Material:
    """Return the material of a window, `columns` panes wide; its blind covers the share `blind`, 0 … 1.

    Its texture (160, 120, 3) does not repeat.
    """
    row, column = np.mgrid[0:160, 0:120]
    up = 1.0 - row / 159.0
    shade = 0.62 + 0.75 * np.clip(up + 0.18 * np.sin(column / 40.0) - 0.15, 0, 1)
    image = shade[..., None] * np.array((66, 84, 98))
    covered = row < 6 + 148 * blind
    image[covered] = (np.where(row % 7 < 2, 0.86, 1.0)[..., None] * np.array((208, 204, 192)))[covered]
    image[min(159, int(6 + 148 * blind)) : min(160, int(10 + 148 * blind))] *= 0.6
    edge = (row < 7) | (row > 152) | (column < 7) | (column > 112) | (np.abs(row - 52) < 3)
    for k in range(1, columns):
        edge |= np.abs(column - round(120 * k / columns)) < 3
    image[edge] = frame
    picture = np.asarray(np.clip(image, 0, 255), np.uint8)
    return Material(f"pane-{columns}-{blind}", (1.0, 1.0, 1.0), picture, specular=0.45)


@texture
def doors() -> Picture:
    """Return (192, 192, 3): a pair of glazed doors with pull bars."""
    row, column = np.mgrid[0:192, 0:192]
    image = (0.7 + 0.5 * (1 - row / 191.0))[..., None] * np.array((58, 70, 80))
    frame = (
        (row < 10) | (row > 178) | (column < 9) | (column > 182) | (np.abs(column - 96) < 7) | (np.abs(row - 44) < 4)
    )
    image[frame] = (54, 52, 50)
    for x in (82, 110):
        image[(np.abs(column - x) < 3) & (np.abs(row - 112) < 30)] = (206, 206, 202)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@texture
def shelves() -> Picture:
    """Return (288, 160, 3): the front of a vending machine, five shelves behind glass and a panel of keys."""
    rng = np.random.default_rng(151)
    image = np.empty((288, 160, 3), np.float64)
    image[:] = (58, 62, 68)
    image[14:212, 10:112] = (20, 24, 28)
    goods = [(196, 70, 52), (222, 186, 60), (64, 128, 84), (70, 108, 168), (214, 210, 200), (150, 88, 50)]
    for shelf in range(5):
        base = 50 + 38 * shelf
        for k in range(7):
            tall, x = int(rng.integers(20, 29)), 14 + 14 * k
            image[base - tall : base, x : x + 10] = goods[int(rng.integers(len(goods)))]
            image[base - tall + 6 : base - tall + 12, x : x + 10] = (236, 232, 222)
        image[base : base + 4, 10:112] = (168, 170, 172)
    image[222:262, 14:108] = (24, 26, 28)
    image[222:226, 14:108] = (150, 152, 154)
    image[40:76, 122:150] = (150, 196, 190)
    for r in range(4):
        for c in range(3):
            image[92 + 15 * r : 102 + 15 * r, 122 + 10 * c : 129 + 10 * c] = (210, 210, 206)
    image[168:182, 126:146] = (18, 18, 20)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@cache
def notices(seed: int) -> Material:
    """Return the material of a cork board with sheets of paper. Their text is illegible on purpose.

    Its texture has the shape (160, 240, 3).
    """
    rng = np.random.default_rng(160 + seed)
    image = (1.0 + 0.08 * noise((160, 240), 0.4, 161))[..., None] * np.array((150, 112, 74))
    for row in range(2):
        for column in range(5):
            if rng.random() < 0.15:
                continue
            y, x = 10 + 74 * row + int(rng.integers(0, 8)), 8 + 46 * column + int(rng.integers(0, 6))
            tall, wide = int(rng.integers(48, 62)), int(rng.integers(30, 40))
            image[y : y + tall, x : x + wide] = np.array((238, 236, 226)) * rng.uniform(0.86, 1.0)
            image[y + 5 : y + 15, x + 4 : x + wide - 4] = rng.uniform(60, 150, 3)
            for line in range(y + 22, y + tall - 5, 6):
                image[line : line + 2, x + 4 : x + wide - int(rng.integers(5, 14))] = (120, 120, 118)
    return Material(f"posters-{seed}", (1.0, 1.0, 1.0), np.asarray(np.clip(image, 0, 255), np.uint8))


@texture
def dial() -> Picture:
    """Return (256, 256, 3): a clock face at ten past ten."""
    image = np.full((1024, 1024, 3), (190, 182, 164), np.uint8)
    cv2.circle(image, (512, 512), 470, (238, 234, 222), -1, cv2.LINE_AA)
    cv2.circle(image, (512, 512), 470, (44, 42, 40), 30, cv2.LINE_AA)
    for hour in range(12):
        turn = 2 * np.pi * hour / 12
        a, b = (np.array((np.sin(turn), -np.cos(turn))) * r + 512 for r in (350, 425))
        cv2.line(image, tuple(a.astype(int).tolist()), tuple(b.astype(int).tolist()), (44, 42, 40), 34, cv2.LINE_AA)
    for turn, reach, thick in ((2 * np.pi * 10.17 / 12, 230, 40), (2 * np.pi * 10 / 60, 360, 26)):
        tip = (np.array((np.sin(turn), -np.cos(turn))) * reach + 512).astype(int)
        cv2.line(image, (512, 512), tuple(tip.tolist()), (30, 30, 32), thick, cv2.LINE_AA)
    return np.asarray(cv2.resize(image, (256, 256), interpolation=cv2.INTER_AREA))


@cache
def lettered(text: str, ink: Srgb = (40, 42, 46), ground: Srgb = (226, 222, 210)) -> Material:
    """Return the material of one line of text on a plain ground.

    Its texture has the shape (64, W, 3). Capitals have three fifths of the height.
    """
    font, tall, thick = cv2.FONT_HERSHEY_DUPLEX, 256, 22
    (_, cap), _ = cv2.getTextSize("H", font, 1.0, 1)
    scale = 0.6 * tall / cap
    (wide, cap), _ = cv2.getTextSize(text, font, scale, thick)
    image = np.empty((tall, wide + tall // 2, 3), np.uint8)
    image[:] = np.array(ground, np.uint8)
    cv2.putText(image, text, (tall // 4, (tall + cap) // 2), font, scale, ink, thick, cv2.LINE_AA)
    picture = np.asarray(cv2.resize(image, (image.shape[1] // 4, 64), interpolation=cv2.INTER_AREA))
    return Material(f"words-{text}", (1.0, 1.0, 1.0), picture)


_DRIFT = {"grass": 0.16, "asphalt": 0.09, "concrete": 0.06, "paving": 0.05, "setts": 0.05}


@cache
def surface(name: str, color: Vec3 = (1.0, 1.0, 1.0), specular: float = 0.0) -> Material:
    """Return the tinted material of a texture; the same arguments give the same object."""
    return Material(name, color, _TEXTURES[name](), specular=specular, drift=_DRIFT.get(name, 0.0))
