"""Builds a map of bare solids: boxes, cylinders, cones, arches and ramps in muted colours, on a floor with a grid.

No solid is a landmark, so instructions can refer only to objects that an episode adds. The solids form two bands that
cross in the middle, and a ring around them. The four fields between the bands and the ring are free.
"""

import math
from collections import Counter
from collections.abc import Iterator
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets.materials import plain
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Instance, Lane, Material, Mesh, Places, Scene, Spot, sun_at
from foundation.frames import Vec3
from foundation.terrain import HeightField

ORIGIN = (46.518500, 6.566900, 394.0)  # geodetic latitude, longitude (degrees) and height (m) of the middle
JULY, HOUR = 196, 14.2  # day of the year and true solar hour
REACH, CELL = 80.0, 0.5  # m, half extent and cell size of the height field, which is level
FAR, HORIZON_M = 400.0, 9000.0  # m from the middle, where the floor's 20 m squares end, and where the floor ends
FIELD = 58.0  # m, half extent of the area inside the ring
SPOT_GRID_M, SPOT_CLEAR_M = 2.0, 2.0  # spacing of candidate spots (places for objects), least distance from a solid
LANE_CLEAR_M = 1.6  # least distance of a lane from any solid

TINTS: tuple[tuple[int, int, int], ...] = (  # sRGB; greys with a hint of a hue, without a common name
    (168, 160, 148),
    (128, 138, 148),
    (150, 134, 122),
    (118, 128, 118),
    (196, 190, 176),
    (92, 97, 104),
)

# solids of the bands between the fields: shape, north (m), east (m), compass bearing that the solid faces (degrees)
BANDS: tuple[tuple[str, float, float, float], ...] = (
    ("box", 6.0, 7.0, 0.0),
    ("cylinder", -5.5, 6.0, 0.0),
    ("cone", -6.0, -6.5, 0.0),
    ("ramp", 6.5, -7.0, 90.0),
    ("arch", 20.0, 0.0, 0.0),
    ("box", 31.0, 3.5, 20.0),
    ("cylinder", 33.0, -4.0, 0.0),
    ("pyramid", 44.0, 0.5, 10.0),
    ("box", 53.0, -2.5, 0.0),
    ("arch", -20.0, 0.0, 180.0),
    ("box", -31.5, -3.0, 35.0),
    ("cone", -33.0, 4.0, 0.0),
    ("ramp", -45.0, 0.0, 0.0),
    ("cylinder", -54.0, 1.5, 0.0),
    ("arch", 0.0, 21.0, 90.0),
    ("cylinder", 3.5, 31.0, 0.0),
    ("box", -3.5, 33.5, 15.0),
    ("cone", 0.0, 44.0, 0.0),
    ("box", 1.5, 54.0, 0.0),
    ("arch", 0.0, -21.0, 270.0),
    ("pyramid", -3.6, -31.0, 30.0),
    ("box", 4.4, -33.5, 0.0),
    ("ramp", 0.0, -45.0, 180.0),
    ("box", -1.5, -54.5, 25.0),
    # one low solid near the outer corner of each field
    ("cone", 51.0, 51.0, 0.0),
    ("cylinder", 51.0, -51.0, 0.0),
    ("box", -51.0, 51.0, 40.0),
    ("pyramid", -51.0, -51.0, 0.0),
)
RING_M, RING_STEP_M = 70.0, 14.0  # distance of the ring's sides from the middle, and spacing of its solids


@cache
def _floor_look() -> Material:
    """Return the material of the floor: a line every metre and a stronger line every 5 m. The picture covers 5 m."""
    row, column = np.mgrid[0:512, 0:512]
    value = np.ones((512, 512))
    value[(row % 102 < 2) | (column % 102 < 2)] = 0.94
    value[(row < 5) | (column < 5)] = 0.82
    picture = np.asarray(value[..., None] * np.array((146, 147, 145)), np.uint8)
    return Material("floor", (1.0, 1.0, 1.0), picture, drift=0.06)


def _floor() -> Mesh:
    """Return the floor in squares of 20 m, and in larger pieces out to the horizon."""
    far = np.array((500.0, 750.0, 1200.0, 2000.0, 3500.0, HORIZON_M))
    line = np.concatenate([-far[::-1], np.arange(-FAR, FAR + 1.0, 20.0), far])
    n, w = np.broadcast_arrays(line[:, None], line[None, :])
    # the front of the grid faces up: ∂/∂rows × ∂/∂columns = north × west = up
    return g.assemble([g.grid(np.stack([n, w, 0.0 * n], axis=2), _floor_look(), tile_m=5.0)])


def _arch(wide: float, high: float, deep: float, thick: float, look: Material) -> list[MeshPart]:
    """Return an arch across the forward axis, with an opening `wide` and `high` (m)."""
    spring, radius = high - wide / 2, wide / 2
    turn = np.linspace(0.0, np.pi, 17)
    rows = []
    for a in turn:
        c, s = math.cos(a), math.sin(a)
        inner, outer = (radius * c, spring + radius * s), ((radius + thick) * c, spring + (radius + thick) * s)
        x = deep / 2
        rows.append([(-x, *inner), (-x, *outer), (x, *outer), (x, *inner), (-x, *inner)])
    legs = [sorted((side * radius, side * (radius + thick))) for side in (-1, 1)]
    return [
        g.grid(np.array(rows), look, 20.0),
        *[g.without(g.box((-deep / 2, a, 0.0), (deep / 2, b, spring), look), (0.0, 0.0, -1.0)) for a, b in legs],
    ]


