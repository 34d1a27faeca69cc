"""Referring expressions: "the bench left of the fountain", what they denote in a scene, computed from its geometry.

A relation has a clear and a loose reading. An expression refers when exactly its target fulfils the clear one and no
other thing of the kind even the loose one: what a person might hesitate about is ambiguous.

The things of the scene have the names that people call them by, and an expression may refer to what of a map can be
seen from a start.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from episodes import maps
from episodes.maps.places import Places
from episodes.maps.scene import Instance
from episodes.world.visibility import turn
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_from_euler, rotate
from foundation.polygon import Point

# What people call the assets; any other is called by its name.
NOUNS: dict[str, tuple[str, ...]] = {
    "suv": ("SUV",),
    "sedan": ("sedan", "saloon"),
    "hatchback": ("hatchback",),
    "pickup": ("pickup truck", "pickup"),
    "van": ("van",),
    "bus": ("bus",),
    "motorcycle": ("motorcycle", "motorbike"),
    "cyclist": ("cyclist", "bicycle"),
    "person": ("person", "pedestrian"),
    "pedestrian": ("person", "pedestrian"),
    "quadrotor": ("quadrotor", "drone on the stand"),
}


def nouns(asset: str) -> tuple[str, ...]:
    """Return what people call an asset or a kind of fixture, the commonest word first."""
    return NOUNS.get(asset, (asset.replace("-", " ").replace("_", " "),))


def kind_of(asset: str) -> str:
    """Return the kind that a map's instances of an asset have: written with hyphens, and who walks is a person, too."""
    return "person" if asset == "pedestrian" else asset.replace("_", "-")


COMPACT_M = 4.0  # half the width of the largest landmark that has a left, a right, a front and a back for a passer-by
BESIDE_M, BESIDE_LOOSE_M = 12.0, 16.0  # from a landmark, the farthest that is called beside, before or behind it
NEAREST_M = 25.0  # … and that is called the nearest to it
APART_M = 40.0  # the farthest that two landmarks stand apart with something between them

# relation → how it is said
WORDS: dict[str, str] = {
    "nearest": "nearest",
    "left of": "left of",
    "right of": "right of",
    "in front of": "in front of",
    "behind": "behind",
    "between": "between",
}
SEEN_FROM = ("left of", "right of", "in front of", "behind")  # these depend on where one stands
_READ = re.compile(
    r"the (?P<noun>[a-z][a-z -]*?) "
    r"(?P<how>nearest|(?:to the )?left of|(?:to the )?right of|in front of|behind|between) (?P<rest>the .*|[A-Z].*)"
)


@dataclass(frozen=True, slots=True)
class Footprint:
    """Where a landmark stands."""

    north: float  # m, middle
    east: float  # m, middle
    half: Point  # m, along its own forward and right axes
    yaw: float  # rad

    @property
    def compact(self) -> bool:
        """Return whether it is small enough that things stand left or right of it rather than along it."""
        return max(self.half) <= COMPACT_M

    def distance_m(self, spot: Point) -> float:
        """Return how far a spot is from its edge; 0 inside."""
        north, east = spot[0] - self.north, spot[1] - self.east
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        ahead, right = abs(c * north + s * east), abs(-s * north + c * east)
        return math.hypot(max(ahead - self.half[0], 0.0), max(right - self.half[1], 0.0))


@dataclass(frozen=True, slots=True)
class Expression:
    """A kind of thing in a relation to one landmark, or to two for 'between'."""

    noun: str
    relation: str  # a key of WORDS
    landmarks: tuple[str, ...]  # their phrases, article included

    @property
    def words(self) -> str:
        """Return the expression as a person says it."""
        return f"the {self.noun} {WORDS[self.relation]} {' and '.join(self.landmarks)}"


def read(text: str, phrases: Iterable[str]) -> Expression | None:
    """Return the expression in an instruction, given the phrases of the map's landmarks; None when there is none."""
    found = _READ.search(text)
    if found is None:
        return None
    how, rest = found["how"].removeprefix("to the "), found["rest"]
    known = sorted(phrases, key=lambda phrase: (-len(phrase), phrase))
    first = next((p for p in known if _starts(rest, p)), None)
    if first is None:
        return None
    if how != "between":
        return Expression(found["noun"], how, (first,))
    rest = rest[len(first) :]
    second = next((p for p in known if _starts(rest, f" and {p}")), None)
    return Expression(found["noun"], how, (first, second)) if second else None


