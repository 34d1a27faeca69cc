"""The plan of the residential neighbourhood: its streets, plots and drives, and the heights of the ground.

Two streets run north. Two others run east and join them, so that a vehicle can drive round the block. The streets that
run east end in the fields. Heights follow the paper's residential map (appendix "Maps and Episodes"): NED z is +0.05 m
on roads and −0.45 m on plots and at their drives (plus `swell`). So plots are half a metre above the road.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from episodes.maps.assets import house_plans
from episodes.maps.scene import Array
from foundation.terrain import HeightField

REACH = (-112.0, 112.0, -70.0, 134.0)  # m, north and east extents of the height field; outside, the edge height applies
CELL = 0.25  # m, of the height field
CORNER = 9.5  # m from a centre line to the plots; kerbs at junctions are arcs around plot corners
FRONT = 14.0  # m, house fronts from the centre line
DEPTH = 32.0  # m, back fences from the centre line
DRIVE_HALF = 2.3  # m, half the width of a drive
DRIVE_END = 13.6  # m, end of a drive from the centre line
NEAR_M = 21.0  # m along the street; houses closer than this do not look alike
FLANK = 0.25  # m along the street, length of the slope on each side of a dropped kerb

# distance from the centre line (m) → NED z (m): road, kerb, verge, pavement, bank, plot
PROFILE = ((0.0, 0.05), (4.0, 0.05), (4.25, -0.07), (5.5, -0.09), (7.0, -0.12), (9.5, -0.45), (50.0, -0.45))
# the profile at a drive, where the kerb is dropped
PROFILE_DRIVE = ((0.0, 0.05), (4.0, 0.05), (5.5, -0.09), (7.0, -0.12), (9.5, -0.45), (50.0, -0.45))
RINGS = (4.0, 4.25, 5.5, 7.0, 8.25, CORNER)  # m from the centre line, where the use or the slope of the ground changes


@dataclass(frozen=True, slots=True)
class Street:
    """A straight road with its verges, pavements and banks, 19 m wide."""

    name: str
    north: bool  # runs north; False: runs east
    middle: float  # m, east coordinate of its centre line if it runs north, else the north coordinate
    ends: tuple[float, float]  # m, north coordinates if it runs north, else east coordinates
    dead: bool = False  # both ends are kerbs; False: both ends join other streets

    def at(self, along: float, out: float) -> tuple[float, float]:
        """Return (north, east) of the point at `along` that is `out` metres east or north of the centre line."""
        return (along, self.middle + out) if self.north else (self.middle + out, along)


MAIN = Street("Main Street", True, 0.0, (-72.0, 72.0))
SECOND = Street("Orchard Street", True, 64.0, (-72.0, 72.0))
UPPER = Street("Hill Road", False, 72.0, (-52.0, 116.0), dead=True)
LOWER = Street("Mill Road", False, -72.0, (-52.0, 116.0), dead=True)
STREETS = (MAIN, SECOND, UPPER, LOWER)


@dataclass(frozen=True, slots=True)
class Plot:
    """A house with its garden and drive. `side` is +1 east or north of the street's centre line, else -1."""

    number: int
    street: Street
    along: float  # m, middle of the plot
    side: int
    plan: house_plans.HousePlan
    house: float  # m along the street, middle of the main block; block and garage together are centred on the plot
    drive: float  # m along the street, middle of the drive

    def at(self, along: float, out: float) -> tuple[float, float]:
        """Return (north, east) of the point at `along` that is `out` metres from the centre line towards this plot."""
        return self.street.at(along, self.side * out)

    def from_street(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Return (along, out) of points, m: the inverse of `at`."""
        along, out = (north, east) if self.street.north else (east, north)
        return along, self.side * (out - self.street.middle)

    @property
    def yaw(self) -> float:
        """Return the yaw (rad) of the house, whose front faces the street."""
        if self.street.north:
            return -self.side * math.pi / 2
        return math.pi if self.side > 0 else 0.0

    @property
    def left(self) -> int:
        """Return the direction along the street (+1 or -1) to the left of a person who leaves the house."""
        return -self.side if self.street.north else self.side


def _sites() -> list[tuple[Street, float, int]]:
    """Return (street, along, side) of every plot, first the plots of the main street."""
    rows = (-50.0, -30.0, -10.0, 10.0, 30.0, 50.0)
    sites = [(street, along, side) for street in (MAIN, SECOND) for along in rows for side in (-1, 1)]
    for street, outer in ((UPPER, 1), (LOWER, -1)):
        sites += [(street, along, outer) for along in np.arange(-40.0, 101.0, 20.0).tolist()]
        sites += [(street, along, -outer) for along in (-42.0, 106.0)]
    return sites


def plots(seed: int) -> tuple[Plot, ...]:
    """Return the plots. `seed` changes houses and drives, but not the plots' places."""
    homes: list[Plot] = []
    for number, (street, along, side) in enumerate(_sites()):
        garage = 1 if (number // 2 + (side > 0) + seed) % 2 else -1
        near = [home.plan for home in homes if home.street is street and abs(home.along - along) < NEAR_M]
        drawn = house_plans.differ_from_neighbours(house_plans.plan_of(seed * 1000 + number), near)
        plan = replace(drawn, garage=garage, garage_width=5.4)
        blank = Plot(number, street, along, side, plan, 0.0, 0.0)
        house = along - blank.left * garage * plan.garage_width / 2
        drive = house + blank.left * garage * (plan.width + plan.garage_width) / 2
        homes.append(replace(blank, house=house, drive=drive))
    return tuple(homes)


def _away(street: Street, north: Array, east: Array) -> Array:
    """Return the distance (m) of points from a street's centre line.

    Beyond the ends of a street that joins others, the distance is `inf`. Beyond a dead end, it grows from RINGS[0], the
    distance of the kerb. So a kerb closes the street.
    """
    along, out = (north, east) if street.north else (east, north)
    past = np.maximum(street.ends[0] - along, along - street.ends[1])
    side = np.abs(out - street.middle)
    if street.dead:
        return np.asarray(np.maximum(side, past + RINGS[0]))
    return np.asarray(np.where(past > 0.0, np.inf, side))


def away(north: Array, east: Array) -> Array:
    """Return the distance (m) of points from the nearest centre line, changed at junctions so that kerbs are round.

    Where both streets of a junction are nearer than CORNER, the result is CORNER minus the distance from the corner of
    the plot. So lines of equal height are arcs around the plot's corner.
    """
    shape = np.broadcast(north, east).shape
    runs = [
        np.minimum.reduce([np.broadcast_to(_away(s, north, east), shape) for s in STREETS if s.north is way])
        for way in (True, False)
    ]
    inset = [np.maximum(CORNER - run, 0.0) for run in runs]
    near = CORNER - np.hypot(*inset)
    return np.asarray(np.where(near < CORNER, np.maximum(near, 0.0), np.minimum(*runs)))


def swell(north: Array, east: Array) -> Array:
    """Return the NED z (m) of the land, which rises gently towards both ends of the main street and to the east."""
    ends = 0.2 * (np.cos(np.pi * np.clip(north, -70.0, 70.0) / 70.0) - 1.0)
    t = np.clip((east - 23.0) / 18.0, 0.0, 1.0)
    return np.asarray(ends - 0.6 * t * t * (3.0 - 2.0 * t))


def dropped(plot: Plot, north: Array, east: Array) -> Array:
    """Return the weight (0 … 1) of PROFILE_DRIVE at points: 1 on the dropped kerb of a plot's drive."""
    along, out = plot.from_street(north, east)
    flank = np.clip((DRIVE_HALF + FLANK - np.abs(along - plot.drive)) / FLANK, 0.0, 1.0)
    return np.asarray(flank * ((out > 0.0) & (out < CORNER)))


def height(north: Array, east: Array, homes: tuple[Plot, ...]) -> Array:
    """Return the NED z (m) of the ground at points; `north` and `east` are broadcast."""
    d = away(north, east)
    z = np.interp(d, *np.array(PROFILE).T)
    ramp = np.interp(d, *np.array(PROFILE_DRIVE).T)
    share = np.zeros(d.shape)
    for plot in homes:
        share = np.maximum(share, dropped(plot, north, east))
    return np.asarray(z * (1.0 - share) + ramp * share + swell(north, east))


def terrain(homes: tuple[Plot, ...]) -> HeightField:
    """Return the height field. It is computed without drives, and then again in a small window at each drive."""
    n0, n1, e0, e1 = REACH
    north, east = np.arange(n0, n1 + CELL / 2, CELL)[:, None], np.arange(e0, e1 + CELL / 2, CELL)[None, :]
    down = height(north, east, ())
    for plot in homes:
        near, far = plot.at(plot.drive - 3.0, 0.0), plot.at(plot.drive + 3.0, CORNER)
        rows, columns = (
            slice(int((min(a, b) - low) / CELL), int((max(a, b) - low) / CELL) + 2)
            for a, b, low in zip(near, far, (n0, e0), strict=True)
        )
        down[rows, columns] = height(north[rows], east[:, columns], (plot,))
    return HeightField(n0, e0, CELL, down)
