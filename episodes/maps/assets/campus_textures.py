"""Textures of the campus: paving, stone, window panes, curtain walls, posters and lettering. Seeded, sRGB."""

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.materials import noise
from episodes.maps.scene import Material
from foundation.frames import Vec3

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Srgb = tuple[int, int, int]


def _tinted(value: Array, color: Srgb) -> Picture:
    """Return grey levels around 1 times an sRGB colour."""
    return np.asarray(np.clip(value[..., None] * np.array(color), 0, 255), np.uint8)


def _slabs(count: int, joint: int, spread: float, shift: bool, seed: int) -> Array:
    """Return (512, 512) grey levels of `count` × `count` slabs of varied tone; `shift` lays them in running bond."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[0:512, 0:512]
    side = 512 // count
    line = row // side
    shifted = (column + (line % 2) * (side // 2 if shift else 0)) % 512
    value = rng.uniform(1.0 - spread, 1.0 + spread, (count, count))[line, shifted // side]
    # the grain repeats twice each way, which the joints hide: a quarter of the work
    value += np.tile(0.03 * noise((256, 256), 0.5, seed + 1) + 0.02 * noise((256, 256), 1.4, seed + 2), (2, 2))
    value[(row % side < joint) | (shifted % side < joint)] *= 0.74
    return np.asarray(value)


@cache
def paving() -> Picture:
    """Return (512, 512, 3): square slabs of warm grey, for a repeat of 3 m."""
    return _tinted(_slabs(4, 4, 0.06, False, 101), (186, 178, 164))


@cache
def setts() -> Picture:
    """Return (512, 512, 3): small stone setts, for a repeat of 2 m."""
    return _tinted(_slabs(16, 3, 0.14, True, 111), (142, 132, 124))


@cache
def ashlar() -> Picture:
    """Return (512, 512, 3): dressed stone blocks in near white, for a repeat of 2.4 m; the colour tints it."""
    return _tinted(_slabs(4, 4, 0.05, True, 121), (236, 230, 216))


@cache
def panels() -> Picture:
    """Return (512, 512, 3): smooth concrete panels, for a repeat of 3.6 m; the colour tints it."""
    return _tinted(_slabs(2, 3, 0.025, False, 131), (226, 225, 220))


@cache
def curtain() -> Picture:
    """Return (256, 256, 3): one storey of glass wall, three panes wide over a dark spandrel, for a repeat of 3.6 m."""
    row, column = np.mgrid[0:256, 0:256]
    rng = np.random.default_rng(141)
    tone = rng.uniform(0.9, 1.12, 3)[np.minimum(column // 86, 2)]
    up = row / 255.0
    glass = (tone * (1.15 - 0.35 * up))[..., None] * np.array((96, 124, 142))
    image = np.where((row > 196)[..., None], np.array((62, 72, 80)), glass)
    image[(column % 86 < 4) | (row < 4) | (np.abs(row - 196) < 3)] = (176, 180, 182)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@cache
def pane(frame: Srgb, columns: int, blind: float) -> Picture:
    """Return (160, 120, 3): a window that shows once, `columns` lights wide, its blind drawn down by a share."""
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
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@cache
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


@cache
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
def posters(seed: int) -> Picture:
    """Return (160, 240, 3): sheets of paper pinned to a cork board; too small to read, as they should be."""
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
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@cache
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
def words(text: str, ink: Srgb, ground: Srgb) -> Picture:
    """Return (64, W, 3): `text` once on a plain ground, capitals three fifths of the height."""
    font, tall, thick = cv2.FONT_HERSHEY_DUPLEX, 256, 22
    (_, cap), _ = cv2.getTextSize("H", font, 1.0, 1)
    scale = 0.6 * tall / cap
    (wide, cap), _ = cv2.getTextSize(text, font, scale, thick)
    image = np.empty((tall, wide + tall // 2, 3), np.uint8)
    image[:] = np.array(ground, np.uint8)
    cv2.putText(image, text, (tall // 4, (tall + cap) // 2), font, scale, ink, thick, cv2.LINE_AA)
    return np.asarray(cv2.resize(image, (image.shape[1] // 4, 64), interpolation=cv2.INTER_AREA))


_MAKERS: dict[str, Callable[[], Picture]] = {
    f.__name__: f for f in (paving, setts, ashlar, panels, curtain, doors, shelves, dial)
}


@cache
def material(name: str, color: Vec3 = (1.0, 1.0, 1.0), specular: float = 0.0) -> Material:
    """Return the material of one of this file's textures, tinted; the same arguments give the same object."""
    return Material(name, color, _MAKERS[name](), specular=specular)


@cache
def window(frame: Srgb, columns: int, blind: float) -> Material:
    """Return the material of `pane`."""
    return Material(f"pane-{columns}-{blind}", (1.0, 1.0, 1.0), pane(frame, columns, blind), specular=0.45)


@cache
def board(seed: int) -> Material:
    """Return the material of `posters`."""
    return Material(f"posters-{seed}", (1.0, 1.0, 1.0), posters(seed))


@cache
def lettered(text: str, ink: Srgb = (40, 42, 46), ground: Srgb = (226, 222, 210)) -> Material:
    """Return the material of `words`."""
    return Material(f"words-{text}", (1.0, 1.0, 1.0), words(text, ink, ground))
