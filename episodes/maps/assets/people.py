"""People: standing, walking, or seated on something with two wheels. The paint is the colour of their jacket."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import paint as colors
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Material, Mesh
from foundation.frames import Vec3

SKIN = colors.plain("skin", (198, 152, 122), 0.1)
HAIR = colors.plain("hair", (52, 40, 32), 0.1)
TROUSERS = colors.plain("trousers", (50, 54, 64), 0.03)
SHOES = colors.plain("shoes", (36, 34, 34), 0.15)


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


FORWARD = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
STANDING = Posture(
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
    parts: list[MeshPart] = []
    for a, b, ra, rb in zip(joints, joints[1:], radii, radii[1:], strict=False):
        parts.append(g.rod(a, b, (ra, rb), material, segments))
    parts += [g.ball(p, (r, r, r), material, 1) for p, r in zip(joints, radii, strict=True)]
    return parts


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
    jacket = colors.paint(paint)
    cloth = Material(f"cloth-{paint}", jacket.color, specular=0.05)
    parts = [_torso(pose, cloth)]
    hip, chest, head = (np.array(p) for p in (pose.hip, pose.chest, pose.head))
    for k, side in enumerate((-1.0, 1.0)):
        top = (float(hip[0]), float(hip[1] + side * 0.09), float(hip[2]) - 0.04)
        parts += limb((top, pose.knees[k], pose.ankles[k]), (0.088, 0.062, 0.048), TROUSERS)
        shoulder = (float(chest[0]), float(chest[1] + side * 0.175), float(chest[2]) - 0.03)
        parts += limb((shoulder, pose.elbows[k], pose.hands[k]), (0.066, 0.050, 0.040), cloth)
        ankle, toe = np.array(pose.ankles[k]), np.array(pose.toes[k])
        parts += limb(
            [tuple(ankle - 0.05 * toe - (0, 0, 0.03)), tuple(ankle + 0.15 * toe - (0, 0, 0.04))], (0.05, 0.04), SHOES, 8
        )
        elbow, hand = np.array(pose.elbows[k]), np.array(pose.hands[k])
        tip = hand + (hand - elbow) / np.linalg.norm(hand - elbow) * 0.06
        parts.append(g.ball(tip, (0.045, 0.035, 0.055), SKIN, 1))
    up, ahead = np.array((0.0, 0.0, 1.0)), np.array((1.0, 0.0, 0.0))
    parts.append(g.rod(chest + 0.01 * up, head - 0.05 * up, (0.058, 0.055), SKIN, 10))
    parts.append(g.ball(head, (0.10, 0.08, 0.125), SKIN, 2))
    parts.append(g.ball(head + 0.10 * ahead, (0.018, 0.014, 0.022), SKIN, 1))
    if helmet is None:
        parts.append(g.ball(head - 0.018 * ahead + 0.03 * up, (0.102, 0.088, 0.112), HAIR, 2))
    else:
        parts.append(g.ball(head - 0.01 * ahead + 0.045 * up, (0.135, 0.11, 0.11), helmet, 2))
    return parts


def _grounded(parts: list[MeshPart]) -> Mesh:
    """Return the parts as a mesh whose lowest point touches the ground."""
    low = min(float(p.corners[..., 2].min()) for p in parts)
    return g.assemble([g.placed(p, (0.0, 0.0, -low)) for p in parts])


@cache
def person(paint: str) -> Mesh:
    """Return somebody who stands, in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(STANDING, paint))


@cache
def pedestrian(paint: str) -> Mesh:
    """Return somebody in mid-stride, in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(WALKING, paint))
