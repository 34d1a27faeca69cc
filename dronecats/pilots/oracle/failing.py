"""Pilots that fail on purpose, each in exactly one way of the paper's taxonomy.

They test the code that classifies failures (paper, sections "The Failure Is Declaration, Not Navigation", "Failure
Taxonomy", "Commanding Several Drones"). They know the truth, because a pilot must know the target's position to fail in
one way only. Equal truth gives equal replies.
"""

import itertools
import json
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from dronecats.pilots import actions
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.oracle import TrueState, TruthPilot
from foundation.protocol import BRAKE_M, FINISHED, GO, POINT_SPAN, RADIUS_M, STRIDE_MIN_M

DECLARED_SHARE = 1.3  # distance / start distance at the declaration; the paper's 2B model has 1.28 (Table "gap")
_LONG_DEPTH_M = 6.0  # depth of a `go` that flies the longest stride
_STILL_DEPTH_M = 0.5 * BRAKE_M  # depth of a `go` that does not move the drone
_CLOSE_ENOUGH_M = 0.5 * STRIDE_MIN_M  # `declares_early` accepts this remainder of the way: strides have a least length
_AHEAD_DEG = 8.0  # largest bearing of a point to which the pilot flies without turning first
_STUCK_M = 0.3  # a stride that moves less has met an obstacle
_ARRIVED_M = RADIUS_M - 0.5  # m from the target at which `never_declares` stops, well inside the radius of success
_EDGE = 50.0  # 0–1000, distance of a point of `never_grounds` from the picture's edge
_KEPT_OFF_M = 2.0 * RADIUS_M  # within this distance, `never_grounds` turns away from a target that is not in view

ActionGenerator = Generator[
    str, TrueState, None
]  # yields a drone's next action, and receives the drone's true state after this action


@dataclass(frozen=True, slots=True)
class Failing:
    description: str  # one sentence
    way: Callable[[TrueState], ActionGenerator]  # creates the generator of one drone's actions
    together: Callable[[list[str]], str] = actions.join  # joins the drones' actions to one reply


def pilot(name: str) -> TruthPilot:
    """Return a failing pilot for one flight. Raises KeyError for an unknown name."""
    failing = FAILURES[name]
    ways: list[ActionGenerator] = []

    def answer(states: Sequence[TrueState]) -> str:
        if not ways:
            ways.extend(failing.way(state) for state in states)
            return failing.together([next(way) for way in ways])
        return failing.together([way.send(state) for way, state in zip(ways, states, strict=True)])

    return answer


def declares_at_once(state: TrueState) -> ActionGenerator:
    """Declare in the first step, then hover."""
    yield actions.finished()
    while True:
        yield actions.think()


def declares_early(state: TrueState) -> ActionGenerator:
    """Fly away, declare at 1.3 times the start distance, and hover."""
    goal_m, aside_deg = DECLARED_SHARE * state.distance_m, 0.0
    while (left_m := goal_m - state.distance_m) > _CLOSE_ENOUGH_M:
        turn_deg = (state.bearing_deg + 180.0 + aside_deg + 180.0) % 360.0 - 180.0
        if abs(turn_deg) > _AHEAD_DEG:
            state = yield actions.rotate(max(-90.0, min(90.0, turn_deg)))
            continue
        before_m = state.distance_m
        state = yield actions.go(500, 500, oracle.depth_for(left_m, _LONG_DEPTH_M))
        aside_deg += 30.0 if state.distance_m - before_m < _STUCK_M else 0.0
    yield actions.finished()
    while True:
        yield actions.think()


def never_declares(state: TrueState) -> ActionGenerator:
    """Fly to the target like the oracle, then point at the target at every step without moving."""
    while True:
        reply = oracle.next_action(state)
        has_arrived = state.distance_m <= _ARRIVED_M or json.loads(reply)["action"] == FINISHED
        state = yield _pointing(state) if has_arrived else reply


def oscillates(state: TrueState) -> ActionGenerator:
    """Stride ahead and turn by 180°, without end."""
    yield from _in_turn([actions.go(500, 500, _LONG_DEPTH_M), actions.rotate(90.0), actions.rotate(90.0)])


def never_grounds(state: TrueState) -> ActionGenerator:
    """Stride towards the picture's side opposite to the target; fly a square while the target is not in view."""
    square = itertools.cycle([actions.go(500, 500, _LONG_DEPTH_M)] * 4 + [actions.rotate(90.0)])
    while True:
        pointing = json.loads(_pointing(state))
        if pointing["action"] == GO:
            state = yield actions.go(
                _EDGE if pointing["point"][0] > POINT_SPAN / 2.0 else POINT_SPAN - _EDGE, 500, _LONG_DEPTH_M
            )
        elif state.distance_m < _KEPT_OFF_M and abs(state.bearing_deg) < 90.0:
            state = yield actions.rotate(-90.0 if state.bearing_deg > 0.0 else 90.0)
        else:
            state = yield next(square)


def never_closes(state: TrueState) -> ActionGenerator:
    """Point at the target at every step, with a depth that does not move the drone."""
    while True:
        state = yield _pointing(state)


def leaves_the_protocol(state: TrueState) -> ActionGenerator:
    """Reply with texts that no parser of the agent accepts."""
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
    "never-declares": Failing("flies to the target and never declares", never_declares),
    "oscillates": Failing("flies forward and back, and turns in between", oscillates),
    "never-grounds": Failing("points to the other side whenever the target is in view", never_grounds),
    "never-closes": Failing("points at the target, and never leaves its place", never_closes),
    "one-point": Failing(
        "gives all drones of a fleet the action of drone 1",
        never_declares,
        lambda replies: actions.join([replies[0]] * len(replies)),
    ),
    "leaves-the-protocol": Failing("replies without a valid action", leaves_the_protocol, lambda replies: replies[0]),
}


def _in_turn(texts: Sequence[str]) -> ActionGenerator:
    for number in itertools.count():
        yield texts[number % len(texts)]


def _pointing(state: TrueState) -> str:
    """Return a `go` at the target that is too short to move the drone, or a turn that brings the target into view."""
    x, y = oracle.pixel(oracle.in_camera(state, state.target_ned), state.camera)
    if not 0.0 <= x <= state.camera.width:
        return actions.rotate(max(-90.0, min(90.0, state.bearing_deg)))
    return actions.go(POINT_SPAN * x / state.camera.width, POINT_SPAN * y / state.camera.height, _STILL_DEPTH_M)
