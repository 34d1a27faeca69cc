"""What flies the flights of a campaign: workers on this machine, or whatever else takes flights and gives results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.run_folder.results import Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """One flight, and where its files go."""

    flight: FlightSpec  # with the record of its episode
    folder: Path  # the episode's, prepared: there, and empty but for empty logs


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed:
    """A flight that is over."""

    sortie: Sortie
    result: Result  # whatever came of it: what the infrastructure broke has the outcome `error`


class Engine(Protocol):
    """Who flies does not decide what: a campaign begins flights, as many at a time as it wants in the air."""

    def begin(self, sortie: Sortie) -> None:
        """Begin a flight. Never waits for one. Raises DronecatsError when nothing can be flown any more."""
        ...

    def landed(self) -> Landed:
        """Wait for the next of the flights that were begun to be over, in whatever order they end, and return it.

        A worker that dies or hangs costs what it had in flight and no more. Raises DronecatsError as `begin`, and lets
        KeyboardInterrupt through.
        """
        ...

    def close(self) -> None:
        """Break off what is in flight, and leave no process behind."""
        ...
