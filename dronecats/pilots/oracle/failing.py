"""Pilots that fail on purpose, each in one of the ways that the paper tells models apart by, and in no other.

They are there so that what finds and names a failure can be held to one that is known ("The Failure Is Declaration, Not
Navigation", "Failure Taxonomy", "Commanding Several Drones"). They are told the truth, as the oracle is: to fail in one
way alone takes knowing where the target is. What they answer is the same for the same truth.
"""

import itertools
import json
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from dronecats.pilots import reply
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.sight import Knowing, TrueSight
from foundation.protocol import BRAKE_M, FINISHED, GO, POINT_SPAN, RADIUS_M, STRIDE_MIN_M

EARLY = 1.3  # of the start distance, at which the paper's 2B model declares on average (Table "gap": 1.28)
_LONG_DEPTH_M = 6.0  # flown as the longest stride
_STILL_DEPTH_M = 0.5 * BRAKE_M  # flown as none
_CLOSE_ENOUGH_M = 0.5 * STRIDE_MIN_M  # nearer to a distance no stride comes
_AHEAD_DEG = 8.0  # off the nose, within which it need not turn first
_STUCK_M = 0.3  # less than this, and something stood in the stride's way
_ARRIVED_M = RADIUS_M - 0.5  # well within what counts as arrival
_EDGE = 50.0  # 0–1000, a point as near to the picture's edge
_KEPT_OFF_M = 2.0 * RADIUS_M  # nearer than this it does not stride towards the target even unseen

Way = Generator[str, TrueSight, None]  # yields a drone's next action, and is sent what is true when it has been flown


@dataclass(frozen=True, slots=True)
class Failing:
    """One failure."""

    says: str  # what it does, in one sentence
    way: Callable[[TrueSight], Way]  # of one drone
    together: Callable[[list[str]], str] = reply.fleet  # the drones' actions as one reply


def pilot(name: str) -> Knowing:
    """Return the pilot of one flight. Raises KeyError for an unknown name."""
    failing = FAILURES[name]
    ways: list[Way] = []

    def answer(sights: Sequence[TrueSight]) -> str:
        if not ways:
            ways.extend(failing.way(sight) for sight in sights)
            return failing.together([next(way) for way in ways])
        return failing.together([way.send(sight) for way, sight in zip(ways, sights, strict=True)])

    return answer


def declares_at_once(sight: TrueSight) -> Way:
    """Declare in the first step, and hover."""
    yield reply.finished()
    while True:
        yield reply.think()


def declares_early(sight: TrueSight) -> Way:
    """Fly away, declare where the distance is 1.3 times that of the start, and hover."""
    goal_m, aside_deg = EARLY * sight.distance_m, 0.0
    while (left_m := goal_m - sight.distance_m) > _CLOSE_ENOUGH_M:
        turn_deg = (sight.bearing_deg + 180.0 + aside_deg + 180.0) % 360.0 - 180.0
        if abs(turn_deg) > _AHEAD_DEG:
            sight = yield reply.rotate(max(-90.0, min(90.0, turn_deg)))
            continue
        before_m = sight.distance_m
        sight = yield reply.go(500, 500, oracle.depth_for(left_m, _LONG_DEPTH_M))
        aside_deg += 30.0 if sight.distance_m - before_m < _STUCK_M else 0.0
    yield reply.finished()
    while True:
        yield reply.think()


def never_declares(sight: TrueSight) -> Way:
    """Fly to the target as the oracle does, and where that is reached go on pointing at it."""
    while True:
        told = oracle.of_one(sight)
        there = sight.distance_m <= _ARRIVED_M or json.loads(told)["action"] == FINISHED
        sight = yield _pointing(sight) if there else told


def oscillates(sight: TrueSight) -> Way:
    """Stride on, turn round, stride back, turn round, for ever."""
    yield from _in_turn([reply.go(500, 500, _LONG_DEPTH_M), reply.rotate(90.0), reply.rotate(90.0)])


def never_grounds(sight: TrueSight) -> Way:
    """Stride to the other side of the picture than the target is on, and round a square while it is in none."""
    square = itertools.cycle([reply.go(500, 500, _LONG_DEPTH_M)] * 4 + [reply.rotate(90.0)])
    while True:
        told = json.loads(_pointing(sight))
        if told["action"] == GO:
            sight = yield reply.go(
                _EDGE if told["point"][0] > POINT_SPAN / 2.0 else POINT_SPAN - _EDGE, 500, _LONG_DEPTH_M
            )
        elif sight.distance_m < _KEPT_OFF_M and abs(sight.bearing_deg) < 90.0:
            sight = yield reply.rotate(-90.0 if sight.bearing_deg > 0.0 else 90.0)
        else:
            sight = yield next(square)


def never_closes(sight: TrueSight) -> Way:
    """Point at the target, step for step, with a depth that brakes."""
    while True:
        sight = yield _pointing(sight)


def one_point(sight: TrueSight) -> Way:
    """Fly as one that never declares; what is said of the first drone is then said of all."""
    yield from never_declares(sight)


def leaves_the_protocol(sight: TrueSight) -> Way:
    """Say what is no action, neither to the letter nor with patience."""
    yield from _in_turn(NO_ACTIONS)


NO_ACTIONS = (
    "The target is ahead of me, slightly to the right. I will fly towards it.",
    '{"action": "land"}',
    "",
    "go(point=[500, 500], depth_m=6)",
    '{"action": "go", "point": [1240, 355], "depth_m": 6}',
    "I am sorry, but I cannot control a drone.",
    '{"action": "rotate", "angle_deg": "to the right"}',
    '{"action": "go", "point": [500, 5',
)
FAILURES = {
    "declares-at-once": Failing("declares in its first step, and hovers", declares_at_once),
    "declares-early": Failing("flies away, and declares at 1.3 times the start distance", declares_early),
    "never-declares": Failing("flies to the target and stays there without a word", never_declares),
    "oscillates": Failing("strides to and fro, and turns round between", oscillates),
    "never-grounds": Failing("points to the other side whenever the target is in view", never_grounds),
    "never-closes": Failing("points at the target, and never leaves its place", never_closes),
    "one-point": Failing(
        "gives every drone of a fleet the first one's action",
        one_point,
        lambda told: reply.fleet([told[0]] * len(told)),
    ),
    "leaves-the-protocol": Failing("replies what is no action", leaves_the_protocol, lambda told: told[0]),
}


def _in_turn(texts: Sequence[str]) -> Way:
    for number in itertools.count():
        yield texts[number % len(texts)]


def _pointing(sight: TrueSight) -> str:
    """Return the `go` at the target that moves no drone, or the turn that brings the target into view."""
    x, y = oracle.pixel(
        oracle.in_camera(sight.position_ned, sight.attitude, sight.camera, sight.target_ned), sight.camera
    )
    if not 0.0 <= x <= sight.camera.width:
        return reply.rotate(max(-90.0, min(90.0, sight.bearing_deg)))
    return reply.go(POINT_SPAN * x / sight.camera.width, POINT_SPAN * y / sight.camera.height, _STILL_DEPTH_M)
