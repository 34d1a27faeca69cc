"""Builds meshes of drones: a fleet's drones as they see each other, and a quadrotor on a stand, which can be a target.

A drone of a fleet has its rotors, arms, feet and mast where the airframe's TOML has them. Its origin is the body
origin, between the rotors and not on the ground. The quadrotor on the stand is about five times as wide.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh
from foundation.airframe import Airframe
from foundation.camera import CameraModel
from foundation.frames import Vec3

# Drones are dark, to be visible against sky and walls. The band and the front blades have a colour that no target has,
# to be visible against hedges and in shadow, and to show the front.
SHELL = materials.plain("drone-shell", (62, 66, 72), 0.35)
BAND = materials.plain("drone-band", (188, 222, 40), 0.1)
CARBON = materials.plain("drone-carbon", (30, 31, 33), 0.25)
MOTOR = materials.plain("drone-motor", (120, 124, 130), 0.6)
FRONT_BLADE = materials.plain("drone-front-blade", (188, 222, 40), 0.1)
REAR_BLADE = materials.plain("drone-rear-blade", (58, 60, 64), 0.1)
# a blade from hub to tip: points (along, across), as fractions of the rotor's radius
BLADE = ((0.06, -0.05), (0.25, -0.12), (0.65, -0.11), (1.0, -0.04), (1.0, 0.04), (0.65, 0.055), (0.25, 0.065))
QUADROTOR_SIZE = 1.16  # scale of `quadrotor`: 2.8 m across the propellers, like a crop-spraying drone
STOPPED_RAD = 0.6, 1.1  # propellers stand still, as in a short exposure: angle of the first, step to the next


@dataclass(frozen=True, slots=True)
class Outline:
    """The positions of the parts of a multirotor: m from the body origin, FRD."""

    hubs: tuple[Vec3, ...]  # middles of the rotor discs
    radius_m: float  # of each disc
    touching: tuple[Vec3, ...]  # contact points with the ground: feet, mast, rims of the discs

    @property
    def arm_m(self) -> float:
        """Horizontal distance from the body origin to the nearest hub."""
        return min(float(np.hypot(x, y)) for x, y, _ in self.hubs)


# the default airframe, vehicles/airframes/x500.toml, for modules that must not import `vehicles`
X500 = Outline(
    hubs=((0.174, 0.174, -0.06), (-0.174, -0.174, -0.06), (0.174, -0.174, -0.06), (-0.174, 0.174, -0.06)),
    radius_m=0.127,
    touching=(
        *((x, y, 0.21) for x in (0.13, -0.13) for y in (0.15, -0.15)),
        *((x, y, -0.06) for x in (0.26, -0.26) for y in (0.26, -0.26)),
        (0.0, 0.0, -0.12),
    ),
)


def outline(airframe: Airframe) -> Outline:
    """Return the outline of an airframe."""
    hubs = tuple(rotor.position_frd for rotor in airframe.rotors)
    return Outline(hubs, airframe.curve.radius_m, airframe.contact_points_frd)


@cache
def multirotor(shape: Outline) -> Mesh:
    """Return the mesh of a drone. Its origin is the body origin. Its camera is at the offset of `CameraModel()`."""
    thin = max(0.06 * shape.radius_m, 0.001)
    solids = [*_hull(shape), *_camera(shape, thin)]
    for k, (x, y, z) in enumerate(shape.hubs):
        solids += _rotor((x, -y, -z), shape.radius_m, k, REAR_BLADE if x < 0.0 else FRONT_BLADE)
        solids.append(g.rod((0.0, 0.0, 0.0), (x, -y, -z - 0.22 * shape.radius_m), (1.3 * thin, thin), CARBON, 8))
    solids += _legs(shape, thin)
    return g.assemble(solids)


def _hull(shape: Outline) -> list[MeshPart]:
    """Return shell, battery, band and mast."""
    half = 0.36 * shape.arm_m
    outer = [(1.25, 0.5), (0.7, 0.85), (-0.9, 0.8), (-1.15, 0.0), (-0.9, -0.8), (0.7, -0.85), (1.25, -0.5)]
    ring = half * np.array(outer)

    def level(scale: float, height: float) -> np.ndarray:
        return np.column_stack((scale * ring, np.full(len(ring), height * half)))

    solids = [
        g.hull(level(0.85, -0.3), level(1.0, -0.05), CARBON),
        g.hull(level(1.0, -0.05), level(0.95, 0.2), BAND),
        g.hull(level(0.95, 0.2), level(0.45, 0.5), SHELL),
        g.box((-0.95 * half, -0.35 * half, -0.75 * half), (0.95 * half, 0.35 * half, -0.3 * half), CARBON),
    ]
    top = -min(z for _, _, z in shape.touching)
    if top > 0.6 * half:
        solids.append(
            g.rod((0.0, 0.0, 0.4 * half), (0.0, 0.0, top - 0.1 * half), (0.06 * half, 0.05 * half), CARBON, 6)
        )
        solids.append(g.rod((0.0, 0.0, top - 0.15 * half), (0.0, 0.0, top), (0.32 * half, 0.28 * half), SHELL, 10))
    return solids


def _rotor(hub: Vec3, radius_m: float, number: int, look: Material) -> list[MeshPart]:
    """Return a motor and its two blades at rest."""
    x, y, z = hub
    first, step = STOPPED_RAD
    solids = [
        g.rod((x, y, z - 0.28 * radius_m), (x, y, z - 0.03 * radius_m), (0.12 * radius_m, 0.11 * radius_m), MOTOR, 10),
        g.rod((x, y, z - 0.03 * radius_m), (x, y, z + 0.06 * radius_m), (0.04 * radius_m, 0.03 * radius_m), CARBON, 6),
    ]
    blade = g.prism([(radius_m * a, radius_m * b) for a, b in BLADE], -0.012 * radius_m, 0.012 * radius_m, look)
    return solids + [g.transformed(blade, hub, first + step * number + half) for half in (0.0, np.pi)]


def _legs(shape: Outline, thin: float) -> list[MeshPart]:
    """Return a leg to each foot, and a skid along the feet of either side."""
    feet = [(x, -y, -z) for x, y, z in shape.touching if z > 0.0]
    solids = [g.rod((0.4 * x, 0.4 * y, 0.0), (x, y, z + thin), (thin, thin), CARBON, 6) for x, y, z in feet]
    for side in (-1.0, 1.0):
        along = [foot for foot in feet if foot[1] * side > 0.0]
        if len(along) == 2 and -along[0][2] > shape.radius_m:  # only tall legs have skids
            (x0, y0, z0), (x1, y1, z1) = along
            solids.append(g.rod((x0, y0, z0 + thin), (x1, y1, z1 + thin), (1.1 * thin, 1.1 * thin), CARBON, 6))
    return solids


def _camera(shape: Outline, thin: float) -> list[MeshPart]:
    """Return the camera on its boom, and bumper bars to the camera from the two rotors nearest to it."""
    x, y, z = CameraModel().offset_frd
    size = 0.2 * min(shape.radius_m, 0.15)
    place, cube = np.array((x, -y, -z)), np.array((size, size, size))
    hubs = sorted((np.array((a, -b, -c)) for a, b, c in shape.hubs), key=lambda hub: float(np.linalg.norm(hub - place)))
    bumpers = [np.linspace(hub, place - cube * (1.5, 0.0, 0.0), 4) for hub in hubs[:2]]
    return [
        *(g.rod(a, b, (0.6 * thin, 0.6 * thin), CARBON, 6) for line in bumpers for a, b in pairwise(line)),
        g.rod((0.0, 0.0, -0.1 * shape.arm_m), place - cube * (1.5, 0.0, 0.0), (thin, 0.8 * thin), CARBON, 6),
        g.box(place - cube * (2.0, 1.0, 1.0), place + cube * (-0.4, 1.0, 1.0), CARBON),
        g.rod(place - cube * (0.4, 0.0, 0.0), place, (0.7 * size, 0.75 * size), materials.GLASS, 10),
    ]


def _display_rotor(x: float, y: float, z: float, turn: float) -> list[MeshPart]:
    """Return a motor with its propeller at rest."""
    solids = [
        g.rod((x, y, z - 0.10), (x, y, z + 0.06), (0.085, 0.075), materials.TRIM, 12),
        g.rod((x, y, z + 0.06), (x, y, z + 0.12), (0.035, 0.025), materials.CHROME, 8),
    ]
    blade = [(0.03, -0.02), (0.12, -0.055), (0.30, -0.05), (0.46, -0.02), (0.46, 0.02), (0.30, 0.025), (0.12, 0.03)]
    flat = g.prism([*blade, (0.03, 0.02)], 0.085, 0.100, materials.TRIM)
    tip = g.prism([(0.40, -0.035), (0.465, -0.02), (0.465, 0.021), (0.40, 0.022)], 0.084, 0.101, materials.WHITE_WOOD)
    for k in (0.0, np.pi):
        solids += [g.transformed(p, (x, y, z), turn + k) for p in (flat, tip)]
    return solids


@cache
def quadrotor(paint: str) -> Mesh:
    """Return a crop-spraying quadrotor on a stand, both in `paint`. Raises UsageError for an unknown paint."""
    shell, z = materials.paint(paint), 1.42
    ring = [(0.46, 0.0), (0.36, 0.20), (0.0, 0.27), (-0.36, 0.20), (-0.46, 0.0), (-0.36, -0.20), (0.0, -0.27)]
    ring.append((0.36, -0.20))

    def level(scale: float, height: float) -> np.ndarray:
        return np.array([(a * scale, b * scale, height) for a, b in ring])

    solids = [
        g.hull(level(0.70, z - 0.13), level(1.0, z - 0.02), shell),
        g.hull(level(1.0, z - 0.02), level(0.86, z + 0.09), shell),
        g.hull(level(0.86, z + 0.09), level(0.45, z + 0.17), shell),
        g.rod((-0.18, 0, z + 0.15), (-0.18, 0, z + 0.30), (0.02, 0.02), materials.TRIM, 6),
        g.rod((-0.18, 0, z + 0.29), (-0.18, 0, z + 0.33), (0.09, 0.09), materials.WHITE_WOOD, 12),
        # the camera below the nose
        g.box((0.30, -0.07, z - 0.20), (0.40, 0.07, z - 0.10), materials.TRIM),
        g.ball((0.39, 0.0, z - 0.20), (0.09, 0.09, 0.09), materials.TRIM, 2),
        g.rod((0.44, 0, z - 0.20), (0.49, 0, z - 0.20), (0.05, 0.055), materials.GLASS, 12),
    ]
    reach = 0.76
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        x, y = sx * reach, sy * reach
        solids.append(g.rod((sx * 0.24, sy * 0.14, z), (x, y, z + 0.02), (0.055, 0.042), shell, 10))
        solids += _display_rotor(x, y, z + 0.10, 0.6 + 1.1 * k)
        lamp = materials.TAIL_LAMP if sx < 0 else materials.HEADLAMP
        solids.append(g.ball((x + sx * 0.05, y + sy * 0.05, z - 0.02), (0.035, 0.035, 0.025), lamp, 1))
    for s in (-1, 1):  # skids
        for x in (-0.20, 0.20):
            solids.append(
                g.rod((x, s * 0.16, z - 0.10), (x * 1.3, s * 0.36, z - 0.40), (0.02, 0.018), materials.TRIM, 6)
            )
        solids.append(g.rod((-0.46, s * 0.36, z - 0.41), (0.46, s * 0.36, z - 0.41), (0.022, 0.022), materials.TRIM, 8))
    top = z - 0.43
    foot = materials.plain("stand", (74, 78, 84), 0.2)
    solids += [
        g.box((-0.66, -0.66, top - 0.07), (0.66, 0.66, top), foot),
        g.frustum(((-0.62, -0.62), (0.62, 0.62)), ((-0.52, -0.52), (0.52, 0.52)), (0.10, top - 0.07), shell),
        g.box((-0.72, -0.72, 0.0), (0.72, 0.72, 0.10), foot),
    ]
    return g.assemble([replace(p, corners=p.corners * QUADROTOR_SIZE) for p in solids])
