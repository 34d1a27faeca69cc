"""A study that was flown, as the analysis takes it: every flight with its levels, and what may be paired with what."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from dronecats.report.results.collection import ScoredEpisode

StudiedLevel = float | str  # of a factor: a number in its unit, or a word
ALL = "all cells"
MANY = 12  # levels of a factor, from which on neighbours are told together, as of a Latin hypercube


@dataclass(frozen=True, slots=True)
class StudiedFactor:
    """What was varied."""

    name: str  # latency, wind, …
    unit: str  # of its levels; empty: a ratio, a count or words
    levels: tuple[StudiedLevel, ...]  # as the study has them
    reference: StudiedLevel  # one of them, with which the others are compared

    @property
    def numeric(self) -> bool:
        """Whether its levels are numbers, along which a line can be fitted."""
        return all(isinstance(level, float) for level in self.levels)

    @property
    def title(self) -> str:
        """Its name as a head, with its unit: Latency (s)."""
        name = self.name.replace("_", " ").replace(".", " ")
        return f"{name[:1].upper()}{name[1:]}{f' ({self.unit})' if self.unit else ''}"

    def told(self, level: StudiedLevel) -> str:
        """Return a level as people read it: 0.5 s."""
        return level if isinstance(level, str) else f"{self.short(level)}{f' {self.unit}' if self.unit else ''}"

    def short(self, level: float) -> str:
        """Return a number as people read it, without its unit; of many levels, as drawn from a range, three digits."""
        return f"{float(f'{level:.3g}') if len(self.levels) > MANY else level:g}"


@dataclass(frozen=True, slots=True)
class StudiedFlight:
    """One flight of one episode under one choice of levels."""

    entrant: str  # label of who flew
    levels: tuple[StudiedLevel, ...]  # one a factor, in their order
    number: int  # of the flight: the same at every level has the same seed
    scored: ScoredEpisode

    @property
    def pair(self) -> tuple[str, int]:
        """By which it is paired with a flight of other levels, or of another entrant: the episode and the number."""
        return self.scored.episode, self.number


@dataclass(frozen=True)
class Studied:
    """All flights of a study."""

    name: str
    design: str
    factors: tuple[StudiedFactor, ...]
    entrants: tuple[str, ...]  # labels, in the order in which they were flown
    cells: tuple[str, ...]  # that were flown, in the grid's order
    flights: tuple[StudiedFlight, ...]
    planned: int  # flights that belong to it; flown ones may be fewer
    notes: tuple[str, ...] = ()  # what keeps entrants from being quite comparable, a sentence each

    @cached_property
    def scored(self) -> tuple[StudiedFlight, ...]:
        """The flights that count."""
        return tuple(each for each in self.flights if each.scored.scored)

    @property
    def groups(self) -> tuple[str, ...]:
        """What numbers are told of: all cells together where there are several, and each of them."""
        return (ALL, *self.cells) if len(self.cells) > 1 else self.cells

    def of(self, entrant: str, cell: str = ALL) -> tuple[StudiedFlight, ...]:
        """Return the flights that count of one entrant, of one cell or of all."""
        return tuple(f for f in self.scored if f.entrant == entrant and cell in (ALL, f.scored.cell))

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield (entrant, cell or ALL) of everything that numbers are told of and that was flown."""
        for entrant in self.entrants:
            for cell in self.groups:
                if self.of(entrant, cell):
                    yield entrant, cell


def comparable(flights: Sequence[StudiedFlight], factor: int) -> list[StudiedFlight]:
    """Return those at whose choice of the other factors this one was flown at several levels; all, where none was.

    So a factor of a full design is seen over all of them, one of a design of one factor at a time from its base, and
    one of a fraction or a Latin hypercube over all, where chance and the design balance the others.
    """
    seen: dict[tuple[StudiedLevel, ...], set[StudiedLevel]] = {}
    for each in flights:
        seen.setdefault(others(each, factor), set()).add(each.levels[factor])
    some = [each for each in flights if len(seen[others(each, factor)]) > 1]
    return some or list(flights)


def others(flight: StudiedFlight, factor: int) -> tuple[StudiedLevel, ...]:
    """Return the levels of all factors but one."""
    return flight.levels[:factor] + flight.levels[factor + 1 :]


def by_episode(flights: Sequence[StudiedFlight]) -> dict[str, list[StudiedFlight]]:
    """Return the flights of each episode, by its id, episodes by name and flights by number."""
    found: dict[str, list[StudiedFlight]] = {}
    for each in sorted(flights, key=lambda each: (*each.pair, str(each.levels))):
        found.setdefault(each.scored.episode, []).append(each)
    return found
