"""What stands along a street and in a garden: lamps, mailboxes, fences, bins, a hydrant, trees, bushes and hedges."""

from functools import lru_cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.lettering import plate
from episodes.maps.assets.materials import linear, surface
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Material, Mesh

LEAVES = {
    "oak": (120, 150, 84),
    "maple": (138, 168, 82),
    "birch": (160, 182, 104),
    "conifer": (72, 104, 74),
    "hedge": (98, 134, 70),
}


def _foliage(species: str) -> Material:
    return surface("foliage", linear(LEAVES[species]))


def _leaves(clump: MeshPart, count: int, size: float, rng: np.random.Generator, material: Material) -> MeshPart:
    """Return loose leaf sprays scattered over a clump, lit as the clump is where they grow."""
    at = rng.integers(0, len(clump.corners), count)
    middle, normal = clump.corners[at].mean(axis=1), clump.normals[at].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    spread = rng.normal(size=(count, 3, 3)) * size + middle[:, None, :] + normal[:, None, :] * size * 0.5
    sprays = np.concatenate([spread, spread[:, ::-1]])
    normals = np.repeat(np.concatenate([normal, normal])[:, None, :], 3, axis=1)
    return MeshPart(sprays, normals, g.slope_uv(sprays, 1.2), material)


def _clump(centre: Array, radii: Array, seed: int, material: Material, sprays: int, level: int = 2) -> list[MeshPart]:
    rng = np.random.default_rng(seed)
    ball = g.ball(centre, radii, material, level)
    rough = g.roughened(ball, 0.13 * float(np.mean(radii)), seed, float(np.mean(radii)) * 0.8)
    rough = MeshPart(rough.corners, rough.normals, g.slope_uv(ball.corners, 1.2), material)
    return [rough, _leaves(rough, sprays, 0.12 * min(1.0, float(np.mean(radii))), rng, material)]


@lru_cache(maxsize=64)
def tree(species: str = "oak", height: float = 8.0, seed: int = 1) -> Mesh:
    """Return a broad-leaved tree with a forked trunk and a crown of clumps."""
    rng, leaf, bark = np.random.default_rng(seed), _foliage(species), surface("bark")
    fork, reach = 0.36 * height, 0.26 * height
    thick = 0.022 * height + 0.04
    solids = [g.rod((0, 0, -0.2), (0, 0, fork), (thick * 1.25, thick * 0.85), bark, 8)]
    solids.append(g.rod((0, 0, -0.2), (0, 0, 0.35), (thick * 1.9, thick * 1.15), bark, 8))
    count = 5
    for k in range(count):
        turn = 2 * np.pi * (k + rng.uniform(-0.25, 0.25)) / count
        out = reach * rng.uniform(0.45, 0.75)
        centre = np.array([out * np.cos(turn), out * np.sin(turn), height * rng.uniform(0.50, 0.70)])
        solids.append(g.rod((0, 0, fork * 0.9), centre, (thick * 0.55, thick * 0.2), bark, 5))
        radius = reach * rng.uniform(0.52, 0.70)
        solids += _clump(centre, np.array([radius, radius, radius * 0.8]), seed * 17 + k, leaf, 14)
    solids += _clump(
        np.array([0, 0, height * 0.80]), np.array([reach * 0.72, reach * 0.72, height * 0.19]), seed * 17 + 9, leaf, 30
    )
    return g.assemble(solids)


