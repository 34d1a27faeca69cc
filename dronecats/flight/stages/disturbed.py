"""A flight's wires and setpoint rate, disturbed from the moment at which its episode begins until it is over.

Before and after, the wire is a perfect one: so the start is the same whatever is studied, and the way down is no part
of it. Air and sensors begin to be disturbed at the same moment, in the simulator; a payload is there from boot.
"""

import math
from collections.abc import Sequence
from typing import Protocol

from dronecats.flight.disturbances import UNDISTURBED
from dronecats.flight.sitl.scenario import noise_seed
from dronecats.flight.spec.flight import Flight
from hil.impairment import Impairment
from hil.link.conversation import SILENCE_S
from hil.link.link import Link


class ImpairableWire(Protocol):
    """Perfect until it is told otherwise."""

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """From now on and for so long (s of vehicle time) be impaired: `up` to the vehicle, `down` from it."""
        ...


class DisturbedLinks:
    """The links of a flight whose wires are disturbed, or none of them."""

    def __init__(self, flight: Flight) -> None:
        self._disturbances, self._seconds = flight.spec.disturbances, flight.spec.seconds
        self._seed = flight.seed
        self._wires: list[ImpairableWire] = []
        self._links: Sequence[Link] = ()

    @property
    def wired(self) -> bool:
        """Whether the links need wires that can be impaired."""
        return self._disturbances.link != UNDISTURBED.link

    @property
    def silence_s(self) -> float:
        """s of vehicle time without a word after which a vehicle is gone; a bad wire may keep silent to the end."""
        return SILENCE_S + (2.0 * self._seconds if self.wired else 0.0)

    def seed(self, drone: int) -> int:
        """Return the seed of a drone's wire."""
        record, flight = self._seed
        return noise_seed(record, flight, drone)

    def take(self, links: Sequence[Link], wires: Sequence[ImpairableWire]) -> None:
        """Take what will be disturbed."""
        self._links, self._wires = links, list(wires)

    def begin(self, seconds: float = math.inf) -> None:
        """Disturb from now on, for so long at most (s of vehicle time)."""
        link = self._disturbances.link
        for wire in self._wires:
            wire.impair(link.to_vehicle, link.from_vehicle, seconds)
        for each in self._links:
            each.behind_us = round(link.from_vehicle.delay_s * 1e6)
            if (hz := self._disturbances.vehicle.setpoint_hz) is not None:
                each.stream_at(hz)

    def mend(self) -> None:
        """Disturb the wires no more; setpoints go on being sent as often as they were."""
        for wire in self._wires:
            wire.impair(Impairment(), Impairment(), math.inf)
        for each in self._links:
            each.behind_us = 0
