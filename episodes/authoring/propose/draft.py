"""Makes the random draws and the instructions of proposals for new episodes. The episode search checks them.

The draws for one request are spread evenly over the allowed ranges, separately for each dimension. An instruction is a
phrase of its cell (the kind of task: a key of VERBS) with the name of the target.
"""

import random
from dataclasses import dataclass

from episodes.authoring.check.referring import nouns
from episodes.authoring.check.sight import Framing, yaw_hiding, yaw_showing
from episodes.maps.scene import Instance
from episodes.records.record import HIDDEN, MAX_SEED, StartPose, TargetRecord

JITTER = 0.25  # greatest distance of a draw from the middle of its stratum, in stratum widths; see `shares`

VERBS: dict[str, tuple[str, ...]] = {
    "approaching": (
        "go to {what}", "fly to {what}", "approach {what}", "head over to {what}", "move up to {what}",
        "fly over to {what}",
    ),
    "searching": (
        "find {what} and go to {it}", "look for {what} and fly to {it}", "search for {what} and approach {it}",
        "locate {what} and go there", "find {what} and fly up to {it}",
    ),
    "tracking": (
        "follow {what} and get close to {it}", "catch up with {what}", "go after {what} and close in on {it}",
        "fly after {what} and reach {it}", "track {what} and come close to {it}",
    ),
    "search-and-track": (
        "find {what} and catch up with {it}", "look for {what} and follow {it} until you reach {it}",
        "search for {what} and close in on {it}", "locate {what}, go after {it} and reach {it}",
    ),
    "commanding": (
        "go to {what}", "fly to {what}", "find {what} and go to it", "approach {what}", "send a drone to {what}",
    ),
}  # fmt: skip
PEOPLE = ("person", "pedestrian", "cyclist")

BOARDS = (  # a row has the inscriptions of an episode's four signs
    ("DOCK A", "DOCK B", "DOCK C", "DOCK D"),
    ("GATE 3", "GATE 5", "GATE 8", "GATE 9"),
    ("BAY 12", "BAY 17", "BAY 21", "BAY 71"),
    ("NORTH", "SOUTH", "EAST", "WEST"),
    ("STORE", "STAGE", "STAIR", "START"),
    ("LANE 2", "LANE 4", "LANE 6", "LANE 7"),
    ("ZONE K", "ZONE M", "ZONE N", "ZONE R"),
    ("PUMP", "PORT", "POST", "PARK"),
    ("HALL 1", "HALL 4", "HALL 7", "HALL 9"),
    ("UNIT 38", "UNIT 58", "UNIT 83", "UNIT 85"),
)


@dataclass(frozen=True, slots=True)
class Proposal:
    """The values of an episode's record, without the id and the computed values."""

    target: TargetRecord
    placed: Instance  # the same target, as it stands when the episode begins
    starts: tuple[StartPose, ...]
    visible: bool
    instruction: str
    seed: int  # seed of all random values in the flight
    candidates: tuple[TargetRecord, ...] = ()


def yaw_deg(cell: str, ahead_deg: float, framed: Framing, share: float) -> float | None:
    """Return the yaw (deg) of a start, None if no yaw is allowed.

    In a cell with a hidden target, the allowed yaws keep the target out of view. In other cells, they show all of it.
    `share` (0 … 1) selects one of the allowed yaws.
    """
    off = yaw_hiding(framed, share) if cell in HIDDEN else yaw_showing(framed, share)
    return None if off is None else ahead_deg + off


def flight_seed(rng: random.Random) -> int:
    return rng.randrange(1, MAX_SEED)


@dataclass(frozen=True, slots=True)
class Draw:
    """The draw for one record: relative positions (0 … 1) in the allowed ranges of its start."""

    turn: float  # among the allowed yaws; see `yaw_deg`
    distance: float  # among the start distances
    height: float  # among the start heights

    def height_m(self, limits_m: tuple[float, float]) -> float:
        """Return the start height between two limits."""
        return limits_m[0] + self.height * (limits_m[1] - limits_m[0])


def shares(count: int, rng: random.Random) -> list[Draw]:
    """Return the draws of `count` records. Each dimension is cut into `count` strata, with one draw in each stratum.

    With two or more records, the first and the last stratum have their middles at the ends of the range. So draws reach
    both ends.
    """
    turns, distances, heights = (_strata(count, rng) for _ in range(3))
    return [Draw(*shares) for shares in zip(turns, distances, heights, strict=True)]


def _strata(count: int, rng: random.Random) -> list[float]:
    if count == 1:
        return [rng.random()]
    drawn = [(k + rng.uniform(-JITTER, JITTER)) / (count - 1) for k in range(count)]
    rng.shuffle(drawn)
    return [min(max(share, 0.0), 1.0) for share in drawn]


def instruction(cell: str, name: str, asset: str, rng: random.Random) -> str:
    """Return an instruction of a cell. `name` is the target's name with its article."""
    return rng.choice(VERBS[cell]).format(what=name, it="them" if asset in PEOPLE else "it")


def inscribed(asset: str, text: str, rng: random.Random) -> str:
    if asset == "sign":
        return f"the sign {rng.choice(('that reads', 'saying', 'marked'))} {text}"
    words = rng.choice(("with the licence plate", "whose plate reads", "with number plate"))
    return f"the {nouns(asset)[0]} {words} {text}"


def plates(count: int, rng: random.Random) -> list[str]:
    """Return `count` different plates. Each differs from a common text in at most two digits, so they look alike."""
    base = [rng.randrange(1, 10) for _ in range(4)]
    texts: list[str] = []
    while len(texts) < count:
        digits = list(base)
        for place in rng.sample(range(4), 2):
            digits[place] = rng.randrange(1, 10)
        text = "".join(map(str, digits))
        if text not in texts:
            texts.append(text)
    return texts
