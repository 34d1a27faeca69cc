"""How the shipped catalogue was made: `dronecats episodes new --official` makes the same bytes again.

Nothing in it is placed by hand but one target: the cyan SUV of the first flight, with the place that it is looked at
from. Which way the drone looks there is drawn as for all others. The seeds are the first with which each request
fulfils the rules about the suite (`episodes.authoring.check.spread`) as well.
"""

from collections.abc import Iterator

from episodes.authoring.processes import share_out
from episodes.authoring.propose.proposals import RecordRequest, propose
from episodes.records.record import EpisodeRecord

REQUESTS = (
    RecordRequest("residential", "approaching", 1, 10, 12, kept="v1-residential-approaching-01"),
    RecordRequest("residential", "searching", 1, 10, 1),
    RecordRequest("residential", "tracking", 1, 10, 3),
    RecordRequest("residential", "search-and-track", 1, 10, 1),
    RecordRequest("residential", "commanding", 1, 10, 1),
    RecordRequest("campus", "approaching", 1, 10, 1),
    RecordRequest("campus", "searching", 1, 10, 1),
    RecordRequest("campus", "tracking", 1, 10, 1),
    RecordRequest("campus", "search-and-track", 1, 10, 1),
    RecordRequest("blocks", "commanding", 1, 10, 1),
)


def make(jobs: int | None = None) -> Iterator[list[EpisodeRecord]]:
    """Yield the records of the catalogue, a request as it is done, on `jobs` processes."""
    yield from share_out(propose, REQUESTS, jobs)
