"""Builds meshes for streets and gardens: lamps, mailboxes, fences, name posts, a guard rail, bins, a hydrant."""

from functools import lru_cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.lettering import plate
from episodes.maps.assets.materials import surface
from episodes.maps.scene import Material, Mesh
from foundation.frames import Vec3

# linear tints of `materials.boards`: new, weathered, stained dark, bare
BOARD_TONES: tuple[Vec3, ...] = ((1.0, 1.0, 1.0), (0.78, 0.86, 0.94), (0.56, 0.50, 0.46), (1.12, 1.16, 1.2))
GREY_WOOD = materials.plain("grey-wood", (150, 152, 150), 0.05)


def lamp(height: float = 5.6) -> Mesh:
    """Return a street lamp whose arm reaches forward."""
    steel = materials.plain("lamp-steel", (58, 64, 66), 0.3)
    glass = materials.plain("lamp-glass", (235, 232, 214), 0.5, 0.3)
    arm = 1.5
    solids = [
        g.rod((0, 0, 0), (0, 0, 0.5), (0.14, 0.11), steel, 10),
        g.rod((0, 0, 0.4), (0, 0, height), (0.075, 0.05), steel, 10),
        g.rod((0, 0, height - 0.25), (arm * 0.45, 0, height + 0.12), (0.045, 0.04), steel, 8),
        g.rod((arm * 0.45, 0, height + 0.12), (arm, 0, height + 0.16), (0.04, 0.04), steel, 8),
        g.hull(
            [
                (arm + x, y, height + z)
                for x, y, z in ((-0.1, -0.13, 0.08), (0.5, -0.1, 0.1), (0.5, 0.1, 0.1), (-0.1, 0.13, 0.08))
            ],
            [
                (arm + x, y, height + z)
                for x, y, z in ((-0.05, -0.06, 0.22), (0.4, -0.05, 0.2), (0.4, 0.05, 0.2), (-0.05, 0.06, 0.22))
            ],
            steel,
        ),
        g.box((arm, -0.09, height + 0.06), (arm + 0.42, 0.09, height + 0.10), glass),
    ]
    return g.assemble(solids)