def _starts(text: str, words: str) -> bool:
    return text.startswith(words) and not text[len(words) : len(words) + 1].isalnum()


def denotes(
    expression: Expression, things: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> tuple[list[str], list[str]]:
    """Return the names of the things that fulfil an expression clearly, and of those that might be meant by it.

    things: name → place (m, NED) of everything of the kind; landmarks: phrase → where it stands.
    """
    marks = [landmarks[phrase] for phrase in expression.landmarks]
    spots = {name: _flat(place) for name, place in things.items()}
    if expression.relation == "nearest":
        return _nearest(spots, marks[0])
    if not all(mark.compact for mark in marks):
        return [], []
    points = [(mark.north, mark.east) for mark in marks]
    if expression.relation == "between":
        return _both(spots, lambda spot, loose: _between(spot, points, loose))
    test = _SIDES[expression.relation]
    return _both(spots, lambda spot, loose: test(*_beside(spot, points[0], _flat(viewer)), loose))


def refers(
    expression: Expression, target: str, things: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> bool:
    """Return whether an expression names the target and nothing else could be meant."""
    clear, loose = denotes(expression, things, landmarks, viewer)
    return clear == [target] and loose == [target]


def expressions(
    noun: str, target: str, things: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> list[Expression]:
    """Return all expressions that name a target, in a fixed order."""
    phrases: Sequence[str] = sorted(landmarks)
    asked = [Expression(noun, how, (phrase,)) for phrase in phrases for how in WORDS if how != "between"]
    asked += [Expression(noun, "between", (a, b)) for k, a in enumerate(phrases) for b in phrases[k + 1 :]]
    return [one for one in asked if refers(one, target, things, landmarks, viewer)]


def _flat(place: Vec3) -> Point:
    return (place[0], place[1])


def _both(spots: Mapping[str, Point], holds: Callable[[Point, bool], bool]) -> tuple[list[str], list[str]]:
    return [n for n, p in spots.items() if holds(p, False)], [n for n, p in spots.items() if holds(p, True)]


def _nearest(spots: Mapping[str, Point], landmark: Footprint) -> tuple[list[str], list[str]]:
    ways = {name: landmark.distance_m(spot) for name, spot in spots.items()}
    if not ways or min(ways.values()) > NEAREST_M:
        return [], []
    least = min(ways.values())
    return [n for n, w in ways.items() if w == least], [n for n, w in ways.items() if w <= 1.25 * least + 1.0]


def _between(spot: Point, ends: list[Point], loose: bool) -> bool:
    a, b = ends
    span = math.dist(a, b)
    if not 4.0 <= span <= APART_M:
        return False
    along = ((spot[0] - a[0]) * (b[0] - a[0]) + (spot[1] - a[1]) * (b[1] - a[1])) / span
    aside = abs((spot[0] - a[0]) * (b[1] - a[1]) - (spot[1] - a[1]) * (b[0] - a[0])) / span
    low, wide = (0.05, 0.3) if loose else (0.2, 0.12)
    return low <= along / span <= 1.0 - low and aside <= max(1.5, wide * span)


def _beside(spot: Point, landmark: Point, viewer: Point) -> tuple[float, float, float]:
    """Return how far (m) a spot is beyond the landmark, to the right of it, and from it, as the viewer sees it."""
    way = math.dist(viewer, landmark) or 1.0
    forward = ((landmark[0] - viewer[0]) / way, (landmark[1] - viewer[1]) / way)
    off = (spot[0] - landmark[0], spot[1] - landmark[1])
    beyond = off[0] * forward[0] + off[1] * forward[1]
    right = -off[0] * forward[1] + off[1] * forward[0]
    return beyond, right, math.hypot(*off)


def _side(sign: float) -> Callable[[float, float, float, bool], bool]:
    def holds(beyond: float, right: float, away: float, loose: bool) -> bool:
        least, slant, far = (0.4, 2.0, BESIDE_LOOSE_M) if loose else (1.2, 0.8, BESIDE_M)
        return sign * right >= least and abs(beyond) <= slant * abs(right) and away <= far

    return holds


def _line(sign: float) -> Callable[[float, float, float, bool], bool]:
    def holds(beyond: float, right: float, away: float, loose: bool) -> bool:
        least, slant, far = (0.8, 1.0, BESIDE_LOOSE_M) if loose else (1.5, 0.4, BESIDE_M)
        return sign * beyond >= least and abs(right) <= slant * abs(beyond) and away <= far

    return holds


_SIDES = {"left of": _side(-1.0), "right of": _side(1.0), "in front of": _line(-1.0), "behind": _line(1.0)}


CAMERA = CameraModel(320, 180)
SEEN_SHARE = 0.0015  # of the picture: a landmark that is spoken of must be as large as that
# kinds that no instruction refers to: too large, too many of one look, or too slight
UNNAMED = ("ground", "hall", "house", "wood", "tree", "conifer", "shrub", "bush", "hedge", "fence", "lamp", "bollard")
SLIGHT = ("bench", "bin", "person")  # kinds that may be looked for, but by which nothing else is told


def footprint(one: Instance) -> Footprint:
    """Return where an instance stands."""
    low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
    north, east, _ = np.array(one.position_ned) + turn(one.turned) @ ((low + high) / 2)
    half = (high - low) / 2
    return Footprint(float(north), float(east), (float(half[0]), float(half[1])), one.yaw)


def landmarks(map_name: str, map_seed: int, kind: str, viewer: Vec3, yaw_deg: float | None) -> dict[str, Footprint]:
    """Return phrase → place of everything that an instruction may use to tell one thing of a kind from the others.

    Always the map's own landmarks; for a drone that sees its target at the start (`yaw_deg` given), also what the first
    picture shows one of, as 'the kiosk'. Empty for a map that has no landmarks of its own.
    """
    named = {mark.phrase: mark.name for mark in places(map_name, map_seed).landmarks}
    if not named:
        return {}
    by_name = {i.name: i for i in maps.build(map_name, map_seed).instances}
    found = {phrase: footprint(by_name[name]) for phrase, name in named.items() if by_name[name].kind != kind}
    if yaw_deg is None:
        return found
    shown = _scenery(map_name, map_seed).seen(viewer, yaw_deg)
    of_kind: dict[str, list[str]] = defaultdict(list)
    for name in shown:
        of_kind[by_name[name].kind].append(name)
    for other, names in sorted(of_kind.items()):
        one = by_name[names[0]]
        spoken_of = other not in (kind, *UNNAMED, *SLIGHT) and one.name not in named.values()
        if spoken_of and len(names) == 1 and shown[names[0]] >= SEEN_SHARE:
            found[f"the {nouns(other)[0]}"] = footprint(one)
    return found


@lru_cache(maxsize=8)
def places(map_name: str, map_seed: int) -> Places:
    """Return what a map offers; nothing where it is a user's own."""
    return maps.places(map_name, map_seed) if map_name in maps.shipped() else Places((), ())


@lru_cache(maxsize=4)
def _scenery(map_name: str, map_seed: int) -> "Scenery":
    return Scenery(maps.build(map_name, map_seed).instances)


class Scenery:
    """A map's solid things, for counting the pixels that show each."""

    def __init__(self, instances: tuple[Instance, ...]) -> None:
        things = [i for i in instances if i.solid]
        placed = [(i.mesh.vertices @ turn(i.turned).T + np.array(i.position_ned))[i.mesh.triangles] for i in things]
        self._names = [i.name for i in things]
        self._owner = np.repeat(np.arange(len(things)), [len(t) for t in placed])
        corners = np.ascontiguousarray(np.concatenate(placed).reshape(-1, 3), dtype=np.float32)
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))

    def seen(self, origin: Vec3, yaw_deg: float) -> dict[str, float]:
        """Return name → share of the picture (0 … 1) of everything that a level drone's camera sees."""
        attitude = quat_from_euler(0.0, 0.0, math.radians(yaw_deg))
        axes = np.array([rotate(attitude, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])
        eye = np.array(origin) + np.array(rotate(attitude, CAMERA.offset_frd))
        x = (np.arange(CAMERA.width) + 0.5 - CAMERA.width / 2) / CAMERA.focal_px
        y = (np.arange(CAMERA.height) + 0.5 - CAMERA.height / 2) / CAMERA.focal_px
        way = (axes[0] + x[None, :, None] * axes[1] + y[:, None, None] * axes[2]).reshape(-1, 3).astype(np.float32)
        start = np.ascontiguousarray(np.broadcast_to(eye.astype(np.float32), way.shape))
        hit = self._scene.run(start, np.ascontiguousarray(way), output=1)["primID"]
        count = Counter(self._owner[hit[hit >= 0]].tolist())
        return {self._names[k]: n / len(way) for k, n in sorted(count.items())}