def _solid(shape: str, rng: np.random.Generator, tall: float, wide: float = 1.0) -> Mesh:
    """Return a solid with sizes drawn from `rng`; `tall` and `wide` scale them."""
    look = plain(f"block-{(k := int(rng.integers(len(TINTS))))}", TINTS[k], 0.03)
    a, b, h = rng.uniform(1.9, 2.7) * wide, rng.uniform(1.8, 2.6) * wide, rng.uniform(2.2, 4.6) * tall
    if shape == "box":
        solids = [g.box((-a, -b, 0.0), (a, b, h), look)]
    elif shape == "cylinder":
        solids = [g.rod((0, 0, 0), (0, 0, h * 1.2), (0.7 * a, 0.7 * a), look, 32)]
    elif shape == "cone":
        solids = [g.lathe([(0.0, 0.0), (0.85 * a, 0.0), (0.0, h * 1.3)], look, 32)]
    elif shape == "pyramid":
        tip = 0.02 * a
        solids = [g.frustum(((-a, -a), (a, a)), ((-tip, -tip), (tip, tip)), (0.0, h * 1.2), look)]
    elif shape == "ramp":
        solids = [g.profile([(-1.6 * a, 0.0), (1.6 * a, 0.0), (1.6 * a, 0.7 * h)], -b, b, look)]
    else:
        solids = _arch(1.3 * a, 3.2 + 0.4 * h, 1.6, 0.9, look)
    return g.assemble(solids)


def _solids(seed: int) -> Iterator[tuple[str, Mesh, float, float, float]]:
    """Yield (kind, mesh, north, east, yaw) of every solid."""
    rng = np.random.default_rng((seed, 23))
    for shape, north, east, facing in BANDS:
        yield shape, _solid(shape, rng, 0.6 if abs(north) == abs(east) else 1.0), north, east, math.radians(facing)
    along = np.arange(-RING_M, RING_M + 1.0, RING_STEP_M)
    shapes = ("box", "box", "cylinder", "box", "pyramid", "box", "cone")
    for side in range(4):
        for k, place in enumerate(along[:-1]):
            shape = shapes[int(rng.integers(len(shapes)))]
            n, e = ((RING_M, place), (-place, RING_M), (-RING_M, -place), (place, -RING_M))[side]
            mesh = _solid(shape, rng, float(rng.uniform(1.5, 4.0)), 1.6)
            yield shape, mesh, float(n), float(e), math.radians(float(rng.uniform(-20.0, 20.0)) + 90.0 * (k % 2))


def build(seed: int = 1) -> Scene:
    """Return the map. `seed` varies the solids' sizes and tints and the shapes of the ring; the fields stay free."""
    count = Counter[str]()
    instances = [Instance(1, "floor", "ground", _floor(), (0.0, 0.0, 0.0))]
    for kind, mesh, north, east, yaw in _solids(seed):
        count[kind] += 1
        place = (north, east, 0.0)
        instances.append(Instance(len(instances) + 1, f"{kind}-{count[kind]}", kind, mesh, place, yaw))
    side = round(2 * REACH / CELL) + 1
    return Scene(
        "blocks",
        tuple(instances),
        HeightField(-REACH, -REACH, CELL, np.zeros((side, side))),
        sun_at(ORIGIN[0], JULY, HOUR),
        *ORIGIN,
        notes=("Four free fields lie north-east, north-west, south-east and south-west of the middle.",),
    )


def places(seed: int = 1) -> Places:
    """Return the free spots of the four fields and straight lanes through them. There are no landmarks."""
    blocks: list[g.PlanBox] = [
        (north, east, yaw, mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0))
        for _, mesh, north, east, yaw in _solids(seed)
    ]

    def gap(n: float, e: float) -> float:
        return min(g.gap_m(n, e, block) for block in blocks)

    line = [float(v) for v in np.arange(-FIELD, FIELD + 0.1, SPOT_GRID_M)]
    spots = [Spot((n, e, 0.0), 0.0, "floor") for n in line for e in line if gap(n, e) >= SPOT_CLEAR_M]
    lanes = []
    for side in (-1, 1):
        for out in (14.0, 40.0):
            for name, turned in (("northward", False), ("eastward", True)):
                way = [(float(k), side * out) for k in np.arange(-46.0, 46.1, 1.0)]
                points: tuple[Vec3, ...] = tuple((b, a, 0.0) if turned else (a, b, 0.0) for a, b in way)
                if min(gap(n, e) for n, e, _ in points) >= LANE_CLEAR_M:
                    lanes.append(Lane(f"{name} at {side * out:+.0f} m", points, 2 * LANE_CLEAR_M))
    return Places(tuple(spots), tuple(lanes))
