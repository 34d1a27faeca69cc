"""Pilots that do not look: the floor of the benchmark.

Each flies a pattern that is settled before the first picture is taken. It counts its own steps, reads of the prompt no
more than which text it is (for the one that is random), and of the pictures how many there are: of their pixels
nothing. So whatever it scores, chance and the layout of the episodes have scored. `blind` alone never declares, which
shows what arrives by itself; the others declare, as often and as well as a pattern can.
"""

from collections.abc import Callable, Iterator

from dronecats.pilots import briefing, reply
from dronecats.pilots.scripted import patterns
from foundation.protocol import GO

_STRIDE_M = 6.0  # a `go` of 5 m or more is flown as a full 3 m step
_TURN_DEG = 60.0

Pilot = Callable[[str, list[bytes]], str]


def answer(prompt: str, images: list[bytes]) -> str:
    """Return the next action of the pattern think, go, rotate, go, rotate …; it depends on the last action alone."""
    told = briefing.read(prompt)
    return reply.fleet([_next(told.past(k)) for k in range(max(1, len(images)))])


def _next(past: tuple[briefing.PastAction, ...]) -> str:
    if not past:
        return reply.think()
    if past[-1].kind == GO:
        return reply.rotate(_TURN_DEG)
    return reply.go(500, 500, _STRIDE_M)


def pilot(name: str) -> Pilot:
    """Return the function (prompt, JPEGs) -> reply of one flight of a pattern. Raises KeyError for an unknown name."""
    pattern = patterns.PATTERNS[name]
    drones: list[Iterator[str]] = []

    def reply_to(prompt: str, images: list[bytes]) -> str:
        while len(drones) < max(1, len(images)):
            drones.append(pattern.fly(patterns.Seat(len(drones), max(1, len(images)), prompt)))
        return reply.fleet([next(drone) for drone in drones])

    return reply_to
