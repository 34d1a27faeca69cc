"""Textures of walls, roofs, garage doors, and windows with curtains or blinds. All are sRGB and have fixed seeds."""

from collections.abc import Callable
from functools import cache

import numpy as np

from episodes.maps.assets.house_plans import BRICKS, ROOFS, WALLS, HousePlan
from episodes.maps.assets.materials import Picture, linear, noise, surface, tinted
from episodes.maps.scene import Material
from foundation.frames import Vec3

TILE_M = {"brick": 0.6, "pale_brick": 0.6, "tiles": 1.6, "seams": 1.8}  # m per repeat; 1.6 for all others


@cache
def pale_brick() -> Picture:
    """Return (256, 256, 3): the bond of `materials.brick` in near white; the material tints it."""
    rng = np.random.default_rng(241)
    row, column = np.mgrid[0:256, 0:256]
    course = row // 32
    shifted = (column + 32 * (course % 2)) % 256
    value = rng.uniform(0.91, 1.04, (8, 4))[course, shifted // 64] + 0.03 * noise((256, 256), 0.4, 242)
    value[(row % 32 < 3) | (shifted % 64 < 3)] = 0.80
    return tinted(value, (232, 230, 226))


@cache
def battens() -> Picture:
    """Return (256, 256, 3): upright boards with a batten over each joint in near white; the material tints it."""
    column = np.arange(256) % 64
    line = np.where(column < 9, 1.04, 0.97)
    line[(column == 9) | (column == 10)] = 0.66
    line[column == 63] = 0.82
    value = line[None, :] * (1.0 + 0.015 * noise((256, 256), 0.8, 252))
    return tinted(value, (238, 238, 236))


@cache
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


@cache
def render() -> Picture:
    """Return (256, 256, 3): smooth plaster in near white; the material tints it."""
    return tinted(1.0 + 0.025 * noise((256, 256), 0.5, 271) + 0.015 * noise((256, 256), 1.6, 272), (236, 235, 231))


@cache
def tiles() -> Picture:
    """Return (256, 256, 3): six rows of curved roof tiles in light grey; the material tints it."""
    rng = np.random.default_rng(281)
    row, column = np.mgrid[0:256, 0:256]
    line, part = np.minimum(row // 43, 5), column // 32
    bow = 0.72 + 0.34 * np.sin(np.pi * (column % 32 + 0.5) / 32.0)
    value = bow * rng.uniform(0.88, 1.06, (6, 8))[line, part] * (1.0 + 0.04 * noise((256, 256), 0.4, 282))
    value[row - 43 * line > 38] *= 0.6
    return tinted(value, (205, 203, 200))


@cache
def seams() -> Picture:
    """Return (256, 256, 3): a metal roof, four strips with raised seams, in light grey; the material tints it."""
    column = np.arange(256) % 64
    line = np.where(column < 4, 1.12, 1.0)
    line[(column == 4) | (column == 5)] = 0.62
    return tinted(line[None, :] * (1.0 + 0.02 * noise((256, 256), 1.2, 292)), (205, 206, 208))


@cache
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


@cache
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


@cache
def curtains() -> Picture:
    """Return (96, 96, 3): a dark window with a curtain on either side; the texture does not repeat."""
    image, column = _glass(1), np.arange(96)
    folds = 0.82 + 0.18 * np.cos(column * 0.9)
    for side in (column < 24, column > 71):
        image[:, side] = (folds[side][:, None] * np.array((186, 182, 172))).astype(np.uint8)
    return image


@cache
def blind() -> Picture:
    """Return (96, 96, 3): a window with a blind over its upper third; the texture does not repeat."""
    image, row = _glass(2), np.arange(96)
    covered = row < 36
    image[covered] = (np.where(row[covered] % 6 < 2, 0.82, 1.0)[:, None, None] * np.array((204, 201, 190))).astype(
        np.uint8
    )
    image[36:39] = (90, 88, 82)
    return image


_TEXTURES: dict[str, Callable[[], Picture]] = {
    texture.__name__: texture
    for texture in (
        pale_brick, battens, shakes, render, tiles, seams, garage_lights, garage_planks, curtains, blind,
    )
}  # fmt: skip


@cache
def house_surface(name: str, color: Vec3 = (1.0, 1.0, 1.0), specular: float = 0.0) -> Material:
    """Return the tinted material of a texture of this module; the same arguments give the same object."""
    return Material(name, color, _TEXTURES[name](), specular=specular)


def bricks(plan: HousePlan) -> tuple[Material, float]:
    """Return the material of a plan's brickwork and its metres per repeat."""
    name = "brick" if plan.bricks in ("red", "brown") else "pale_brick"
    color = linear(BRICKS[plan.bricks])
    return (surface(name, color) if name == "brick" else house_surface(name, color)), TILE_M[name]


def wall(plan: HousePlan) -> tuple[Material, float]:
    """Return the material of a plan's walls and its metres per repeat."""
    if plan.brick:
        return bricks(plan)
    color = linear(WALLS[plan.wall])
    return (surface("siding", color) if plan.cladding == "lap" else house_surface(plan.cladding, color)), 1.6


def roof(plan: HousePlan) -> tuple[Material, float]:
    """Return the material of a plan's roof and its metres per repeat."""
    color = linear(ROOFS[plan.roof])
    if plan.roofing == "shingles":
        return surface("shingles", color), 1.6
    return house_surface(plan.roofing, color, 0.25 if plan.roofing == "seams" else 0.0), TILE_M[plan.roofing]
