"""Referring expressions, and the rules about instructions: an instruction must name the target and nothing else.

A referring expression is a phrase such as "the bench left of the fountain". The geometry of the scene decides which
things it denotes. Each relation has two tests: a *clear* (strict) test and a *loose* test. An expression refers to the
target if the target passes both tests, and no other thing of its kind passes either.

Expressions use the common names of things in NOUNS. `landmarks` returns the landmarks that an expression may use.
"""

import itertools
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from episodes import maps
from episodes.authoring.check.finding import RuleFinding
from episodes.authoring.check.sight import level, pixel_rays
from episodes.maps import assets
from episodes.maps.geometry import gap_m
from episodes.maps.scene import Instance, Places, turn
from episodes.records.record import EpisodeRecord
from episodes.world.rays import NOTHING, RayScene
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import Vec3, rotate
from foundation.polygon import Point

# Common names of assets, the most common first. An asset without an entry has its own name.
NOUNS: dict[str, tuple[str, ...]] = {
    "suv": ("SUV",),
    "sedan": ("sedan", "saloon"),
    "estate": ("estate car", "station wagon"),
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

COMPACT_M = 4.0  # m, largest half size of a landmark; only `nearest` allows larger ones
# m, largest distance from the landmark for `left of`, `right of`, `in front of` and `behind`: clear test, loose test
BESIDE_M, BESIDE_LOOSE_M = 12.0, 16.0
NEAREST_M = 25.0  # m, largest distance for `nearest`
APART_M = 40.0  # m, largest distance between the two landmarks of `between`
RELATIONS = ("nearest", "left of", "right of", "in front of", "behind", "between")
_READ = re.compile(
    r"the (?P<noun>[a-z][a-z -]*?) "
    r"(?P<relation>nearest|(?:to the )?left of|(?:to the )?right of|in front of|behind|between) "
    r"(?P<rest>the .*|[A-Z].*)"
)

CAMERA = CameraModel(320, 180)
SEEN_SHARE = 0.0015  # an additional landmark fills at least this share of the first picture; see `landmarks`
# kinds that are neither targets nor additional landmarks, because they are too large, too small, or too many
UNNAMED = ("ground", "hall", "house", "wood", "tree", "conifer", "shrub", "bush", "hedge", "fence", "lamp", "bollard")
SLIGHT = ("bench", "bin", "person")  # kinds that may be targets, but never additional landmarks


def nouns(asset: str) -> tuple[str, ...]:
    """Return the common names of an asset or a kind of fixture, the most common first."""
    return NOUNS.get(asset, (asset.replace("-", " ").replace("_", " "),))


def kind_of(asset: str) -> str:
    """Return the `Instance.kind` of an asset on a map: its name with hyphens, or 'person' for a pedestrian."""
    return "person" if asset == "pedestrian" else asset.replace("_", "-")


@dataclass(frozen=True, slots=True)
class Footprint:
    """The ground that a landmark covers, as a rectangle."""

    north: float  # m, middle
    east: float  # m, middle
    half: Point  # m, half size along the landmark's forward and right axes
    yaw: float  # rad

    @property
    def compact(self) -> bool:
        """Return whether the landmark is small enough for all relations; a larger one allows only `nearest`."""
        return max(self.half) <= COMPACT_M

    def distance_m(self, spot: Point) -> float:
        """Return the distance (m) from a spot to the edge of the rectangle; 0 inside."""
        low = (-self.half[0], -self.half[1])
        return gap_m(*spot, (self.north, self.east, self.yaw, low, self.half))


@dataclass(frozen=True, slots=True)
class Expression:
    """A referring expression: a noun, a relation, and one landmark, or two for 'between'."""

    noun: str
    relation: str  # one of RELATIONS
    landmarks: tuple[str, ...]  # phrases, such as 'the clock tower' or 'Euler Hall'

    @property
    def words(self) -> str:
        return f"the {self.noun} {self.relation} {' and '.join(self.landmarks)}"


def read(text: str, phrases: Iterable[str]) -> Expression | None:
    """Return the expression in an instruction, if any. `phrases`: names of landmarks."""
    match = _READ.search(text)
    if match is None:
        return None
    noun, relation, rest = match["noun"], match["relation"].removeprefix("to the "), match["rest"]
    longest_first = sorted(phrases, key=lambda phrase: (-len(phrase), phrase))
    first = next((p for p in longest_first if _starts(rest, p)), None)
    if first is None:
        return None
    if relation != "between":
        return Expression(noun, relation, (first,))
    rest = rest[len(first) :]
    second = next((p for p in longest_first if _starts(rest, f" and {p}")), None)
    return Expression(noun, relation, (first, second)) if second else None


def _starts(text: str, words: str) -> bool:
    return text.startswith(words) and not text[len(words) : len(words) + 1].isalnum()


def denotes(
    expression: Expression, places: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> tuple[list[str], list[str]]:
    """Return two lists of names: the things that pass the clear test, and the things that pass the loose test.

    Both are empty if a landmark is too large for the relation. `places`: name → position (m, NED) of all things that
    the noun may mean. `landmarks`: phrase → footprint. `viewer`: position (m, NED) of the drone that looks at them.
    """
    marks = [landmarks[phrase] for phrase in expression.landmarks]
    spots = {name: _flat(place) for name, place in places.items()}
    if expression.relation == "nearest":
        return _nearest(spots, marks[0])
    if not all(mark.compact for mark in marks):
        return [], []
    points = [(mark.north, mark.east) for mark in marks]
    if expression.relation == "between":
        return _readings(spots, lambda spot, loose: _between(spot, points, loose))
    return _readings(spots, lambda spot, loose: _beside(expression.relation, spot, points[0], _flat(viewer), loose))


def refers(
    expression: Expression, target: str, places: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> bool:
    """Return whether the target passes both tests, and nothing else passes either."""
    clear, loose = denotes(expression, places, landmarks, viewer)
    return clear == [target] and loose == [target]


def expressions(
    noun: str, target: str, places: Mapping[str, Vec3], landmarks: Mapping[str, Footprint], viewer: Vec3
) -> list[Expression]:
    """Return all expressions that refer to the target, in a fixed order."""
    phrases = sorted(landmarks)
    candidates = [Expression(noun, rel, (phrase,)) for phrase in phrases for rel in RELATIONS if rel != "between"]
    candidates += [Expression(noun, "between", pair) for pair in itertools.combinations(phrases, 2)]
    return [expression for expression in candidates if refers(expression, target, places, landmarks, viewer)]


def _flat(place: Vec3) -> Point:
    return (place[0], place[1])


def _readings(spots: Mapping[str, Point], holds: Callable[[Point, bool], bool]) -> tuple[list[str], list[str]]:
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


def _beside(relation: str, spot: Point, landmark: Point, viewer: Point, loose: bool) -> bool:
    """Return whether a spot is left of, right of, in front of or behind a landmark, as the viewer sees them."""
    way = math.dist(viewer, landmark) or 1.0
    forward = ((landmark[0] - viewer[0]) / way, (landmark[1] - viewer[1]) / way)
    off = (spot[0] - landmark[0], spot[1] - landmark[1])
    beyond = off[0] * forward[0] + off[1] * forward[1]
    right = -off[0] * forward[1] + off[1] * forward[0]
    if relation in ("left of", "right of"):
        along, aside, (least, slant) = right, beyond, (0.4, 2.0) if loose else (1.2, 0.8)
    else:
        along, aside, (least, slant) = beyond, right, (0.8, 1.0) if loose else (1.5, 0.4)
    along = along if relation in ("right of", "behind") else -along
    far = BESIDE_LOOSE_M if loose else BESIDE_M
    return along >= least and abs(aside) <= slant * along and math.hypot(*off) <= far


def footprint(instance: Instance) -> Footprint:
    """Return the footprint of an instance's box."""
    north, east, _ = instance.centre_ned
    half = np.ptp(instance.mesh.vertices, axis=0) / 2
    return Footprint(north, east, (float(half[0]), float(half[1])), instance.yaw)


def landmarks(map_name: str, map_seed: int, kind: str, viewer: Vec3, yaw_deg: float | None) -> dict[str, Footprint]:
    """Return phrase → footprint of all landmarks that an instruction may use to distinguish things of a kind.

    These are the map's own landmarks, except those of this kind. `viewer`: position (m, NED) of the first drone at the
    start. `yaw_deg`: this drone's yaw if it sees the target at the start, else None. With a yaw, the only object of
    its kind in the drone's first picture is an additional landmark, such as 'the kiosk'. Kinds in UNNAMED and SLIGHT
    are left out. The result is empty for a map without landmarks of its own.
    """
    named = {mark.phrase: mark.name for mark in places(map_name, map_seed).landmarks}
    if not named:
        return {}
    by_name = {i.name: i for i in maps.build(map_name, map_seed).instances}
    marks = {phrase: footprint(by_name[name]) for phrase, name in named.items() if by_name[name].kind != kind}
    if yaw_deg is None:
        return marks
    shown = _scenery(map_name, map_seed).seen(viewer, yaw_deg)
    of_kind: dict[str, list[str]] = defaultdict(list)
    for name in shown:
        of_kind[by_name[name].kind].append(name)
    for shown_kind, names in sorted(of_kind.items()):
        spoken_of = shown_kind not in (kind, *UNNAMED, *SLIGHT) and names[0] not in named.values()
        if spoken_of and len(names) == 1 and shown[names[0]] >= SEEN_SHARE:
            marks[f"the {nouns(shown_kind)[0]}"] = footprint(by_name[names[0]])
    return marks


def places(map_name: str, map_seed: int) -> Places:
    """Return the places of a shipped map. A user's own map has no places."""
    return maps.places(map_name, map_seed) if map_name in maps.shipped() else Places((), ())


@lru_cache(maxsize=4)
def _scenery(map_name: str, map_seed: int) -> "Scenery":
    return Scenery(maps.build(map_name, map_seed).instances)


class Scenery:
    """Counts the pixels that show each solid of a map."""

    def __init__(self, instances: tuple[Instance, ...]) -> None:
        solids = [i for i in instances if i.solid]
        self._names = [i.name for i in solids]
        self._owner = np.repeat(np.arange(len(solids)), [len(i.mesh.triangles) for i in solids])
        self._scene = RayScene.of_instances(solids)

    def seen(self, origin: Vec3, yaw_deg: float) -> dict[str, float]:
        """Return name → share of the picture (0 … 1) of every solid that a level drone's camera sees."""
        attitude = level(yaw_deg)
        eye = np.array(origin) + np.array(rotate(attitude, CAMERA.offset_frd))
        way = pixel_rays(np.arange(CAMERA.width), np.arange(CAMERA.height), turn(attitude).T, CAMERA)
        hit = self._scene.first_hits(eye, way).triangle
        count = Counter(self._owner[hit[hit != NOTHING]].tolist())
        return {self._names[k]: n / len(way) for k, n in sorted(count.items())}


def contains(text: str, words: str) -> bool:
    """Return whether a text contains `words` as whole words; case does not matter."""
    return re.search(rf"(?<![\w-]){re.escape(words)}(?![\w-])", text, re.IGNORECASE) is not None


def rules(world: World) -> Iterator[RuleFinding]:
    record = world.record
    kinds = nouns(record.target.asset)
    if record.cell == "commanding":
        yield from inscription_rules(record)
        return
    named = any(contains(record.instruction, word) for word in kinds)
    yield RuleFinding("the instruction's noun", named, f"'{record.instruction}'", " or ".join(f"'{k}'" for k in kinds))
    if record.map == "residential" and record.target.native is None:
        yield from paint_rules(world)
    elif named and places(record.map, record.map_seed).landmarks:
        yield place_rule(world)


def inscription_rules(record: EpisodeRecord) -> Iterator[RuleFinding]:
    """Yield whether the instruction has the target's inscription, and whether it lacks those of look-alikes."""
    text = record.target.inscription or ""
    named = bool(text) and contains(record.instruction, text)
    yield RuleFinding("the instruction's inscription", named, f"'{record.instruction}'", f"'{text}'")
    wrong = [c.inscription for c in record.candidates if c.inscription and contains(record.instruction, c.inscription)]
    yield RuleFinding("other inscriptions in the instruction", not wrong, ", ".join(wrong) or "none", "none")


def paint_rules(world: World) -> Iterator[RuleFinding]:
    """Yield whether the instruction names only the target's paint, and whether no other asset has this paint."""
    instruction, paint = world.record.instruction, world.record.target.paint
    named = [name for name in assets.PAINTS if contains(instruction, name)]
    yield RuleFinding("the instruction's colour", named == [paint], ", ".join(named) or "none", str(paint))
    wearers = [
        i.name
        for i in world.scene.instances
        if i is not world.target
        and i.kind in assets.names()
        and any(m.name == f"paint-{paint}" for m in i.mesh.materials)
    ]
    yield RuleFinding("other vehicles in the target's colour", not wearers, ", ".join(wearers[:3]) or "none", "none")


def place_rule(world: World) -> RuleFinding:
    """Return whether the instruction's referring expression refers to the target.

    An instruction without an expression passes if the target is the only thing of its kind.
    """
    record = world.record
    kind = kind_of(record.target.asset)
    of_kind = {i.name: i.position_ned for i in world.scene.instances if kind_of(i.kind) == kind}
    viewer = record.starts[0].position_ned
    yaw = record.starts[0].yaw_deg if record.visible_at_start else None
    marks = landmarks(record.map, record.map_seed, kind, viewer, yaw)
    expression = read(record.instruction, marks)
    rule, wanted = "the target of the instruction's place", f"{world.target.name} alone"
    if expression is None:
        alone = list(of_kind) == [world.target.name]
        hint = "nearest, left of, right of, in front of, behind or between landmarks"
        return RuleFinding(rule, alone, f"none of {len(of_kind)}", f"{wanted}, by {hint}")
    clear, loose = denotes(expression, of_kind, marks, viewer)
    passed = clear == loose == [world.target.name]
    return RuleFinding(rule, passed, ", ".join(dict.fromkeys([*clear, *loose])) or "nothing", wanted)
