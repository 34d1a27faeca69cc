"""Makes the materials of leaves and bark of each species, with sRGB textures that have fixed seeds.

A texture of leaves has 2 × 2 sprigs: small twigs with their leaves, cut out. Each sprig grows from the middle of the
lower edge of its quarter and is nearly as wide as high. The texture is pale, and the material's colour tints it, so a
season changes only the material's colour.
"""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.materials import Srgb, fill_holes, linear, noise, tinted
from episodes.maps.scene import Array, Material, Picture

SIDE = 256  # texels, width and height of a sprig
FINE = 2  # textures are drawn this many times larger, then reduced
PALE = (214.0, 216.0, 196.0)  # sRGB of a leaf in a texture
TWIG = (116.0, 100.0, 84.0)
SHADE = 0.55  # brightness of the inner leaves of a crown, relative to the outer leaves

# outlines of half a leaf from base to tip: (position along the leaf, half width), as shares of the leaf's length
_OVAL = ((0.0, 0.03), (0.2, 0.2), (0.5, 0.27), (0.8, 0.16), (1.0, 0.0))
_LOBED = ((0, 0.02), (0.18, 0.12), (0.24, 0.2), (0.34, 0.12), (0.46, 0.27), (0.56, 0.16), (0.7, 0.28), (0.8, 0.14),
          (0.92, 0.13), (1.0, 0.0))  # fmt: skip
_PALMATE = ((0, 0.02), (0.06, 0.3), (0.2, 0.22), (0.34, 0.52), (0.44, 0.26), (0.62, 0.3), (0.7, 0.14), (1.0, 0.0))
_HEART = ((0.0, 0.02), (0.02, 0.26), (0.22, 0.4), (0.5, 0.36), (0.8, 0.14), (1.0, 0.0))
_KITE = ((0.0, 0.02), (0.22, 0.3), (0.36, 0.32), (1.0, 0.0))
_OUTLINES = {"oval": _OVAL, "lobed": _LOBED, "palmate": _PALMATE, "heart": _HEART, "kite": _KITE}

# species → (tint of the leaves; outline of a leaf, or 'tufts' or 'frond' for needles; length of a leaf or needle in
# sprig widths; number of leaves, tufts or side twigs of a frond per sprig)
_SPECIES: dict[str, tuple[Srgb, str, float, int]] = {
    "oak": ((116, 142, 66), "lobed", 0.20, 88),
    "maple": ((142, 164, 72), "palmate", 0.18, 84),
    "birch": ((164, 182, 96), "kite", 0.11, 150),
    "linden": ((118, 156, 74), "heart", 0.15, 110),
    "poplar": ((134, 158, 84), "kite", 0.14, 120),
    "pine": ((108, 136, 92), "tufts", 0.20, 15),
    "spruce": ((92, 124, 92), "frond", 0.13, 26),
    "box": ((106, 138, 62), "oval", 0.12, 150),
    "lilac": ((122, 146, 88), "heart", 0.16, 90),
    "spirea": ((148, 158, 80), "oval", 0.10, 150),
}
_BARK: dict[str, Srgb] = {
    "oak": (122, 108, 92),
    "maple": (134, 122, 108),
    "birch": (236, 234, 226),
    "linden": (118, 110, 98),
    "poplar": (140, 134, 118),
    "pine": (158, 118, 92),
    "spruce": (112, 92, 76),
    "lilac": (118, 106, 92),
}


@cache
def leaves(species: str) -> Material:
    """Return the cut-out material of the sprigs of a species."""
    color, kind, size, count = _SPECIES[species]
    picture, there = _sprigs(kind, size, count)
    return Material(f"leaves-{species}", linear(color), picture, cutout=there, foliage=True)


@cache
def thicket(species: str) -> Material:
    """Return the material of the inside of a crown or hedge: leaves in the shade, without holes."""
    color, kind, *_ = _SPECIES[species]
    red, green, blue = linear(color)
    return Material(
        f"thicket-{species}", (SHADE * red, SHADE * green, SHADE * blue), _dense(kind in ("tufts", "frond"))
    )


@cache
def bark(species: str) -> Material:
    """Return the material of a trunk and its branches."""
    return Material(f"bark-{species}", linear(_BARK[species]), _paper_bark() if species == "birch" else _furrows())


