"""What the search hands on to be checked."""

import random
from dataclasses import dataclass

from episodes.authoring.check.framing import Framing, across, away
from episodes.records.record import HIDDEN, MAX_SEED, StartPose, TargetRecord
from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class Proposal:
    """A record without its name and its derived numbers."""

    target: TargetRecord
    place_ned: Vec3  # m, where the target is at the beginning
    goal_ned: Vec3  # m, the middle of its box then
    starts: tuple[StartPose, ...]
    visible: bool
    instruction: str
    seed: int  # of everything random in the flight
    candidates: tuple[TargetRecord, ...] = ()


def yaw_deg(cell: str, ahead_deg: float, framed: Framing, share: float) -> float | None:
    """Return the yaw of a start, at a share (0 … 1) of those that show the target whole, or that hide it.

    None when there is no such yaw.
    """
    off = away(framed, share) if cell in HIDDEN else across(framed, share)
    return None if off is None else ahead_deg + off


def flight_seed(rng: random.Random) -> int:
    """Return the seed of a flight."""
    return rng.randrange(1, MAX_SEED)