@lru_cache(maxsize=64)
def conifer(height: float = 9.0, seed: int = 1) -> Mesh:
    """Return a fir: tiers of ragged skirts about a straight trunk."""
    rng, leaf = np.random.default_rng(seed), _foliage("conifer")
    solids = [g.rod((0, 0, -0.2), (0, 0, 0.9 * height), (0.022 * height, 0.05), surface("bark"), 8)]
    tiers, sides = 6, 10
    for k in range(tiers):
        low = height * (0.12 + 0.80 * k / tiers)
        high = low + height * 0.30 * (1.0 - 0.45 * k / tiers)
        radius = 0.23 * height * (1.0 - k / tiers) ** 0.85 + 0.12
        turn = 2 * np.pi * np.arange(sides + 1) / sides + k
        ragged = radius * (1.0 + 0.16 * np.where(np.arange(sides + 1) % 2, 1, -1) + 0.05 * rng.normal(size=sides + 1))
        ragged[-1] = ragged[0]
        hem = np.stack([ragged * np.cos(turn), ragged * np.sin(turn), low - 0.10 * ragged], axis=1)
        tip = np.broadcast_to((0.0, 0.0, min(high, height)), hem.shape)
        waist = 0.45 * hem + 0.55 * tip - (0, 0, 0.05 * height / tiers)
        under = np.broadcast_to((0.0, 0.0, low + 0.12), hem.shape)
        solids.append(g.grid(np.stack([under, hem, waist, tip], axis=1), leaf, 45.0, 1.2))
    return g.assemble(solids)


@lru_cache(maxsize=64)
def bush(radius: float = 0.6, seed: int = 1) -> Mesh:
    """Return a garden shrub."""
    leaf = _foliage("hedge")
    return g.assemble(
        _clump(np.array([0, 0, radius * 0.7]), np.array([radius, radius, radius * 0.85]), seed, leaf, 16, 1)
    )


@lru_cache(maxsize=64)
def hedge(length: float = 6.0, height: float = 1.2, thick: float = 0.8, seed: int = 1) -> Mesh:
    """Return a clipped hedge along the forward axis."""
    rng, leaf = np.random.default_rng(seed), _foliage("hedge")
    x = np.linspace(-length / 2, length / 2, max(3, int(length / 0.55)))
    half = thick / 2
    ring = [
        (-half, 0.0),
        (half, 0.0),
        (half, 0.35 * height),
        (half, 0.7 * height),
        (0.88 * half, height),
        (0.0, 1.02 * height),
    ]
    ring += [(-0.88 * half, height), (-half, 0.7 * height), (-half, 0.35 * height), (-half, 0.0)]
    lattice = np.array([[(a, y, z) for y, z in ring] for a in x[::-1]])
    lattice[:, 2:-1] += rng.normal(size=(len(x), len(ring) - 3, 3)) * 0.045
    skin = g.grid(lattice, leaf, 60.0, 1.2)
    ends = [
        g.soup(lattice[0][np.array([(0, k, k + 1) for k in range(1, len(ring) - 1)])], leaf, 0.0, 1.2),
        g.soup(lattice[-1][np.array([(0, k + 1, k) for k in range(1, len(ring) - 1)])], leaf, 0.0, 1.2),
    ]
    return g.assemble([skin, *ends, _leaves(skin, int(length * 9), 0.06, rng, leaf)])


@lru_cache(maxsize=16)
def wood(length: float = 60.0, height: float = 9.0, seed: int = 1) -> Mesh:
    """Return the edge of a wood along the forward axis, to be seen from far away."""
    rng, leaf = np.random.default_rng(seed), _foliage("oak")
    count = int(length / 3.0)
    x = np.linspace(-length / 2, length / 2, count)
    crown = height * (0.78 + 0.22 * np.abs(np.sin(np.arange(count) * 0.9 + rng.uniform(0, 0.8, count))))
    rings = []
    for half, share in (
        (4.2, 0.0),
        (4.6, 0.35),
        (3.6, 0.75),
        (1.4, 1.0),
        (-1.4, 1.0),
        (-3.6, 0.75),
        (-4.6, 0.35),
        (-4.2, 0.0),
    ):
        rings.append(np.stack([x, half + 0.5 * rng.normal(size=count), share * crown], axis=1))
    return g.assemble([g.grid(np.stack(rings, axis=0), leaf, 60.0, 5.0)])


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