@lru_cache(maxsize=8)
def mailbox(number: int = 0) -> Mesh:
    """Return a kerbside mailbox that opens forward, in one of four looks."""
    color = ((52, 58, 66), (206, 206, 200), (110, 114, 116), (72, 78, 68))[number % 4]
    tin, wood = materials.plain("mailbox", color, 0.4), (surface("boards"), materials.WHITE_WOOD)[number // 2 % 2]
    ring = [(0.11 * np.cos(a), 1.12 + 0.11 * np.sin(a)) for a in np.linspace(0, np.pi, 9)] + [(-0.11, 1.0), (0.11, 1.0)]
    body = g.transformed(g.profile(ring, -0.24, 0.24, tin), yaw=np.pi / 2)
    flag = materials.plain("flag", (186, 188, 190))
    return g.assemble(
        [
            g.box((-0.05, -0.05, 0.0), (0.05, 0.05, 1.0), wood),
            body,
            g.box((0.05, 0.112, 1.10), (0.09, 0.125, 1.30), flag),
            g.box((0.05, 0.112, 1.24), (0.17, 0.125, 1.30), flag),
        ]
    )


@lru_cache(maxsize=64)
def board_fence(length: float = 10.0, height: float = 1.8, tone: int = 0) -> Mesh:
    """Return a fence along the forward axis, of boards without gaps, in one of four tones of wood."""
    wood = surface("boards", BOARD_TONES[tone % len(BOARD_TONES)])
    half = length / 2
    solids = [g.box((-half, -0.02, 0.05), (half, 0.02, height), wood, 1.2)]
    solids += [g.box((-half, 0.02, z), (half, 0.07, z + 0.09), wood, 1.2) for z in (0.35, height - 0.4)]
    solids += [
        g.box((x - 0.05, -0.03, -0.2), (x + 0.05, 0.09, height + 0.06), wood, 1.2)
        for x in np.linspace(-half + 0.05, half - 0.05, max(2, round(length / 3.3) + 1))
    ]
    return g.assemble([g.without(p, (0.0, 0.0, -1.0)) for p in solids])


def picket_fence(length: float = 6.0, height: float = 0.95, tone: int = 0) -> Mesh:
    """Return a picket fence along the forward axis: white, grey or of bare wood."""
    wood, half = (materials.WHITE_WOOD, GREY_WOOD, surface("boards", BOARD_TONES[3]))[tone % 3], length / 2
    solids = [g.box((-half, -0.035, z), (half, -0.01, z + 0.08), wood) for z in (0.25, height - 0.28)]
    solids += [
        g.box((x - 0.05, -0.09, -0.2), (x + 0.05, 0.0, height + 0.05), wood)
        for x in np.linspace(-half + 0.05, half - 0.05, max(2, round(length / 2.0) + 1))
    ]
    ring = [(-0.045, 0.06), (0.045, 0.06), (0.045, height - 0.07), (0.0, height), (-0.045, height - 0.07)]
    picket = g.profile(ring, -0.01, 0.012, wood)
    solids += [g.transformed(picket, (float(x), 0.0, 0.0)) for x in np.arange(-half + 0.08, half - 0.04, 0.19)]
    return g.assemble([g.without(p, (0.0, 0.0, -1.0)) for p in solids])


def name_post(along: str, across: str) -> Mesh:
    """Return a post with two street-name blades: `along` for the street that runs forward, `across` for the other."""
    steel = materials.STEEL
    solids = [g.rod((0, 0, -0.2), (0, 0, 2.75), (0.035, 0.035), steel, 8)]
    for text, z, turn in ((along, 2.25, 0.0), (across, 2.5, np.pi / 2)):
        picture = plate(text.upper(), ink=(238, 238, 232), ground=(52, 60, 68))
        look = Material(f"name-{text}", (1.0, 1.0, 1.0), picture)
        half, high = 0.11 * picture.shape[1] / picture.shape[0], 0.22
        blade = [g.box((-half, -0.012, z), (half, 0.012, z + high), steel)]
        for wide, y in ((half, 0.014), (-half, -0.014)):  # the lettering on both sides of the blade
            blade.append(g.quad([(wide, y, z), (-wide, y, z), (-wide, y, z + high), (wide, y, z + high)], look))
        solids += [g.transformed(p, yaw=turn) for p in blade]
    return g.assemble(solids)


def barrier(length: float = 7.4) -> Mesh:
    """Return a timber guard rail along the forward axis, for the end of a dead-end road."""
    wood, half = surface("boards"), length / 2
    solids = [g.box((-half, -0.05, z), (half, 0.03, z + 0.22), wood, 1.2) for z in (0.30, 0.66)]
    solids += [
        g.box((x - 0.09, 0.03, -0.3), (x + 0.09, 0.19, 0.98), wood, 1.2)
        for x in np.linspace(-half + 0.3, half - 0.3, max(2, round(length / 1.8) + 1))
    ]
    return g.assemble(solids)


@lru_cache(maxsize=8)
def bin(number: int = 0) -> Mesh:
    """Return a wheeled refuse bin in one of three dark colours."""
    shell = materials.plain("bin", ((48, 56, 50), (44, 50, 60), (66, 64, 62))[number % 3], 0.15)
    lid = ((-0.34, -0.30), (0.33, 0.30))
    top = ((-0.34 * 0.9, -0.30 * 0.9), (0.33 * 0.9, 0.30 * 0.9))
    solids = [
        g.frustum(((-0.24, -0.22), (0.24, 0.22)), ((-0.30, -0.28), (0.30, 0.28)), (0.06, 0.98), shell),
        g.frustum(lid, top, (0.98, 1.06), shell),
    ]
    solids += [
        g.rod((-0.24, y, 0.10), (-0.24, y + 0.06, 0.10), (0.10, 0.10), materials.RUBBER, 12) for y in (-0.26, 0.20)
    ]
    return g.assemble(solids)


def hydrant() -> Mesh:
    """Return a fire hydrant of weathered bronze: a colour without a common name, so no instruction names it."""
    iron = materials.plain("hydrant", (132, 116, 92), 0.2)
    outline = [
        (0.0, 0.0),
        (0.17, 0.0),
        (0.17, 0.06),
        (0.11, 0.08),
        (0.11, 0.5),
        (0.14, 0.52),
        (0.14, 0.56),
        (0.11, 0.62),
        (0.05, 0.72),
        (0.03, 0.78),
        (0.0, 0.78),
    ]
    return g.assemble(
        [
            g.lathe(outline, iron, 14),
            g.rod((0, -0.19, 0.42), (0, 0.19, 0.42), (0.055, 0.055), iron),
            g.rod((0, 0, 0.40), (0.2, 0, 0.40), (0.07, 0.07), iron),
        ]
    )
