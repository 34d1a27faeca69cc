"""People, and what they ride: a bicycle, a touring motorcycle. The paint is the colour of their jacket."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.vehicles import about_y, plates
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Material, Mesh
from foundation.frames import Vec3

SKIN = materials.plain("skin", (198, 152, 122), 0.1)
HAIR = materials.plain("hair", (52, 40, 32), 0.1)
TROUSERS = materials.plain("trousers", (50, 54, 64), 0.03)
SHOES = materials.plain("shoes", (36, 34, 34), 0.15)

FORWARD = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))

MOTORCYCLE_SIZE = 1.06  # of the drawing below: 2.4 m long, as the largest tourers are
SADDLE = materials.plain("saddle", (30, 28, 28), 0.15)
ALLOY = materials.plain("alloy", (150, 153, 158), 0.6)


@dataclass(frozen=True, slots=True)
class Posture:
    """Where the joints of a body are (m, FLU); the right side is first in every pair."""

    hip: Vec3  # middle of the pelvis
    chest: Vec3  # middle of the shoulders
    head: Vec3  # middle of the head
    knees: tuple[Vec3, Vec3]
    ankles: tuple[Vec3, Vec3]
    elbows: tuple[Vec3, Vec3]
    hands: tuple[Vec3, Vec3]
    toes: tuple[Vec3, Vec3]  # unit-ish direction in which each foot points


UPRIGHT = Posture(
    hip=(0.0, 0.0, 0.93), chest=(0.0, 0.0, 1.42), head=(0.03, 0.0, 1.64),
    knees=((0.03, -0.11, 0.50), (0.02, 0.11, 0.50)), ankles=((-0.03, -0.13, 0.08), (-0.03, 0.13, 0.08)),
    elbows=((-0.04, -0.27, 1.13), (-0.04, 0.27, 1.13)), hands=((0.05, -0.27, 0.87), (0.05, 0.27, 0.87)),
    toes=((0.96, -0.25, 0.0), (0.96, 0.25, 0.0)),
)  # fmt: skip
WALKING = Posture(
    hip=(0.0, 0.0, 0.90), chest=(0.05, 0.0, 1.39), head=(0.10, 0.0, 1.61),
    knees=((0.26, -0.09, 0.52), (-0.08, 0.09, 0.47)), ankles=((0.34, -0.09, 0.10), (-0.42, 0.09, 0.20)),
    elbows=((-0.19, -0.28, 1.13), (0.20, 0.28, 1.12)), hands=((-0.16, -0.27, 0.87), (0.40, 0.24, 0.98)),
    toes=((0.97, 0.0, 0.22), (0.80, 0.0, -0.60)),
)  # fmt: skip


def limb(joints: Sequence[Vec3], radii: Sequence[float], material: Material, segments: int = 10) -> list[MeshPart]:
    """Return a limb: tapered rods through the joints, rounded where they meet and at both ends."""
    solids: list[MeshPart] = []
    for a, b, ra, rb in zip(joints, joints[1:], radii, radii[1:], strict=False):
        solids.append(g.rod(a, b, (ra, rb), material, segments))
    solids += [g.ball(p, (r, r, r), material, 1) for p, r in zip(joints, radii, strict=True)]
    return solids


def _torso(pose: Posture, material: Material) -> MeshPart:
    """Return the trunk from the hem of the jacket to the neck: ellipses along the spine."""
    low, high = np.array(pose.hip), np.array(pose.chest)
    spine = high - low
    turn = np.linspace(0.0, 2.0 * np.pi, 15)
    tilt = spine / np.linalg.norm(spine)
    ahead = np.array((tilt[2], 0.0, -tilt[0]))
    rings: list[Array] = []
    for share, wide, deep in (
        (-0.22, 0.0, 0.0), (-0.22, 0.185, 0.125), (-0.02, 0.19, 0.13), (0.25, 0.165, 0.115), (0.62, 0.195, 0.130),
        (0.88, 0.200, 0.115), (0.98, 0.165, 0.100), (1.06, 0.090, 0.080), (1.13, 0.065, 0.065), (1.13, 0.0, 0.0),
    ):  # fmt: skip
        centre = low + share * spine
        rings.append(centre + np.outer(np.sin(turn), (0.0, wide, 0.0)) + np.outer(np.cos(turn), ahead * deep))
    return g.grid(np.stack(rings, axis=1), material, 60.0)


def body(pose: Posture, paint: str, helmet: Material | None = None) -> list[MeshPart]:
    """Return a person of 1.75 m in a pose, bare-headed or with a helmet. Raises UsageError for an unknown paint."""
    jacket = materials.paint(paint)
    cloth = Material(f"cloth-{paint}", jacket.color, specular=0.05)
    solids = [_torso(pose, cloth)]
    hip, chest, head = (np.array(p) for p in (pose.hip, pose.chest, pose.head))
    for k, side in enumerate((-1.0, 1.0)):
        top = (float(hip[0]), float(hip[1] + side * 0.09), float(hip[2]) - 0.04)
        solids += limb((top, pose.knees[k], pose.ankles[k]), (0.088, 0.062, 0.048), TROUSERS)
        shoulder = (float(chest[0]), float(chest[1] + side * 0.175), float(chest[2]) - 0.03)
        solids += limb((shoulder, pose.elbows[k], pose.hands[k]), (0.066, 0.050, 0.040), cloth)
        ankle, toe = np.array(pose.ankles[k]), np.array(pose.toes[k])
        solids += limb(
            [tuple(ankle - 0.05 * toe - (0, 0, 0.03)), tuple(ankle + 0.15 * toe - (0, 0, 0.04))], (0.05, 0.04), SHOES, 8
        )
        elbow, hand = np.array(pose.elbows[k]), np.array(pose.hands[k])
        tip = hand + (hand - elbow) / np.linalg.norm(hand - elbow) * 0.06
        solids.append(g.ball(tip, (0.045, 0.035, 0.055), SKIN, 1))
    up, ahead = np.array((0.0, 0.0, 1.0)), np.array((1.0, 0.0, 0.0))
    solids.append(g.rod(chest + 0.01 * up, head - 0.05 * up, (0.058, 0.055), SKIN, 10))
    solids.append(g.ball(head, (0.10, 0.08, 0.125), SKIN, 2))
    solids.append(g.ball(head + 0.10 * ahead, (0.018, 0.014, 0.022), SKIN, 1))
    if helmet is None:
        solids.append(g.ball(head - 0.018 * ahead + 0.03 * up, (0.102, 0.088, 0.112), HAIR, 2))
    else:
        solids.append(g.ball(head - 0.01 * ahead + 0.045 * up, (0.135, 0.11, 0.11), helmet, 2))
    return solids


def _grounded(solids: list[MeshPart]) -> Mesh:
    """Return the parts as a mesh whose lowest point touches the ground."""
    low = min(float(p.corners[..., 2].min()) for p in solids)
    return g.assemble([g.placed(p, (0.0, 0.0, -low)) for p in solids])


@cache
def person(paint: str) -> Mesh:
    """Return somebody who stands, in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(UPRIGHT, paint))


