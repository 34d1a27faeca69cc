"""The patterns that blind pilots fly, each as strong as one can be made that does not look.

What they know is what is published: that a stride is 3 m, or 1.2 m for a depth of 2 m; that 5 m count as arrival; that
a camera sees 90°. Those marked `16 m` know the residential map's start distance, too, and spend their declarations only
where a target can be. A pattern goes on for ever; the episode's time ends it.
"""

import hashlib
import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from dronecats.pilots import reply
from foundation.protocol import BRAKE_M, STRIDE_MAX_M, STRIDE_MIN_M

LONG_M, LONG_DEPTH_M = STRIDE_MAX_M, 6.0  # the longest stride, and a depth that is flown so
SHORT_M, SHORT_DEPTH_M = STRIDE_MIN_M, BRAKE_M  # the shortest, flown 0.6 of its depth
START_M = 16.0  # of every residential start from its target
VIEW_DEG = 90.0


@dataclass(frozen=True, slots=True)
class Seat:
    """Whom a pattern flies."""

    drone: int  # its place in the picture order
    drones: int  # 1, or a fleet's number
    prompt: str  # of the first step; what it says is not used, only that it is another in another episode

    @property
    def aside_deg(self) -> float:
        """Return how far to the right this drone of a fleet turns, so that the fleet fans out over the picture."""
        return 0.0 if self.drones == 1 else VIEW_DEG * ((self.drone + 0.5) / self.drones - 0.5)


@dataclass(frozen=True, slots=True)
class Pattern:
    """One blind pilot."""

    says: str  # what it does, in one sentence
    fly: Callable[[Seat], Iterator[str]]
    sweeps: bool = False  # covers an area; the others follow one line


def long_strides(metres: float) -> Iterator[str]:
    """Yield strides of 3 m that come as near to a distance (m) as whole strides of 3 m and 1.2 m do from below."""
    far = int(metres // LONG_M)
    yield from [reply.go(500, 500, LONG_DEPTH_M)] * far
    yield from [reply.go(500, 500, SHORT_DEPTH_M)] * int((metres - far * LONG_M) // SHORT_M)


def turn(degrees: float) -> Iterator[str]:
    """Yield the turns, of 90° at most, that make up an angle."""
    while abs(degrees) > 1e-6:
        part = max(-VIEW_DEG, min(VIEW_DEG, degrees))
        yield reply.rotate(part)
        degrees -= part


def creeping() -> Iterator[str]:
    """Yield short strides for ever, with a declaration after each."""
    while True:
        yield reply.go(500, 500, SHORT_DEPTH_M)
        yield reply.finished()


def straight(after_deg: float = 0.0, from_m: float = 0.0) -> Callable[[Seat], Iterator[str]]:
    """Return the pattern: turn, fly so many metres without a word, then stride and declare for ever."""

    def fly(seat: Seat) -> Iterator[str]:
        yield from turn(after_deg + seat.aside_deg)
        yield from long_strides(from_m)
        if from_m:
            yield reply.finished()
        yield from creeping()

    return fly


def declaring(seat: Seat) -> Iterator[str]:
    """Declare where it stands, for ever."""
    while True:
        yield reply.finished()


def fan(seat: Seat) -> Iterator[str]:
    """Fly out and back along one ray after the other, declaring on the way out, beginning with those in view."""
    yield from turn(seat.aside_deg)
    spread = 30.0 if seat.drones == 1 else VIEW_DEG / seat.drones / 2.0
    for far in (18.0, 36.0):
        before = 0.0
        for ray in (0.0, spread, -spread, *(sign * k * 30.0 for k in (2, 3, 4, 5) for sign in (1, -1)), 180.0):
            yield from turn(math.remainder(ray - before, 360.0))
            for _ in range(round(far / LONG_M)):
                yield reply.go(500, 500, LONG_DEPTH_M)
                yield reply.finished()
            yield from turn(180.0)
            yield from long_strides(far)
            before = ray + 180.0
    yield from creeping()


def spiral(seat: Seat) -> Iterator[str]:
    """Fly a square spiral outwards, its arms 6 m apart, declaring after each long stride."""
    yield from turn(seat.aside_deg)
    legs = 2
    while True:
        for _ in range(2):
            for _ in range(legs):
                yield reply.go(500, 500, LONG_DEPTH_M)
                yield reply.finished()
            yield reply.rotate(90.0)
        legs += 2


def ring(seat: Seat) -> Iterator[str]:
    """Fly out 15 m and round the start, declaring every other stride: the circle on which a target 16 m away stands."""
    yield from turn(seat.aside_deg - 45.0)
    yield from long_strides(15.0)
    yield reply.finished()
    yield from turn(90.0)
    side = math.degrees(2.0 * math.asin(LONG_M / (2.0 * 15.0)))
    for k in range(10_000):
        yield reply.rotate(side / 2.0 if k == 0 else side)
        yield reply.go(500, 500, LONG_DEPTH_M)
        if k % 2 == 1:
            yield reply.finished()


def arc(seat: Seat) -> Iterator[str]:
    """Look into three sectors of the first picture from 12 m out and declare once in each; then go round the ring."""
    yield from turn(seat.aside_deg - 24.0)
    yield from long_strides(12.0)
    yield reply.finished()
    chord = 2.0 * 12.0 * math.sin(math.radians(12.0))
    for _ in range(2):
        yield from turn(90.0 + 12.0)
        yield from long_strides(chord + 0.1)
        yield from turn(-(90.0 - 12.0))
        yield reply.finished()
    yield from ring(Seat(0, 1, ""))


def wandering(seat: Seat) -> Iterator[str]:
    """Stride, turn or declare by lot, the lots drawn from the prompt's text."""
    lots = random.Random(hashlib.sha256(f"{seat.drone} {seat.prompt}".encode()).digest())
    while True:
        yield lots.choices(
            (
                reply.go(500, 500, LONG_DEPTH_M),
                reply.go(lots.uniform(100, 900), 500, LONG_DEPTH_M),
                reply.rotate(lots.uniform(-VIEW_DEG, VIEW_DEG)),
                reply.finished(),
            ),
            weights=(4, 2, 1, 3),
        )[0]


PATTERNS = {
    "declare": Pattern("declares where it stands, again and again", declaring),
    "straight": Pattern("flies straight on in strides of 1.2 m and declares after each", straight()),
    "straight-16": Pattern("flies 12 m straight on, then declares after every 1.2 m (16 m)", straight(from_m=12.0)),
    "right-60": Pattern("turns 60° to the right, then as `straight`", straight(60.0)),
    "right-90": Pattern("turns 90° to the right, then as `straight`", straight(90.0)),
    "left-90": Pattern("turns 90° to the left, then as `straight`", straight(-90.0)),
    "back": Pattern("turns round, then as `straight`", straight(180.0)),
    "right-90-16": Pattern("turns 90° to the right, then as `straight-16` (16 m)", straight(90.0, 12.0)),
    "back-16": Pattern("turns round, then as `straight-16` (16 m)", straight(180.0, 12.0)),
    "random": Pattern("strides, turns and declares by lot", wandering),
    "fan": Pattern("flies out and back along rays 30° apart and declares on the way out", fan, sweeps=True),
    "spiral": Pattern("flies a square spiral with arms 6 m apart and declares after every 3 m", spiral, sweeps=True),
    "ring": Pattern("flies out 15 m and round the start, and declares after every 6 m (16 m)", ring, sweeps=True),
    "arc": Pattern(
        "declares once in each third of the first picture, 12 m out; then as `ring` (16 m)", arc, sweeps=True
    ),
}
