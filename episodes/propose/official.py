"""How the shipped catalogue was made: `dronecats episodes new --official` makes the same bytes again.

Six residential records were placed by hand before there was a search and stay as they are: the first three of
approaching and the first of each other one-drone cell.
"""

from collections.abc import Iterator

from episodes import catalogue
from episodes.processes import share_out
from episodes.propose.proposals import Batch, propose
from episodes.record import EpisodeRecord

BY_HAND = (
    "residential-approaching-01",
    "residential-approaching-02",
    "residential-approaching-03",
    "residential-searching-01",
    "residential-tracking-01",
    "residential-search-and-track-01",
)

BATCHES = (
    Batch("residential", "approaching", 4, 7, 1),
    Batch("residential", "searching", 2, 9, 1),
    Batch("residential", "tracking", 2, 9, 1),
    Batch("residential", "search-and-track", 2, 9, 1),
    Batch("residential", "commanding", 1, 10, 1),
    Batch("campus", "approaching", 1, 10, 1),
    Batch("campus", "searching", 1, 10, 1),
    Batch("campus", "tracking", 1, 10, 1),
    Batch("campus", "search-and-track", 1, 10, 1),
    Batch("blocks", "commanding", 1, 10, 1),
)


def make(jobs: int | None = None) -> Iterator[list[EpisodeRecord]]:
    """Yield the records of the catalogue, a batch as it is done, those placed by hand first, on `jobs` processes."""
    yield [catalogue.load(name) for name in BY_HAND]
    yield from share_out(propose, BATCHES, jobs)