@lru_cache(maxsize=1)
def mailbox() -> Mesh:
    """Return a kerbside mailbox that opens forward."""
    tin, wood = materials.plain("mailbox", (52, 58, 66), 0.4), surface("boards")
    ring = [(0.11 * np.cos(a), 1.12 + 0.11 * np.sin(a)) for a in np.linspace(0, np.pi, 9)] + [(-0.11, 1.0), (0.11, 1.0)]
    body = g.placed(g.profile(ring, -0.24, 0.24, tin), yaw=np.pi / 2)
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
def board_fence(length: float = 10.0, height: float = 1.8) -> Mesh:
    """Return a close-boarded fence along the forward axis."""
    wood = surface("boards")
    half = length / 2
    solids = [g.box((-half, -0.02, 0.05), (half, 0.02, height), wood, 1.2)]
    solids += [g.box((-half, 0.02, z), (half, 0.07, z + 0.09), wood, 1.2) for z in (0.35, height - 0.4)]
    solids += [
        g.box((x - 0.05, -0.03, -0.2), (x + 0.05, 0.09, height + 0.06), wood, 1.2)
        for x in np.linspace(-half + 0.05, half - 0.05, max(2, round(length / 3.3) + 1))
    ]
    return g.assemble([g.without(p, (0.0, 0.0, -1.0)) for p in solids])


def picket_fence(length: float = 6.0, height: float = 0.95) -> Mesh:
    """Return a white picket fence along the forward axis."""
    wood, half = materials.WHITE_WOOD, length / 2
    solids = [g.box((-half, -0.035, z), (half, -0.01, z + 0.08), wood) for z in (0.25, height - 0.28)]
    solids += [
        g.box((x - 0.05, -0.09, -0.2), (x + 0.05, 0.0, height + 0.05), wood)
        for x in np.linspace(-half + 0.05, half - 0.05, max(2, round(length / 2.0) + 1))
    ]
    ring = [(-0.045, 0.06), (0.045, 0.06), (0.045, height - 0.07), (0.0, height), (-0.045, height - 0.07)]
    picket = g.profile(ring, -0.01, 0.012, wood)
    solids += [g.placed(picket, (float(x), 0.0, 0.0)) for x in np.arange(-half + 0.08, half - 0.04, 0.19)]
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
        # one face to either side of the street's line
        blade.append(
            g.quad([(half, 0.014, z), (-half, 0.014, z), (-half, 0.014, z + high), (half, 0.014, z + high)], look)
        )
        blade.append(
            g.quad([(-half, -0.014, z), (half, -0.014, z), (half, -0.014, z + high), (-half, -0.014, z + high)], look)
        )
        solids += [g.placed(p, yaw=turn) for p in blade]
    return g.assemble(solids)


def barrier(length: float = 7.4) -> Mesh:
    """Return a timber guard rail along the forward axis, such as ends a road that goes no further."""
    wood, half = surface("boards"), length / 2
    solids = [g.box((-half, -0.05, z), (half, 0.03, z + 0.22), wood, 1.2) for z in (0.30, 0.66)]
    solids += [
        g.box((x - 0.09, 0.03, -0.3), (x + 0.09, 0.19, 0.98), wood, 1.2)
        for x in np.linspace(-half + 0.3, half - 0.3, max(2, round(length / 1.8) + 1))
    ]
    return g.assemble(solids)


@lru_cache(maxsize=1)
def bin() -> Mesh:
    """Return a wheeled refuse bin."""
    shell = materials.plain("bin", (48, 56, 50), 0.15)
    low = [(-0.24, -0.22, 0.06), (0.24, -0.22, 0.06), (0.24, 0.22, 0.06), (-0.24, 0.22, 0.06)]
    high = [(-0.30, -0.28, 0.98), (0.30, -0.28, 0.98), (0.30, 0.28, 0.98), (-0.30, 0.28, 0.98)]
    lid = [(-0.34, -0.30, 0.98), (0.33, -0.30, 0.98), (0.33, 0.30, 0.98), (-0.34, 0.30, 0.98)]
    solids = [g.hull(low, high, shell), g.hull(lid, [(x * 0.9, y * 0.9, 1.06) for x, y, _ in lid], shell)]
    solids += [
        g.rod((-0.24, y, 0.10), (-0.24, y + 0.06, 0.10), (0.10, 0.10), materials.RUBBER, 12) for y in (-0.26, 0.20)
    ]
    return g.assemble(solids)


def hydrant() -> Mesh:
    """Return a fire hydrant, in weathered bronze so that no paint name fits it."""
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
