"""Makes materials of houses, and textures of walls, roofs, garage doors, and windows with curtains or blinds.

All textures are sRGB and have fixed seeds.
"""

from typing import NamedTuple

import numpy as np

from episodes.maps.assets.house_plans import BRICKS, ROOFS, TRIMS, WALLS, HousePlan
from episodes.maps.assets.materials import linear, noise, plain, surface, texture, tinted
from episodes.maps.scene import Material, Picture

TILE_M = {"brick": 0.6, "pale_brick": 0.6, "tiles": 1.6, "seams": 1.8}  # m per repeat of a texture; all others: 1.6


@texture
def pale_brick() -> Picture:
    """Return (256, 256, 3): bricks laid as in `materials.brick`, near white; the material tints it."""
    rng = np.random.default_rng(241)
    row, column = np.mgrid[0:256, 0:256]
    course = row // 32
    shifted = (column + 32 * (course % 2)) % 256
    value = rng.uniform(0.91, 1.04, (8, 4))[course, shifted // 64] + 0.03 * noise((256, 256), 0.4, 242)
    value[(row % 32 < 3) | (shifted % 64 < 3)] = 0.80
    return tinted(value, (232, 230, 226))


@texture
def battens() -> Picture:
    """Return (256, 256, 3): upright boards with a batten over each joint in near white; the material tints it."""
    column = np.arange(256) % 64
    line = np.where(column < 9, 1.04, 0.97)
    line[(column == 9) | (column == 10)] = 0.66
    line[column == 63] = 0.82
    value = line[None, :] * (1.0 + 0.015 * noise((256, 256), 0.8, 252))
    return tinted(value, (238, 238, 236))


@texture
def shakes() -> Picture:
    """Return (256, 256, 3): eight rows of wooden shingles of uneven width in near white; the material tints it."""
    rng = np.random.default_rng(261)
    row, column = np.mgrid[0:256, 0:256]
    line = row // 32
    shifted = (column + rng.integers(0, 256, 8)[line]) % 256
    edges = np.sort(rng.choice(np.arange(8, 250), (8, 11)), axis=1)
    part = (shifted[..., None] >= edges[line]).sum(axis=2)
    value = rng.uniform(0.84, 1.05, (8, 12))[line, part] * (0.93 + 0.07 * (1.0 - row % 32 / 31.0))
    value[(row % 32 > 28) | (np.abs(shifted[..., None] - edges[line]) < 1).any(axis=2)] *= 0.66
    return tinted(value, (234, 233, 230))


@texture
def render() -> Picture:
    """Return (256, 256, 3): smooth plaster in near white; the material tints it."""
    return tinted(1.0 + 0.025 * noise((256, 256), 0.5, 271) + 0.015 * noise((256, 256), 1.6, 272), (236, 235, 231))


@texture
def tiles() -> Picture:
    """Return (256, 256, 3): six rows of curved roof tiles in light grey; the material tints it."""
    rng = np.random.default_rng(281)
    row, column = np.mgrid[0:256, 0:256]
    line, part = np.minimum(row // 43, 5), column // 32
    bow = 0.72 + 0.34 * np.sin(np.pi * (column % 32 + 0.5) / 32.0)
    value = bow * rng.uniform(0.88, 1.06, (6, 8))[line, part] * (1.0 + 0.04 * noise((256, 256), 0.4, 282))
    value[row - 43 * line > 38] *= 0.6
    return tinted(value, (205, 203, 200))


@texture
def seams() -> Picture:
    """Return (256, 256, 3): a metal roof, four strips with raised seams, in light grey; the material tints it."""
    column = np.arange(256) % 64
    line = np.where(column < 4, 1.12, 1.0)
    line[(column == 4) | (column == 5)] = 0.62
    return tinted(line[None, :] * (1.0 + 0.02 * noise((256, 256), 1.2, 292)), (205, 206, 208))


@texture
def garage_lights() -> Picture:
    """Return (256, 256, 3): one sectional door whose top row is glazed; the texture does not repeat."""
    row, column = np.mgrid[0:256, 0:256]
    value = np.full((256, 256), 0.97)
    r, c = row % 64, column % 64
    value[(r < 2) | (np.abs(r - 32) < 1)] = 0.72
    value[(c < 2) & (row > 64)] = 0.86
    image = tinted(value, (240, 239, 235))
    pane = (row > 14) & (row < 54) & (c > 6) & (c < 58)
    image[pane] = (58, 70, 82)
    image[pane & ((row < 17) | (c < 9))] = (30, 36, 42)
    return image


@texture
def garage_planks() -> Picture:
    """Return (256, 256, 3): a pair of doors of upright planks with braces; the texture does not repeat."""
    row, column = np.mgrid[0:256, 0:256]
    value = 0.95 + 0.03 * ((column // 16) % 2)
    value[column % 16 < 1] = 0.74
    value[np.abs(column - 128) < 3] = 0.42
    for low in (20, 218):
        value[(row > low) & (row < low + 22)] = 1.0
        value[(row == low) | (row == low + 22)] = 0.7
    slope = np.abs((np.abs(column - 128) / 128.0) * 176 - (row - 42)) < 11
    value[slope & (row > 42) & (row < 218)] = 1.0
    return tinted(value, (240, 239, 235))


def _glass(seed: int) -> Picture:
    row, column = np.mgrid[0:96, 0:96]
    up = 1.0 - row / 95.0
    shade = 0.66 + 0.7 * np.clip(up + 0.16 * np.sin(column / 23.0 + seed) - 0.15, 0, 1)
    return np.asarray(np.clip(shade[..., None] * np.array((58, 74, 90)), 0, 255), np.uint8)


@texture
def curtains() -> Picture:
    """Return (96, 96, 3): a dark window with a curtain on either side; the texture does not repeat."""
    image, column = _glass(1), np.arange(96)
    folds = 0.82 + 0.18 * np.cos(column * 0.9)
    for side in (column < 24, column > 71):
        image[:, side] = (folds[side][:, None] * np.array((186, 182, 172))).astype(np.uint8)
    return image


@texture
def blind() -> Picture:
    """Return (96, 96, 3): a window with a blind over its upper third; the texture does not repeat."""
    image, row = _glass(2), np.arange(96)
    covered = row < 36
    image[covered] = (np.where(row[covered] % 6 < 2, 0.82, 1.0)[:, None, None] * np.array((204, 201, 190))).astype(
        np.uint8
    )
    image[36:39] = (90, 88, 82)
    return image


class HouseLooks(NamedTuple):
    """The materials of a house. A pair is a material and the metres per repeat of its texture."""

    wall: tuple[Material, float]
    roof: tuple[Material, float]
    bricks: tuple[Material, float]
    trim: Material


def looks_of(plan: HousePlan) -> HouseLooks:
    """Return a house's materials."""
    return HouseLooks(_wall(plan), _roof(plan), _bricks(plan), plain(f"trim-{plan.trim}", TRIMS[plan.trim], 0.05))


def _bricks(plan: HousePlan) -> tuple[Material, float]:
    name = "brick" if plan.bricks in ("red", "brown") else "pale_brick"
    return surface(name, linear(BRICKS[plan.bricks])), TILE_M[name]


def _wall(plan: HousePlan) -> tuple[Material, float]:
    if plan.brick:
        return _bricks(plan)
    return surface("siding" if plan.cladding == "lap" else plan.cladding, linear(WALLS[plan.wall])), 1.6


def _roof(plan: HousePlan) -> tuple[Material, float]:
    specular = 0.25 if plan.roofing == "seams" else 0.0
    return surface(plan.roofing, linear(ROOFS[plan.roof]), specular), TILE_M.get(plan.roofing, 1.6)
