"""What the search hands on to be checked."""

import random
from dataclasses import dataclass

from dronecats.border.frames import Vec3
from episodes.record import HIDDEN, Start, TargetRecord

YAW_OFF_DEG = 15.0  # from the target, at most, where it is to be seen at the start


@dataclass(frozen=True, slots=True)
class Draft:
    """A record without its name and its derived numbers."""

    target: TargetRecord
    place_ned: Vec3  # m, where the target is at the beginning
    goal_ned: Vec3  # m, the middle of its box then
    starts: tuple[Start, ...]
    visible: bool
    instruction: str
    seed: int  # of everything random in the flight
    candidates: tuple[TargetRecord, ...] = ()


def yaw_deg(cell: str, ahead_deg: float, rng: random.Random) -> float:
    """Return the yaw of a start: near the target's bearing, or 90° off where the cell withholds it."""
    if cell in HIDDEN:
        return ahead_deg + rng.choice((-90.0, 90.0))
    return ahead_deg + rng.uniform(-YAW_OFF_DEG, YAW_OFF_DEG)


def flight_seed(rng: random.Random) -> int:
    """Return the seed of a flight."""
    return rng.randrange(1, 100_000)