@cache
def _sprigs(kind: str, size: float, count: int) -> tuple[Picture, NDArray[np.bool_]]:
    """Return the texture (512, 512, 3) of sprigs and the mask (512, 512) of its opaque texels."""
    sheet = _Sheet(2 * SIDE * FINE)
    for k in range(4):
        rng = np.random.default_rng((sum(kind.encode()), count, k))
        corner = np.array((k % 2, k // 2)) * float(SIDE * FINE)
        if kind == "tufts":
            _needle_tufts(sheet, corner, size, count, rng)
        elif kind == "frond":
            _frond(sheet, corner, size, count, rng)
        else:
            _twig_of_leaves(sheet, corner, np.array(_OUTLINES[kind]), size, count, rng)
    return sheet.reduced()


class _Sheet:
    """A picture with an opacity mask. Later shapes cover earlier ones."""

    def __init__(self, side: int) -> None:
        self.color = np.zeros((side, side, 3), np.float32)
        self.there = np.zeros((side, side), np.uint8)

    def polygon(self, points: Array, color: Array) -> None:
        at = [np.rint(points * 16.0).astype(np.int32)]
        cv2.fillPoly(self.color, at, color.tolist(), shift=4)
        cv2.fillPoly(self.there, at, 255, shift=4)

    def line(self, a: Array, b: Array, color: Array, width: int) -> None:
        p, q = (tuple(np.rint(x * 16.0).astype(int).tolist()) for x in (a, b))
        cv2.line(self.color, p, q, color.tolist(), width, shift=4)
        cv2.line(self.there, p, q, 255, width, shift=4)

    def reduced(self) -> tuple[Picture, NDArray[np.bool_]]:
        """Return picture and mask at the final size. Texels covered to at least one half are opaque.

        Holes get the mean colour.
        """
        weight = (self.there > 0).astype(np.float32)
        size = (len(weight) // FINE,) * 2
        share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
        color = cv2.resize(self.color * weight[..., None], size, interpolation=cv2.INTER_AREA)
        picture = np.clip(color / np.maximum(share, 1e-6)[..., None], 0, 255).astype(np.uint8)
        there = share >= 0.5
        fill_holes(picture, there)
        return picture, there


def _tint(tone: float, rng: np.random.Generator) -> Array:
    """Return the colour of one leaf with the brightness `tone`, at random a little yellower or bluer."""
    warm = rng.normal() * 0.05
    return np.asarray(np.clip(np.array(PALE) * tone * (1.0 + warm, 1.0 + 0.3 * warm, 1.0 - 1.6 * warm), 0, 255))


def _leaf(sheet: _Sheet, foot: Array, way: Array, length: float, outline: Array, color: Array) -> None:
    side = np.array((-way[1], way[0]))
    along = foot + outline[:, :1] * length * way
    across = outline[:, 1:] * length * side
    sheet.polygon(np.concatenate([along + across, (along - across)[::-1]]), color)
    sheet.polygon(np.concatenate([along, (along - 0.96 * across)[::-1]]), color * 0.88)  # the half in shade
    sheet.line(foot, foot + 0.9 * length * way, np.minimum(color * 1.12, 255.0), 1)


def _twig_of_leaves(
    sheet: _Sheet, corner: Array, outline: Array, size: float, count: int, rng: np.random.Generator
) -> None:
    """Draw a twig that branches like a fan, with leaves along all branches."""
    side = SIDE * FINE
    foot = corner + np.array((0.5, 0.96)) * side
    ends = []
    for turn in np.linspace(-1.15, 1.15, 7) + rng.uniform(-0.12, 0.12, 7):
        reach = side * rng.uniform(0.62, 0.84) * (1.0 - 0.20 * abs(turn))
        end = foot + reach * np.array((np.sin(turn), -np.cos(turn)))
        middle = foot + 0.5 * reach * np.array((np.sin(0.7 * turn), -np.cos(0.7 * turn)))
        sheet.line(foot, middle, np.array(TWIG), 3 * FINE)
        sheet.line(middle, end, np.array(TWIG), 2 * FINE)
        ends.append((foot, middle, end))
    # leaves are moved so that their tips stay in the sprig's quarter of the texture
    length = size * side
    order = np.sort(np.sqrt(rng.uniform(0.02, 1.0, count)))
    for share in order.tolist():
        a, b, c = ends[int(rng.integers(len(ends)))]
        at = a + (b - a) * 2 * share if share < 0.5 else b + (c - b) * (2 * share - 1)
        at = at + rng.normal(size=2) * 0.035 * side
        out = at - foot
        turn = np.arctan2(out[0], -out[1]) + rng.uniform(-1.3, 1.3)
        way = np.array((np.sin(turn), -np.cos(turn)))
        long = length * rng.uniform(0.75, 1.15)
        at = np.clip(at + long * way, corner + 0.02 * side, corner + 0.98 * side) - long * way
        at = np.clip(at, corner + 0.03 * side, corner + 0.97 * side)
        _leaf(sheet, at, way, long, outline, _tint(rng.uniform(0.55, 0.80) + 0.24 * share, rng))


def _needle_tufts(sheet: _Sheet, corner: Array, size: float, count: int, rng: np.random.Generator) -> None:
    """Draw the ends of pine twigs with tufts of needles."""
    side = SIDE * FINE
    foot = corner + np.array((0.5, 0.95)) * side
    for share in np.sort(rng.uniform(0.15, 1.0, count)).tolist():
        turn = rng.uniform(-1.1, 1.1)
        end = foot + side * 0.76 * share * np.array((np.sin(turn) * 0.62, -np.cos(turn * 0.8)))
        sheet.line(foot + 0.35 * (end - foot), end, np.array(TWIG), 2 * FINE)
        for _ in range(46):
            way = turn + rng.normal() * 0.95
            tip = end + size * side * rng.uniform(0.55, 1.0) * np.array((np.sin(way), -np.cos(way)))
            tip = np.clip(tip, corner + 0.02 * side, corner + 0.98 * side)
            sheet.line(end, tip, _tint(rng.uniform(0.5, 0.85) + 0.2 * share, rng), FINE + 1)


def _frond(sheet: _Sheet, corner: Array, size: float, count: int, rng: np.random.Generator) -> None:
    """Draw a spruce's branch: a stem with side twigs that grow shorter towards its tip, all covered with needles."""
    side = SIDE * FINE
    foot, tip = corner + np.array((0.5, 0.98)) * side, corner + np.array((0.5 + rng.normal() * 0.02, 0.05)) * side
    sheet.line(foot, tip, np.array(TWIG), 3 * FINE)
    for k, share in enumerate(np.linspace(0.02, 0.97, count).tolist()):
        at = foot + (tip - foot) * share
        hand = 1.0 if k % 2 else -1.0
        reach = side * 0.50 * (1.0 - share) ** 0.75 * rng.uniform(0.8, 1.0) + 0.05 * side
        turn = hand * rng.uniform(0.85, 1.1)
        end = at + min(reach, 0.46 * side / abs(np.sin(turn))) * np.array((np.sin(turn), -np.cos(turn)))
        sheet.line(at, end, np.array(TWIG), FINE)
        for along in np.linspace(0.05, 1.0, 24).tolist():
            for lean in (-0.8, 0.8):
                a, way = at + (end - at) * along, turn + lean + rng.normal() * 0.15
                b = a + size * side * rng.uniform(0.35, 0.6) * np.array((np.sin(way), -np.cos(way)))
                b = np.clip(b, corner + 0.01 * side, corner + 0.99 * side)
                sheet.line(a, b, _tint(rng.uniform(0.5, 0.75) + 0.25 * along, rng), FINE + 1)


@cache
def _dense(needles: bool) -> Picture:
    """Return (256, 256, 3): overlapping leaves or needles, which repeat every 1.2 m."""
    side, rng = SIDE * FINE, np.random.default_rng(83 + needles)
    sheet = _Sheet(side)
    sheet.color[:], sheet.there[:] = np.array(PALE) * 0.30, 255
    outline = np.array(((0.0, 0.03), (0.4, 0.05), (1.0, 0.0)) if needles else _OVAL)
    for depth in np.sort(rng.uniform(0.0, 1.0, 700 if needles else 420)).tolist():
        foot, turn = rng.uniform(0.0, side, 2), rng.uniform(0.0, 2.0 * np.pi)
        color = _tint(0.38 + 0.62 * depth, rng)
        for shift in ((0, 0), (side, 0), (-side, 0), (0, side), (0, -side)):  # so that the picture tiles
            _leaf(sheet, foot + shift, np.array((np.sin(turn), np.cos(turn))), 0.13 * side, outline, color)
    return np.asarray(cv2.resize(sheet.color, (SIDE, SIDE), interpolation=cv2.INTER_AREA).clip(0, 255), np.uint8)


@cache
def _furrows() -> Picture:
    """Return (256, 256, 3): pale grey bark with upright furrows, which repeats every 0.8 m; the material tints it."""
    ridge = np.abs(noise((256, 256), 1.3, 91, stretch=5.0))
    fine = noise((256, 256), 0.5, 92, stretch=3.0)
    value = 0.62 + 0.42 * np.clip(ridge, 0.0, 1.0) ** 0.6 + 0.07 * fine
    return tinted(value, (212, 206, 198))


@cache
def _paper_bark() -> Picture:
    """Return (256, 256, 3): a birch's white bark with short dark lines across and black scars."""
    rng = np.random.default_rng(95)
    image = (1.0 + 0.05 * noise((256, 256), 1.0, 96))[..., None] * np.array((226.0, 222.0, 212.0))
    for _ in range(70):
        x, y, long = int(rng.integers(256)), int(rng.integers(256)), int(rng.integers(8, 44))
        image[y : y + int(rng.integers(1, 4)), x : x + long] *= rng.uniform(0.35, 0.65)
    for _ in range(5):
        x, y = rng.integers(20, 236, 2).tolist()
        cv2.ellipse(image, (x, y), (int(rng.integers(10, 20)), int(rng.integers(5, 10))), 0, 0, 360, (52, 48, 44), -1)
    return np.asarray(np.clip(image, 0, 255), np.uint8)
