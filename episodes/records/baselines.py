"""What the oracle and the blind pilots came to on each shipped episode, kept by `dronecats episodes audit`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from msgspec import Meta

from foundation.typed_file import file_bytes, json_of, typed

PAR = Path(__file__).parent / "par.json"
BLIND = Path(__file__).parent / "blind.json"

FlightCount = Annotated[int, Meta(ge=0)]
Pars = dict[str, Annotated[int, Meta(gt=0)]]  # episode → steps that the oracle takes
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class BlindFlight:
    """One blind flight of the full time."""

    success: bool
    first: bool  # its first declaration was true
    within_three: bool  # one of its first three was
    declarations: FlightCount
    false_declarations: FlightCount
    steps: FlightCount

    def __post_init__(self) -> None:
        """Raise ValueError for what cannot be."""
        if not self.first <= self.within_three <= self.success or self.false_declarations > self.declarations:
            raise ValueError(f"no flight is {self}")


BlindTable = dict[str, dict[str, BlindFlight]]  # pilot → episode → flight


def load_par(file: Path = PAR) -> Pars:
    """Return the pars; none when the audit has not been run. Raises UsageError for what is no such table."""
    return _kept(file, Pars)


def load_blind(file: Path = BLIND) -> BlindTable:
    """Return the blind flights; none when none has been flown. Raises UsageError for what is no such table."""
    return _kept(file, BlindTable)


def merged(table: BlindTable, pilot: str, flights: dict[str, BlindFlight], known: list[str]) -> dict[str, Any]:
    """Return the table as JSON with these flights of a pilot; those of it that were not flown again are kept."""
    flown = {**table, pilot: {**table.get(pilot, {}), **flights}}
    return {
        name: {episode: asdict(flown[name][episode]) for episode in known if episode in flown[name]}
        for name in sorted(flown)
    }


def _kept(file: Path, kind: type[T]) -> T:
    return typed(json_of(file_bytes(file, file.name), file.name) if file.exists() else {}, kind, file.name)
