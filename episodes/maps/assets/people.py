"""Builds meshes of standing and walking people. `paint` names the jacket's colour; passers-by have muted colours."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.materials import Srgb
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Array, Material, Mesh
from foundation.frames import Vec3

SKINS: tuple[Srgb, ...] = (
    (214, 168, 140),
    (120, 82, 60),
    (198, 152, 122),
    (158, 112, 82),
    (224, 184, 160),
    (88, 60, 46),
)
HAIRS: tuple[Srgb, ...] = ((52, 40, 32), (24, 22, 22), (150, 118, 76), (120, 116, 112), (94, 58, 38), (72, 54, 42))
LEGS: tuple[Srgb, ...] = (
    (50, 54, 64),
    (70, 84, 108),
    (140, 126, 100),
    (30, 31, 34),
    (96, 98, 100),
    (72, 72, 58),
    (44, 52, 76),
)
SHOES: tuple[Srgb, ...] = ((36, 34, 34), (206, 206, 202), (96, 70, 50), (70, 74, 80))
SHIRTS: tuple[Srgb, ...] = ((224, 224, 220), (150, 164, 178), (70, 76, 86), (196, 184, 160))
BAGS: tuple[Srgb, ...] = ((64, 62, 60), (132, 104, 76), (58, 68, 84), (76, 84, 70), (150, 148, 142))
# jackets of passers-by. No instruction names these colours, so only the target has the named colour
MUTED: tuple[Srgb, ...] = (
    (98, 102, 106), (58, 62, 72), (188, 178, 160), (92, 94, 74), (40, 42, 46), (98, 104, 112), (142, 136, 126),
    (86, 98, 100), (214, 210, 200), (90, 95, 104), (124, 114, 118), (64, 64, 62), (128, 136, 122), (160, 164, 168),
    (112, 104, 96), (28, 29, 31),
)  # fmt: skip
TOPS = ("jacket", "hooded", "coat", "jacket", "jumper")
HEADS = ("short", "long", "short", "cap", "bun", "short", "beanie", "bald", "long", "sun hat")
BELOW = ("trousers", "trousers", "skirt", "trousers", "shorts", "trousers")
CARRIED = ("none", "backpack", "shoulder bag", "none")


@dataclass(frozen=True, slots=True)
class Outfit:
    """Clothes, bag and build of a person. Colours are sRGB."""

    skin: Srgb = SKINS[2]
    hair: Srgb = HAIRS[0]
    head: str = "short"  # one of HEADS
    headgear: Srgb = BAGS[0]
    top: str = "jacket"  # one of TOPS
    shirt: Srgb = SHIRTS[0]  # under an open jacket or coat
    below: str = "trousers"  # one of BELOW
    legs: Srgb = LEGS[0]  # trousers, shorts or skirt
    shoes: Srgb = SHOES[0]
    bag: str = "none"  # one of CARRIED
    bag_color: Srgb = BAGS[0]
    stature: float = 1.0  # body height relative to 1.75 m
    girth: float = 1.0  # factor on the widths of trunk and limbs
    has_beard: bool = False


@dataclass(frozen=True, slots=True)
class Posture:
    """Positions of the joints of a body (m, FLU). The right side is first in every pair."""

    hip: Vec3  # middle of the pelvis
    chest: Vec3  # middle of the shoulders
    head: Vec3  # middle of the head
    knees: tuple[Vec3, Vec3]
    ankles: tuple[Vec3, Vec3]
    elbows: tuple[Vec3, Vec3]
    hands: tuple[Vec3, Vec3]
    toes: tuple[Vec3, Vec3]  # direction in which each foot points, about unit length
    holds: str = ""  # object in the right hand: 'phone', 'cup'


UPRIGHT = Posture(
    hip=(0.0, 0.0, 0.93), chest=(0.0, 0.0, 1.42), head=(0.03, 0.0, 1.64),
    knees=((0.03, -0.11, 0.50), (0.02, 0.11, 0.50)), ankles=((-0.03, -0.13, 0.08), (-0.03, 0.13, 0.08)),
    elbows=((-0.04, -0.27, 1.13), (-0.04, 0.27, 1.13)), hands=((0.05, -0.27, 0.87), (0.05, 0.27, 0.87)),
    toes=((0.96, -0.25, 0.0), (0.96, 0.25, 0.0)),
)  # fmt: skip
EASED = replace(  # relaxed, with the weight on the left leg
    UPRIGHT, hip=(0.0, 0.04, 0.92), chest=(0.0, 0.02, 1.41), head=(0.03, 0.0, 1.63),
    knees=((0.09, -0.11, 0.49), (0.0, 0.13, 0.50)), ankles=((0.02, -0.19, 0.08), (-0.03, 0.11, 0.08)),
    toes=((0.88, -0.47, 0.0), (0.98, 0.18, 0.0)),
)  # fmt: skip
STANDING: tuple[Posture, ...] = (
    UPRIGHT,
    replace(UPRIGHT, head=(0.07, 0.0, 1.625), elbows=((0.02, -0.25, 1.13), (-0.04, 0.27, 1.13)),
            hands=((0.25, -0.12, 1.22), (0.05, 0.27, 0.87)), holds="phone"),
    replace(EASED, elbows=((-0.07, -0.27, 1.13), (-0.07, 0.29, 1.13)), hands=((0.07, -0.19, 0.93), (0.07, 0.23, 0.93))),
    replace(UPRIGHT, elbows=((0.06, -0.26, 1.14), (0.06, 0.26, 1.14)), hands=((0.17, 0.06, 1.16), (0.19, -0.06, 1.21))),
    replace(EASED, elbows=((0.02, -0.26, 1.12), (-0.04, 0.29, 1.13)), hands=((0.24, -0.17, 1.18), (0.05, 0.29, 0.87)),
            holds="cup"),
    replace(UPRIGHT, elbows=((-0.04, -0.27, 1.13), (-0.06, 0.36, 1.14)), hands=((0.05, -0.27, 0.87), (0.02, 0.2, 1.0))),
    replace(EASED, elbows=((0.04, -0.28, 1.14), (-0.04, 0.29, 1.13)), hands=((0.25, -0.27, 1.26), (0.05, 0.29, 0.87))),
)  # fmt: skip
WALKING = Posture(
    hip=(0.0, 0.0, 0.90), chest=(0.05, 0.0, 1.39), head=(0.10, 0.0, 1.61),
    knees=((0.26, -0.09, 0.52), (-0.08, 0.09, 0.47)), ankles=((0.34, -0.09, 0.10), (-0.42, 0.09, 0.20)),
    elbows=((-0.19, -0.28, 1.13), (0.20, 0.28, 1.12)), hands=((-0.16, -0.27, 0.87), (0.40, 0.24, 0.98)),
    toes=((0.97, 0.0, 0.22), (0.80, 0.0, -0.60)),
)  # fmt: skip


def outfit_of(paint: str) -> Outfit:
    """Return the outfit that goes with a jacket of this paint. Each paint has its own outfit."""
    k = list(materials.PAINTS).index(paint) if paint in materials.PAINTS else 0
    top = ("jacket", "hooded", "jumper")[k % 3]
    return replace(_outfit(7 * k + 3), top=top, stature=1.0, below="trousers", legs=LEGS[k % len(LEGS)])


def _outfit(k: int) -> Outfit:
    """Return outfit number k. Consecutive outfits differ in nearly all features."""
    head = HEADS[k % len(HEADS)]
    return Outfit(
        skin=SKINS[k % len(SKINS)],
        hair=HAIRS[(k + k // 5) % len(HAIRS)],
        head=head,
        headgear=BAGS[(k + 2) % len(BAGS)],
        top=TOPS[k % len(TOPS)],
        shirt=SHIRTS[k % len(SHIRTS)],
        below=BELOW[k % len(BELOW)],
        legs=LEGS[k % len(LEGS)],
        shoes=SHOES[(k + 1) % len(SHOES)],
        bag=CARRIED[k % len(CARRIED)],
        bag_color=BAGS[k % len(BAGS)],
        stature=(1.0, 0.95, 1.03, 0.97, 1.01)[k % 5],
        girth=(1.0, 0.94, 1.1, 1.0, 1.16, 0.97)[k % 6],
        has_beard=head in ("short", "bald") and k % 3 == 0,
    )


def limb(
    joints: Sequence[Vec3], radii: Sequence[float], looks: Sequence[Material], segments: int = 10
) -> list[MeshPart]:
    """Return a limb: tapered rods between the joints. Each rod has its own material and a ball at its start."""
    solids: list[MeshPart] = []
    for a, b, ra, rb, look in zip(joints, joints[1:], radii, radii[1:], looks, strict=False):
        solids += [g.rod(a, b, (ra, rb), look, segments), g.ball(a, (ra, ra, ra), look, 1)]
    return solids


# rings of a trunk from the hem up: position from pelvis (0) to shoulders (1), half width (m), half depth (m)
TRUNK = (
    (-0.22, 0.0, 0.0), (-0.22, 0.185, 0.125), (-0.02, 0.19, 0.13), (0.25, 0.165, 0.115), (0.62, 0.195, 0.130),
    (0.88, 0.200, 0.115), (0.98, 0.165, 0.100), (1.06, 0.090, 0.080), (1.13, 0.065, 0.065), (1.13, 0.0, 0.0),
)  # fmt: skip
COAT = ((-0.80, 0.0, 0.0), (-0.80, 0.225, 0.20), (-0.40, 0.205, 0.160), *TRUNK[2:])
SKIRT = ((-0.88, 0.0, 0.0), (-0.88, 0.215, 0.19), (-0.40, 0.200, 0.155), (-0.05, 0.175, 0.120), (-0.05, 0.0, 0.0))
BACKPACK = ((0.12, 0.13, 0.14), (0.88, 0.10, 0.12))  # lower and upper end: position as in TRUNK, depth, half width (m)


@dataclass(frozen=True, slots=True)
class _Trunk:
    """The origin, axes and girth of a trunk."""

    low: Array  # (3,) m, the pelvis
    spine: Array  # (3,) m, from the pelvis to the shoulders
    ahead: Array  # (3,) unit vector forwards, perpendicular to the spine
    girth: float

    def rings(self, outline: Sequence[tuple[float, float, float]], material: Material) -> MeshPart:
        """Return the surface through ellipses along the spine; `outline` has rows like those of TRUNK."""
        turn = np.linspace(0.0, 2.0 * np.pi, 15)
        rings = []
        for share, wide, deep in outline:
            side, front = (0.0, wide * self.girth, 0.0), self.ahead * deep * self.girth
            rings.append(self.low + share * self.spine + np.outer(np.sin(turn), side) + np.outer(np.cos(turn), front))
        return g.grid(np.stack(rings, axis=1), material, 60.0)

    def at(self, share: float, ahead: float, left: float) -> Array:
        """Return the point (m) at a share of the spine, moved by `ahead` and `left` (m)."""
        return np.asarray(self.low + share * self.spine + ahead * self.ahead + np.array((0.0, left, 0.0)))

    def front(self, shares: Sequence[float], half: Sequence[float], material: Material, proud: float) -> MeshPart:
        """Return a strip of cloth on the front, `proud` (m) off the trunk, with half width `half` (m) at each share."""
        _, wide, deep = np.array(TRUNK[1:-1]).T
        along = np.array(TRUNK)[1:-1, 0]
        rows = []
        for share, reach in zip(shares, half, strict=True):
            a, b = np.interp(share, along, wide) * self.girth, np.interp(share, along, deep) * self.girth
            edge = b * np.sqrt(1.0 - (reach / a) ** 2) + proud
            rows.append([self.at(share, out, y) for out, y in ((edge, reach), (b + proud, 0.0), (edge, -reach))])
        return g.grid(np.array(rows)[:, ::-1], material, 60.0)


def _trunk(pose: Posture, outfit: Outfit, cloth: Material) -> list[MeshPart]:
    """Return trunk, skirt, shirt and bag."""
    low, spine = np.array(pose.hip), np.array(pose.chest) - np.array(pose.hip)
    tilt = spine / np.linalg.norm(spine)
    trunk = _Trunk(low, spine, np.array((tilt[2], 0.0, -tilt[0])), outfit.girth)
    solids = [trunk.rings(COAT if outfit.top == "coat" else TRUNK, cloth)]
    if outfit.below == "skirt" and outfit.top != "coat":
        solids.append(trunk.rings(SKIRT, _cloth(outfit.legs)))
    if outfit.top in ("jacket", "coat"):
        solids.append(trunk.front((0.3, 0.62, 0.88, 1.05), (0.012, 0.045, 0.065, 0.05), _cloth(outfit.shirt), 0.006))
    elif outfit.top == "hooded":  # the hood lies on the shoulders
        solids.append(g.ball(trunk.at(1.04, -0.07, 0.0), (0.085, 0.13, 0.075), cloth, 1))
    bag = materials.plain("bag", outfit.bag_color, 0.05)
    if outfit.bag == "backpack":
        back = 0.12 * outfit.girth
        foot, crown = ([trunk.at(up, x, y) for x, y in _ring(back, deep, half)] for up, deep, half in BACKPACK)
        solids.append(g.hull(foot, crown, bag, crease_deg=60.0))
        for y in (-0.115, 0.115):
            strap = [trunk.at(0.95, -0.06, y), trunk.at(0.99, 0.05, y), trunk.at(0.80, 0.125 * outfit.girth, y)]
            solids += [g.rod(a, b, (0.018, 0.018), bag, 5) for a, b in itertools.pairwise(strap)]
    elif outfit.bag == "shoulder bag":
        y = 0.25 * outfit.girth
        low_end, high_end = trunk.at(-0.05, -0.02, y), trunk.at(0.97, 0.0, -0.10)
        foot = [trunk.at(-0.35, x, y + w) for x, w in ((-0.16, -0.04), (0.12, -0.04), (0.12, 0.05), (-0.16, 0.05))]
        crown = [trunk.at(-0.02, x, y + w) for x, w in ((-0.15, -0.03), (0.11, -0.03), (0.11, 0.03), (-0.15, 0.03))]
        solids.append(g.hull(foot, crown, bag))
        for out in (0.14, -0.14):
            middle = trunk.at(0.5, out * outfit.girth, 0.07)
            solids += [g.rod(low_end, middle, (0.014, 0.014), bag, 4), g.rod(middle, high_end, (0.014, 0.014), bag, 4)]
    return solids


def _ring(back: float, deep: float, half: float) -> tuple[tuple[float, float], ...]:
    """Return the corners (ahead, left) of a backpack in plan, counter-clockwise seen from above."""
    return ((-back - deep, -0.7 * half), (-back, -half), (-back, half), (-back - deep, 0.7 * half))


@cache
def _cloth(color: Srgb) -> Material:
    return materials.plain("cloth", color, 0.03)


def _head(pose: Posture, outfit: Outfit, helmet: Material | None) -> list[MeshPart]:
    """Return neck, head, hair and headgear."""
    chest, head = np.array(pose.chest), np.array(pose.head)
    up, ahead, left = np.array((0.0, 0.0, 1.0)), np.array((1.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))
    skin, hair = materials.plain("skin", outfit.skin, 0.1), materials.plain("hair", outfit.hair, 0.1)
    hat, eye = materials.plain("hat", outfit.headgear, 0.03), materials.plain("eye", (34, 28, 26), 0.3)
    solids = [g.rod(chest + 0.01 * up, head - 0.05 * up, (0.058, 0.055), skin, 10)]
    solids += [g.ball(head, (0.10, 0.08, 0.125), skin, 2), g.ball(head + 0.10 * ahead, (0.018, 0.014, 0.022), skin, 1)]
    solids += [
        g.ball(head + 0.084 * ahead + y * left + 0.022 * up, (0.009, 0.014, 0.010), eye, 0) for y in (-0.034, 0.034)
    ]
    if outfit.has_beard:
        solids.append(g.ball(head + 0.032 * ahead - 0.07 * up, (0.072, 0.068, 0.062), hair, 1))
    if helmet is not None:
        return [*solids, g.ball(head - 0.01 * ahead + 0.045 * up, (0.135, 0.11, 0.11), helmet, 2)]
    if outfit.head != "bald":
        solids.append(g.ball(head - 0.018 * ahead + 0.03 * up, (0.102, 0.088, 0.112), hair, 2))
    if outfit.head == "long":
        solids.append(g.ball(head - 0.052 * ahead - 0.08 * up, (0.062, 0.098, 0.15), hair, 1))
    elif outfit.head == "bun":
        solids.append(g.ball(head - 0.12 * ahead + 0.05 * up, (0.05, 0.05, 0.05), hair, 1))
    elif outfit.head == "beanie":
        solids.append(g.ball(head - 0.014 * ahead + 0.062 * up, (0.108, 0.096, 0.098), hat, 2))
    elif outfit.head == "cap":
        solids.append(g.ball(head - 0.010 * ahead + 0.066 * up, (0.108, 0.094, 0.084), hat, 2))
        solids.append(g.ball(head + 0.115 * ahead + 0.062 * up, (0.075, 0.07, 0.012), hat, 1))
    elif outfit.head == "sun hat":
        brim = g.lathe([(0.0, 0.0), (0.20, -0.012), (0.205, 0.0), (0.10, 0.02), (0.095, 0.10), (0.0, 0.12)], hat, 14)
        solids.append(g.transformed(brim, head + 0.045 * up - 0.01 * ahead))
    return solids


def body(pose: Posture, paint: str, outfit: Outfit, helmet: Material | None = None) -> list[MeshPart]:
    """Return the parts of a person in a pose, in a jacket of a paint. Raises UsageError for an unknown paint."""
    jacket = materials.paint(paint)
    return _dressed(pose, Material(f"cloth-{paint}", jacket.color, specular=0.05), outfit, helmet)


def _dressed(pose: Posture, cloth: Material, outfit: Outfit, helmet: Material | None = None) -> list[MeshPart]:
    """Return the parts of a person in a pose, in a jacket of the material `cloth`."""
    skin, legs = materials.plain("skin", outfit.skin, 0.1), _cloth(outfit.legs)
    shoes = materials.plain("shoes", outfit.shoes, 0.15)
    solids = _trunk(pose, outfit, cloth)
    hip, chest = np.array(pose.hip), np.array(pose.chest)
    thick = outfit.girth
    for k, side in enumerate((-1.0, 1.0)):
        top = (float(hip[0]), float(hip[1] + side * 0.09), float(hip[2]) - 0.04)
        is_bare = outfit.below != "trousers"
        shin = (0.058, 0.042, skin) if is_bare else (0.062 * thick, 0.048, legs)
        solids += limb((top, pose.knees[k], pose.ankles[k]), (0.088 * thick, *shin[:2]), (legs, shin[2]))
        shoulder = (float(chest[0]), float(chest[1] + side * (0.11 + 0.06 * thick)), float(chest[2]) - 0.03)
        solids += limb((shoulder, pose.elbows[k], pose.hands[k]), (0.063, 0.050, 0.040), (cloth, cloth))
        ankle, toe = np.array(pose.ankles[k]), np.array(pose.toes[k])
        heel, tip = ankle - 0.05 * toe - (0, 0, 0.03), ankle + 0.15 * toe - (0, 0, 0.04)
        solids += [g.rod(heel, tip, (0.05, 0.04), shoes, 8), g.ball(heel, (0.05, 0.05, 0.05), shoes, 1)]
        solids.append(g.ball(tip, (0.04, 0.04, 0.04), shoes, 1))
        elbow, hand = np.array(pose.elbows[k]), np.array(pose.hands[k])
        tip = hand + (hand - elbow) / np.linalg.norm(hand - elbow) * 0.06
        solids.append(g.ball(tip, (0.045, 0.035, 0.055), skin, 1))
        if k == 0 and pose.holds == "phone":
            solids.append(
                g.box(tip - np.array((0.005, 0.035, 0.01)), tip + np.array((0.055, 0.035, 0.13)), materials.TRIM)
            )
        elif k == 0 and pose.holds == "cup":
            rim = tip + np.array((0.03, 0.0, 0.10))
            solids.append(g.rod(rim - (0.0, 0.0, 0.14), rim, (0.030, 0.040), materials.WHITE_WOOD, 10))
    solids += _head(pose, outfit, helmet)
    return [replace(p, corners=p.corners * outfit.stature) for p in solids]


def _grounded(solids: list[MeshPart]) -> Mesh:
    """Return the parts as a mesh whose lowest point touches the ground."""
    low = min(float(p.corners[..., 2].min()) for p in solids)
    return g.assemble([g.transformed(p, (0.0, 0.0, -low)) for p in solids])


@cache
def person(paint: str) -> Mesh:
    """Return a standing person in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(UPRIGHT, paint, replace(outfit_of(paint), bag="none")))


@cache
def pedestrian(paint: str) -> Mesh:
    """Return a walking person in a jacket of a paint. Raises UsageError for an unknown paint."""
    return _grounded(body(WALKING, paint, outfit_of(paint)))


@cache
def passer_by(number: int) -> Mesh:
    """Return a standing person in muted colours. Any sixteen consecutive numbers look different."""
    color = MUTED[number % len(MUTED)]
    cloth = Material("cloth-muted", materials.linear(color), specular=0.05)
    return _grounded(_dressed(STANDING[number % len(STANDING)], cloth, _outfit(number)))
