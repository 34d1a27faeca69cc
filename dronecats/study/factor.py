"""What a factor is: something about a flight that a study sets to one level after another."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level

SAID = ".12g"  # as numbers are written into names and policies


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """One of them. `put` is pure: a flight and a level give the flight at that level, or UsageError."""

    name: str  # as files and options have it
    unit: str  # of its levels, "" where they have none
    what: str  # it is, for people
    sets: str  # what of a flight it decides: of the factors that set the same, a study has one
    put: Callable[[FlightSpec, Level], FlightSpec]
    span: tuple[float, float] | None = None  # the range of a number, both ends included; …
    whole: bool = False  # whole numbers only
    words: Sequence[str] | None = None  # … and what a word may be. None of both: any word
    real_time: bool = False  # says nothing of a flight in lockstep

    @property
    def numeric(self) -> bool:
        """Whether its levels are numbers."""
        return self.span is not None

    def level(self, value: object) -> Level:
        """Return a value as a level. Raises UsageError for what is none, in one sentence."""
        if self.span is None:
            if not isinstance(value, str) or not value or (self.words is not None and value not in self.words):
                wanted = f"one of {', '.join(self.words)}" if self.words else "a word"
                raise UsageError(f"{self.name} wants {wanted}, got {value!r:.60}")
            return value
        low, high = self.span
        number = _number(value)
        if number is None or not low <= number <= high or (self.whole and number != int(number)):
            kind = "a whole number" if self.whole else "a number"
            unit = f" {self.unit}" if self.unit else ""
            raise UsageError(f"{self.name} wants {kind} from {low:g} to {high:g}{unit}, got {value!r:.60}")
        return int(number) if self.whole else number

    def at(self, flight: FlightSpec, level: Level) -> FlightSpec:
        """Return the flight at a level. Raises UsageError naming the factor where that does not go with the rest."""
        if self.real_time and flight.simulated is not None and flight.simulated.speed is None:
            raise UsageError(f"{self.name} goes with --speed N: in lockstep the clock waits for everybody")
        try:
            return self.put(flight, level)
        except (UsageError, ValueError) as wrong:  # the latter of a flight that contradicts itself
            raise UsageError(f"{self.name} at {said(level)}: {wrong}") from None


def said(level: Level) -> str:
    """Return a level as a name or a policy has it."""
    return level if isinstance(level, str) else format(level, SAID)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except (ValueError, OverflowError):
        return None
