"""What the blind pilots came to on each shipped episode, kept by `dronecats episodes audit --write-blind`."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

FILE = Path(__file__).parent / "blind.json"


@dataclass(frozen=True, slots=True)
class BlindFlight:
    """One blind flight of the full time."""

    success: bool
    first: bool  # its first declaration was true
    within_three: bool  # one of its first three was
    declarations: int
    false_declarations: int
    steps: int

    def __post_init__(self) -> None:
        """Raise ValueError for what cannot be."""
        counts = (self.declarations, self.false_declarations, self.steps)
        sound = all(type(count) is int and count >= 0 for count in counts) and all(
            type(told) is bool for told in (self.success, self.first, self.within_three)
        )
        ordered = sound and self.first <= self.within_three <= self.success
        if not ordered or self.false_declarations > self.declarations:
            raise ValueError(f"no flight is {self}")


Table = dict[str, dict[str, BlindFlight]]  # pilot → episode → flight


def load(file: Path = FILE) -> Table:
    """Return pilot → episode → flight; empty when none has been flown. Raises ValueError for what is no such table."""
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
        return {
            pilot: {episode: BlindFlight(**flight) for episode, flight in flights.items()}
            for pilot, flights in table.items()
        }
    except FileNotFoundError:
        return {}
    except (AttributeError, TypeError, ValueError) as wrong:
        raise ValueError(f"{file.name} is not a table of pilots, episodes and flights: {wrong}") from None


def merged(table: Table, pilot: str, flights: dict[str, BlindFlight], known: list[str]) -> dict[str, Any]:
    """Return the table as JSON with these flights of a pilot; those of it that were not flown again are kept."""
    flown = {**table, pilot: {**table.get(pilot, {}), **flights}}
    return {
        name: {episode: asdict(flown[name][episode]) for episode in known if episode in flown[name]}
        for name in sorted(flown)
    }
