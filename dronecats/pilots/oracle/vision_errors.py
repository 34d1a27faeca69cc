"""How often and how far the vision pilot is wrong, in numbers fitted to its own flights.

At each step it takes the target for the target, or something else, or nothing. Which, depends on what it took at the
step before, and of a target that is seen on how far off that is. Flights that it lost are a class of their own, drawn
once per flight: what it mistakes, it mistakes for a whole flight.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

Telling = Literal["paint", "place", "inscription"]  # what a command tells the target by, and so how vision looks for it
BANDS_M = (8.0, 16.0)  # m, between the three bands of distance: near, middle, far
FILE = Path(__file__).with_suffix(".json")


def band(distance_m: float) -> int:
    """Return which band of distance this is: 0 near, 1 middle, 2 far."""
    return sum(distance_m >= edge for edge in BANDS_M)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attention:
    """What is taken for the target, as shares of the steps."""

    found: tuple[float, float, float]  # by band: the target, where it is seen and was not taken for it just before
    kept: tuple[float, float, float]  # by band: the target, where it is seen and was
    strays: float  # where the target is not taken: something else, and there was nothing of the kind before
    stays: float  # likewise, and there was
    claims: float  # where something else was taken before and the target is not: it is declared to be the target


@dataclass(frozen=True, slots=True, kw_only=True)
class EyeErrors:
    """Of one way of telling the target."""

    flights: int  # that this is fitted to
    mistaken: float  # share of flights that are of the second class
    sure: Attention  # of flights that reached the target
    lost: Attention  # and of those that did not
    aside_px: float  # px, standard deviation of a point's error, of a picture 1280 wide
    above_px: float  # px
    depth: float  # mean of the logarithm of told depth over the depth of the target's centre
    depth_flight: float  # standard deviation of that mean between flights
    depth_step: float  # and about it, between the steps of a flight
    astray_m: float  # m, the median depth that is told of something else
    astray: float  # standard deviation of that depth's logarithm


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionErrors:
    """All of them, and what they were fitted to."""

    fitted_to: str  # the run folder's name
    code_sha256: str  # of the code that flew it
    eyes: dict[Telling, EyeErrors]


@cache
def shipped() -> VisionErrors:
    """Return the numbers that ship."""
    return msgspec.json.decode(FILE.read_bytes(), type=VisionErrors)
