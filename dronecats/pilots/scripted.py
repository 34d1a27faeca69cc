"""Pilots that use no pictures: blind patterns, a scripted commander, and the recorded replies of another flight."""

import hashlib
import json
import math
import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from dronecats.pilots import actions
from dronecats.pilots.actions import ORDINALS, Pilot
from foundation.errors import UsageError
from foundation.protocol import BRAKE_M, GO, STRIDE_MAX_M, STRIDE_MIN_M
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Whole

LONG_M, LONG_DEPTH_M = STRIDE_MAX_M, 6.0  # m, the longest stride, and the depth of its `go`
SHORT_M, SHORT_DEPTH_M = STRIDE_MIN_M, BRAKE_M  # m, the shortest stride, and the depth of its `go`
START_M = 16.0  # m, distance of every residential start from the target
VIEW_DEG = 90.0  # horizontal field of view of the camera
_TURN_DEG = 60.0  # turn of the pilot `blind`


@dataclass(frozen=True, slots=True)
class DroneContext:
    """The drone that a pattern flies."""

    drone: int  # index of the drone, in picture order
    drones: int  # the number of drones
    prompt: str  # prompt of the first step, part of the seed of the random patterns

    @property
    def aside_deg(self) -> float:
        """The drone's first turn (deg, + right), which spreads a fleet over the field of view."""
        return 0.0 if self.drones == 1 else VIEW_DEG * ((self.drone + 0.5) / self.drones - 0.5)


@dataclass(frozen=True, slots=True)
class Pattern:
    description: str  # one sentence
    fly: Callable[[DroneContext], Iterator[str]]
    sweeps: bool = False  # True: covers an area; False: follows one line