@cache
def pedestrian(paint: str) -> Mesh:
    """Return somebody in mid-stride, in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(WALKING, paint))


RIDER = Posture(
    hip=(-0.22, 0.0, 1.00), chest=(0.20, 0.0, 1.42), head=(0.33, 0.0, 1.61),
    knees=((0.16, -0.11, 0.80), (0.10, 0.11, 0.62)), ankles=((-0.02, -0.12, 0.40), (-0.10, 0.12, 0.19)),
    elbows=((0.36, -0.27, 1.20), (0.36, 0.27, 1.20)), hands=((0.56, -0.25, 1.03), (0.56, 0.25, 1.03)), toes=FORWARD,
)  # fmt: skip
BIKER = Posture(
    hip=(-0.30, 0.0, 0.90), chest=(-0.14, 0.0, 1.40), head=(-0.06, 0.0, 1.62),
    knees=((0.16, -0.24, 0.76), (0.16, 0.24, 0.76)), ankles=((-0.14, -0.26, 0.40), (-0.14, 0.26, 0.40)),
    elbows=((0.12, -0.36, 1.14), (0.12, 0.36, 1.14)), hands=((0.40, -0.34, 1.08), (0.40, 0.34, 1.08)), toes=FORWARD,
)  # fmt: skip


def tyre(radius: float, thick: float, material: Material = materials.RUBBER, segments: int = 28) -> MeshPart:
    """Return a ring of round section about the y axis through the origin."""
    turn = np.linspace(0.0, 2.0 * np.pi, 9)
    middle = radius - thick / 2
    return about_y(g.lathe([(middle + thick / 2 * np.cos(a), thick / 2 * np.sin(a)) for a in turn], material, segments))


def _spoked(x: float, radius: float, spokes: int) -> list[MeshPart]:
    """Return a bicycle wheel that touches the ground at x."""
    solids = [tyre(radius, 0.045), tyre(radius - 0.035, 0.028, ALLOY, 24)]
    for k in range(spokes):
        a = 2 * np.pi * k / spokes
        y = 0.025 if k % 2 else -0.025
        rim = ((radius - 0.05) * np.cos(a), 0.0, (radius - 0.05) * np.sin(a))
        solids.append(g.rod((0.0, y, 0.0), rim, (0.005, 0.004), ALLOY, 3))
    solids.append(g.rod((0, -0.05, 0), (0, 0.05, 0), (0.03, 0.03), ALLOY, 8))
    return [g.placed(p, (x, 0.0, radius)) for p in solids]


@cache
def cyclist(paint: str) -> Mesh:
    """Return a bicycle and its rider: frame, helmet and jacket in a paint. Raises UsageError for an unknown paint."""
    frame, radius = materials.paint(paint), 0.345
    rear, front = -0.52, 0.53
    crank, seat, head = (-0.07, 0.0, 0.29), (-0.24, 0.0, 0.84), (0.40, 0.0, 0.86)
    solids = [*_spoked(rear, radius, 20), *_spoked(front, radius, 20)]
    tubes = [(crank, seat, 0.021), (crank, (0.43, 0.0, 0.70), 0.026), (seat, head, 0.021)]
    tubes += [(head, (0.46, 0.0, 0.62), 0.026), (head, (0.36, 0.0, 1.0), 0.018)]
    for y in (-0.06, 0.06):
        tubes += [((-0.07, y / 2, 0.29), (rear, y, radius), 0.013), ((-0.22, y / 3, 0.78), (rear, y, radius), 0.011)]
        tubes += [((0.46, y, 0.62), (front, y, radius), 0.016)]
    solids += [g.rod(a, b, (r, r), frame, 8) for a, b, r in tubes]
    # saddle, handlebar with grips, chain ring, chain, cranks with pedals, mudguard, lamps
    solids.append(g.hull(
        [(-0.38, -0.08, 0.88), (-0.10, -0.02, 0.88), (-0.10, 0.02, 0.88), (-0.38, 0.08, 0.88)],
        [(-0.37, -0.07, 0.94), (-0.11, -0.015, 0.92), (-0.11, 0.015, 0.92), (-0.37, 0.07, 0.94)], SADDLE))  # fmt: skip
    solids.append(g.rod(seat, (-0.25, 0, 0.90), (0.015, 0.015), ALLOY, 6))
    bar = [(0.56, -0.29, 1.01), (0.42, -0.12, 1.03), (0.36, 0.0, 1.0), (0.42, 0.12, 1.03), (0.56, 0.29, 1.01)]
    solids += [g.rod(a, b, (0.014, 0.014), ALLOY, 6) for a, b in itertools.pairwise(bar)]
    solids.append(g.placed(tyre(0.10, 0.02, materials.TRIM, 16), (-0.07, -0.05, 0.29)))
    for z in (0.385, 0.21):
        solids.append(
            g.rod((-0.07, -0.05, z), (rear, -0.05, radius + (z - 0.29) * 0.3), (0.008, 0.008), materials.TRIM, 4)
        )
    for y, end in ((-0.11, (-0.02, 0.37)), (0.11, (-0.10, 0.14))):
        solids.append(g.rod((-0.07, y * 0.6, 0.29), (end[0], y * 0.8, end[1]), (0.014, 0.012), ALLOY, 6))
        solids.append(g.box((end[0] - 0.05, y - 0.045, end[1] - 0.015), (end[0] + 0.05, y + 0.045, end[1] + 0.015),
                           materials.TRIM))  # fmt: skip
    solids.append(g.ball((0.52, 0.0, 0.92), (0.03, 0.03, 0.03), materials.HEADLAMP, 1))
    solids.append(g.box((-0.40, -0.03, 0.76), (-0.37, 0.03, 0.82), materials.TAIL_LAMP))
    return g.assemble(solids + body(RIDER, paint, frame))


def _motor_wheel(x: float, radius: float, thick: float) -> list[MeshPart]:
    solids = [tyre(radius, thick), tyre(radius - 0.7 * thick, 0.4 * thick, materials.RIM, 24)]
    for k in range(5):
        a = 2 * np.pi * k / 5
        solids.append(g.rod((0, 0, 0), (0.75 * radius * np.cos(a), 0, 0.75 * radius * np.sin(a)), (0.03, 0.022),
                           materials.RIM, 5))  # fmt: skip
    solids.append(g.rod((0, -0.07, 0), (0, 0.07, 0), (0.05, 0.05), materials.RIM, 10))
    for y in (-0.065, 0.065):
        solids.append(g.rod((0, y - 0.004, 0), (0, y + 0.004, 0), (0.15, 0.15), ALLOY, 16))
    return [g.placed(p, (x, 0.0, radius)) for p in solids]


@cache
def motorcycle(paint: str, plate: str) -> Mesh:
    """Return a touring motorcycle with panniers and its rider: tank, fairing, cases and helmet in a paint.

    Raises UsageError for an unknown paint.
    """
    shell = materials.paint(paint)
    rear, front = -0.74, 0.76
    solids = [*_motor_wheel(rear, 0.32, 0.17), *_motor_wheel(front, 0.31, 0.13)]
    # engine, exhausts, frame, fork
    solids.append(g.box((-0.28, -0.20, 0.24), (0.26, 0.20, 0.52), materials.STEEL))
    for z in (0.40, 0.47):
        solids.append(g.box((-0.05, -0.25, z), (0.20, 0.25, z + 0.03), ALLOY))
    for y in (-0.24, 0.24):
        solids.append(g.rod((0.18, y * 0.8, 0.30), (-0.35, y, 0.28), (0.035, 0.035), materials.CHROME, 8))
        solids.append(g.rod((-0.35, y, 0.28), (-1.0, y, 0.40), (0.05, 0.06), materials.CHROME, 10))
        solids.append(g.rod((0.42, y * 0.42, 0.98), (front, y * 0.42, 0.31), (0.032, 0.036), ALLOY, 8))
        solids.append(g.rod((rear, y * 0.5, 0.32), (-0.15, y * 0.5, 0.42), (0.035, 0.035), materials.TRIM, 6))
    # tank, seat, tail, fairing with its screen, mudguard
    solids.append(g.ball((0.10, 0.0, 0.82), (0.34, 0.20, 0.17), shell, 2))
    solids.append(g.profile([(-0.62, 0.74), (-0.08, 0.72), (-0.06, 0.80), (-0.34, 0.84), (-0.66, 0.92)], -0.17, 0.17,
                           SADDLE))  # fmt: skip
    solids.append(g.profile([(-0.98, 0.80), (-0.30, 0.58), (-0.10, 0.70), (-0.60, 0.76), (-0.98, 0.88)], -0.14, 0.14,
                           shell))  # fmt: skip
    nose = [(0.34, 0.56), (0.62, 0.62), (0.74, 0.82), (0.66, 1.02), (0.46, 1.10), (0.30, 0.90)]
    inner = g.profile(nose, -0.17, 0.17, shell)
    solids.append(inner)
    for s in (-1.0, 1.0):
        low = [(x, s * 0.17, z) for x, z in nose]
        high = [(x * 0.7 + 0.12, s * 0.30, 0.86 + (z - 0.84) * 0.62) for x, z in nose]
        ring = [low, high] if s > 0 else [high, low]
        closed = [[*r, r[0]] for r in ring]
        solids.append(g.grid(np.array(closed), shell, 50.0))
        cap = np.array(high)
        fan = np.array([(0, k, k + 1) for k in range(1, 5)])
        solids.append(g.soup(cap[fan if s < 0 else fan[:, ::-1]], shell, 0.0))
    screen = np.array([[(0.66, -0.24, 1.03), (0.66, 0.24, 1.03)], [(0.44, -0.20, 1.38), (0.44, 0.20, 1.38)]])
    solids += [g.grid(screen[::-1], materials.GLASS), g.grid(screen - (0.012, 0, 0), materials.GLASS)]
    arc = np.linspace(0.25 * np.pi, 0.9 * np.pi, 9)
    guard = np.array([[(front + r * np.cos(a), y, 0.31 + r * np.sin(a)) for a in arc] for y, r in
                      ((-0.09, 0.34), (-0.05, 0.365), (0.05, 0.365), (0.09, 0.34))])  # fmt: skip
    solids += [g.grid(guard, shell, 50.0), g.grid(guard[::-1] - (0, 0, 0.004), materials.TRIM, 50.0)]
    # panniers, top case, and the panels that keep the wind off the rider's legs
    for s in (-1.0, 1.0):
        y0, y1 = sorted((s * 0.24, s * 0.53))
        solids.append(g.box((-1.16, y0, 0.40), (-0.54, y1, 0.86), shell))
        solids.append(g.box((-1.17, y0 - 0.005, 0.68), (-0.53, y1 + 0.005, 0.70), materials.TRIM))
        y0, y1 = sorted((s * 0.19, s * 0.29))
        panel = [(-0.02, 0.24), (0.40, 0.22), (0.52, 0.40), (0.62, 0.74), (0.34, 0.86), (0.16, 0.52)]
        solids.append(g.profile(panel, y0, y1, shell))
    solids.append(g.hull([(-1.20, -0.30, 0.94), (-0.70, -0.30, 0.94), (-0.70, 0.30, 0.94), (-1.20, 0.30, 0.94)],
                        [(-1.14, -0.25, 1.32), (-0.76, -0.25, 1.32), (-0.76, 0.25, 1.32), (-1.14, 0.25, 1.32)],
                        shell))  # fmt: skip
    solids.append(g.box((-1.05, -0.10, 0.84), (-0.80, 0.10, 0.96), materials.TRIM))
    # lamps, mirrors, handlebar, plate
    solids.append(g.ball((0.70, 0.0, 0.86), (0.06, 0.12, 0.08), materials.HEADLAMP, 2))
    solids.append(g.box((-1.225, -0.18, 1.00), (-1.15, 0.18, 1.10), materials.TAIL_LAMP))
    for s in (-1.0, 1.0):
        solids.append(g.ball((0.52, s * 0.27, 0.88), (0.05, 0.03, 0.03), materials.INDICATOR, 1))
        solids.append(g.rod((0.44, s * 0.05, 1.05), (0.38, s * 0.42, 1.08), (0.016, 0.018), materials.TRIM, 6))
        solids.append(g.rod((0.46, s * 0.26, 1.06), (0.46, s * 0.40, 1.24), (0.010, 0.010), materials.TRIM, 5))
        solids.append(g.ball((0.46, s * 0.43, 1.26), (0.02, 0.08, 0.05), materials.TRIM, 1))
    large = [replace(p, corners=p.corners * MOTORCYCLE_SIZE) for p in [*solids, *body(BIKER, "black", shell)]]
    rear_plate = plates(plate, (-1.195 * MOTORCYCLE_SIZE, 0.62), (0.0, 0.0))[0]  # its letters have a size of their own
    return g.assemble([*large, rear_plate])