def long_strides(metres: float) -> Iterator[str]:
    """Yield strides of 3 m and then of 1.2 m, as many as fit into a distance (m)."""
    far = int(metres // LONG_M)
    yield from [actions.go(500, 500, LONG_DEPTH_M)] * far
    yield from [actions.go(500, 500, SHORT_DEPTH_M)] * int((metres - far * LONG_M) // SHORT_M)


def turn(degrees: float) -> Iterator[str]:
    """Yield turns of at most 90° that add up to an angle."""
    while abs(degrees) > 1e-6:
        part = max(-VIEW_DEG, min(VIEW_DEG, degrees))
        yield actions.rotate(part)
        degrees -= part


def creeping() -> Iterator[str]:
    """Yield short strides with a declaration after each, without end."""
    while True:
        yield actions.go(500, 500, SHORT_DEPTH_M)
        yield actions.finished()


def straight(after_deg: float = 0.0, from_m: float = 0.0) -> Callable[[DroneContext], Iterator[str]]:
    """Return a pattern: turn, fly `from_m` metres without a declaration, then alternate strides and declarations."""

    def fly(seat: DroneContext) -> Iterator[str]:
        yield from turn(after_deg + seat.aside_deg)
        yield from long_strides(from_m)
        if from_m:
            yield actions.finished()
        yield from creeping()

    return fly


def declaring(seat: DroneContext) -> Iterator[str]:
    """Declare in place, without end."""
    while True:
        yield actions.finished()


def fan(seat: DroneContext) -> Iterator[str]:
    """Fly out and back along rays, starting with the rays in view, and declare on the way out."""
    yield from turn(seat.aside_deg)
    spread = 30.0 if seat.drones == 1 else VIEW_DEG / seat.drones / 2.0
    for far in (18.0, 36.0):
        before = 0.0
        for ray in (0.0, spread, -spread, *(sign * k * 30.0 for k in (2, 3, 4, 5) for sign in (1, -1)), 180.0):
            yield from turn(math.remainder(ray - before, 360.0))
            yield from [actions.go(500, 500, LONG_DEPTH_M), actions.finished()] * round(far / LONG_M)
            yield from turn(180.0)
            yield from long_strides(far)
            before = ray + 180.0
    yield from creeping()


def spiral(seat: DroneContext) -> Iterator[str]:
    """Fly a square spiral outwards with arms 6 m apart, and declare after each long stride."""
    yield from turn(seat.aside_deg)
    legs = 2
    while True:
        for _ in range(2):
            yield from [actions.go(500, 500, LONG_DEPTH_M), actions.finished()] * legs
            yield actions.rotate(90.0)
        legs += 2


def ring(seat: DroneContext) -> Iterator[str]:
    """Fly out 15 m, then in a circle round the start (targets are 16 m away); declare at every other stride."""
    yield from turn(seat.aside_deg - 45.0)
    yield from long_strides(15.0)
    yield actions.finished()
    yield from turn(90.0)
    side = math.degrees(2.0 * math.asin(LONG_M / (2.0 * 15.0)))
    for k in range(10_000):
        yield actions.rotate(side / 2.0 if k == 0 else side)
        yield actions.go(500, 500, LONG_DEPTH_M)
        if k % 2 == 1:
            yield actions.finished()


def arc(seat: DroneContext) -> Iterator[str]:
    """Declare 12 m away in each third of the first picture; then fly the ring."""
    yield from turn(seat.aside_deg - 24.0)
    yield from long_strides(12.0)
    yield actions.finished()
    chord = 2.0 * 12.0 * math.sin(math.radians(12.0))
    for _ in range(2):
        yield from turn(90.0 + 12.0)
        yield from long_strides(chord + 0.1)
        yield from turn(-(90.0 - 12.0))
        yield actions.finished()
    yield from ring(DroneContext(0, 1, ""))


def wandering(draw: int = 1) -> Callable[[DroneContext], Iterator[str]]:
    """Return a pattern: stride, turn or declare at random. Drone, first prompt and `draw` determine the seed."""

    def fly(seat: DroneContext) -> Iterator[str]:
        seed = f"{seat.drone} {seat.prompt}" + (f" {draw}" if draw > 1 else "")
        rng = random.Random(hashlib.sha256(seed.encode()).digest())
        while True:
            yield rng.choices(
                (
                    actions.go(500, 500, LONG_DEPTH_M),
                    actions.go(rng.uniform(100, 900), 500, LONG_DEPTH_M),
                    actions.rotate(rng.uniform(-VIEW_DEG, VIEW_DEG)),
                    actions.finished(),
                ),
                weights=(4, 2, 1, 3),
            )[0]

    return fly


RANDOM = "random"  # prefix of the names of the random patterns
PATTERNS = {
    "declare": Pattern("declares again and again at its start place", declaring),
    "straight": Pattern("flies straight on in strides of 1.2 m and declares after each", straight()),
    "straight-16": Pattern("flies 12 m straight on, then declares after every 1.2 m (16 m)", straight(from_m=12.0)),
    "right-60": Pattern("turns 60° to the right, then as `straight`", straight(60.0)),
    "right-90": Pattern("turns 90° to the right, then as `straight`", straight(90.0)),
    "left-90": Pattern("turns 90° to the left, then as `straight`", straight(-90.0)),
    "back": Pattern("turns round, then as `straight`", straight(180.0)),
    "right-90-16": Pattern("turns 90° to the right, then as `straight-16` (16 m)", straight(90.0, 12.0)),
    "back-16": Pattern("turns round, then as `straight-16` (16 m)", straight(180.0, 12.0)),
    RANDOM: Pattern("moves, turns and declares at random", wandering()),
    **{f"{RANDOM}-{k}": Pattern(f"as `{RANDOM}`, with other random numbers", wandering(k)) for k in range(2, 6)},
    "fan": Pattern("flies out and back along rays 30° apart and declares on the way out", fan, sweeps=True),
    "spiral": Pattern("flies a square spiral with arms 6 m apart and declares after every 3 m", spiral, sweeps=True),
    "ring": Pattern("flies out 15 m and round the start, and declares after every 6 m (16 m)", ring, sweeps=True),
    "arc": Pattern(
        "declares once in each third of the first picture, 12 m out; then as `ring` (16 m)", arc, sweeps=True
    ),
}


def answer(prompt: str, images: list[bytes]) -> str:
    """Return the next actions of the pilot `blind`: think, go, rotate, go … Each drone alternates on its own."""
    briefing = actions.read_prompt(prompt)
    return actions.join([_next_action(briefing.past(k)) for k in range(max(1, len(images)))])


def _next_action(past: tuple[actions.PastAction, ...]) -> str:
    if not past:
        return actions.think()
    if past[-1].kind == GO:
        return actions.rotate(_TURN_DEG)
    return actions.go(500, 500, LONG_DEPTH_M)


def pattern_pilot(name: str) -> Pilot:
    """Return the pilot that flies a pattern in one flight. Raises KeyError for an unknown name."""
    pattern = PATTERNS[name]
    drones: list[Iterator[str]] = []

    def reply_to(prompt: str, images: list[bytes]) -> str:
        while len(drones) < max(1, len(images)):
            drones.append(pattern.fly(DroneContext(len(drones), max(1, len(images)), prompt)))
        return actions.join([next(drone) for drone in drones])

    return reply_to


_PLACE = re.compile(rf"look at the ({'|'.join(ORDINALS)}) one from the left\b", re.IGNORECASE)
CANDIDATES = 4  # number of look-alike things (one is the target) in every commanding episode
_DRONE = re.compile(r"^Drone (\d+)$")
_STALLED = re.compile(r"^Drone (\d+) has not moved\b", re.MULTILINE)


def goal_text(command: str, place: int) -> str:
    """Return the goal of a drone: the command and a candidate, named by its place from the left (counted from 1)."""
    return f"{command}: look at the {ORDINALS[place - 1]} one from the left"


def place_in_goal(command: str) -> int | None:
    """Return the place from the left (counted from 1) of the candidate in a goal; None if the goal names none."""
    match = _PLACE.search(command)
    return ORDINALS.index(match[1].lower()) + 1 if match else None


def scripted_orders(prompt: str, images: list[bytes]) -> str:
    """Return the orders of the scripted commander, which sends each drone to one of the look-alike candidates.

    Every drone without a candidate gets a candidate. Every stalled drone gets the next candidate, if possible a free
    one. All waiting reports of arrival are confirmed.
    """
    command = actions.read_prompt(prompt).command
    goals, waiting = read_roster(prompt)
    stalled = {int(number) for number in _STALLED.findall(prompt)}
    taken = {place for goal in goals.values() if (place := place_in_goal(goal)) is not None}
    orders = []
    for drone, goal in goals.items():
        place = place_in_goal(goal)
        if place is None:
            place = (drone - 1) % CANDIDATES + 1
        elif drone in stalled:
            next_places = [(place + k) % CANDIDATES + 1 for k in range(CANDIDATES)]
            place = next((p for p in next_places if p not in taken), next_places[0])
        else:
            continue
        taken.add(place)
        orders.append({"drone": drone, "goal": goal_text(command, place)})
    return json.dumps({"orders": orders, "confirm": waiting})


def read_roster(prompt: str) -> tuple[dict[int, str], list[int]]:
    """Return, from a commander's prompt, the goals by drone number, and the drones whose report needs an answer."""
    goals: dict[int, str] = {}
    waiting: list[int] = []
    drone = 0
    for line in prompt.splitlines():
        if heading := _DRONE.match(line):
            drone = int(heading[1])
        elif drone and line.startswith("- goal,"):
            goals[drone] = line.partition(": ")[2]
        elif drone and line.startswith("- report: says that it has arrived"):
            waiting.append(drone)
    return goals, waiting


@dataclass(frozen=True, slots=True)
class ScriptedReply:
    """The required fields of a row in a replies file (decisions.jsonl). Such a file can be written by hand."""

    step: Whole
    reply: str  # text of the reply; one text for all drones of a fleet


def replies(path: Path) -> list[str]:
    """Return the replies of a decisions.jsonl, one per step. Raises UsageError for a file without decisions."""
    by_step: dict[int, str] = {}
    for row in rows(path, ScriptedReply):
        by_step.setdefault(row.step, row.reply)
    if not by_step:
        raise UsageError(f"{path} has no decision. Give the {DECISIONS} of a flight with decisions")
    return [by_step[step] for step in sorted(by_step)]


def player(path: Path) -> Pilot:
    """Return the pilot that gives the replies of a file in order, then `think` at every step."""
    remaining = iter(replies(path))

    def answer(prompt: str, images: list[bytes]) -> str:
        return next(remaining, actions.join([actions.think()] * max(1, len(images))))

    return answer
