"""Make the training episodes: `python -m examples.action_head.records --out runs/learnt/records`.

Their maps have other seeds than the benchmark's maps, so no record is in the benchmark. The seed changes the plants
and, in residential, also the houses and most parked cars. The roads, the plots and the sites of the halls stay.
"""

import argparse
import math
from collections.abc import Iterable
from pathlib import Path

from dronecats.cli.exit_status import exit_status
from episodes.authoring.processes import process_map
from episodes.authoring.propose.proposals import RecordRequest, propose
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from foundation.errors import UsageError
from foundation.files import file_errors_as

CELLS = ("approaching", "searching", "tracking", "search-and-track")  # kinds of task in the benchmark
FIRST_ID = 11  # ids continue after the ten shipped records of each cell
FIRST_MAP_SEED = 2  # the benchmark's maps have the seed 1
BATCH = 4  # number of records that one request makes, all on one map
REQUESTS = {"residential": 20, "campus": 8}  # map → number of requests for each cell, each with another map seed
_APART_M = 0.5  # two starts that are nearer to each other than this count as the same place


def requests(share: float = 1.0) -> list[RecordRequest]:
    """Return the first `share` (above 0, up to 1) of the requests. Any share has all maps and cells."""
    turns = math.ceil(max(REQUESTS.values()) * share)
    return [
        RecordRequest(name, cell, FIRST_ID + BATCH * turn, BATCH, 1000 + turn, FIRST_MAP_SEED + turn)
        for turn in range(turns)
        for name, most in REQUESTS.items()
        for cell in CELLS
        if turn < most
    ]


def must_be_new(records: Iterable[EpisodeRecord]) -> None:
    """Raise UsageError if a record equals a shipped one in map and map seed, in seed, or in start and instruction."""
    shipped = [catalogue.load(name) for name in catalogue.all_ids()]
    maps, seeds = {(episode.map, episode.map_seed) for episode in shipped}, {episode.seed for episode in shipped}
    for record in records:
        if (record.map, record.map_seed) in maps:
            raise UsageError(f"{record.id} is on a map of the benchmark. Choose another map seed.")
        if record.seed in seeds:
            raise UsageError(f"{record.id} has the seed of a shipped record. Choose another seed.")
        if any(_same_place(record, episode) for episode in shipped):
            raise UsageError(f"{record.id} has the start and the instruction of a shipped record. Choose another seed.")


def _same_place(record: EpisodeRecord, shipped: EpisodeRecord) -> bool:
    pairs = zip(record.starts, shipped.starts, strict=False)
    near = any(math.dist(start.position_ned, shipped_start.position_ned) < _APART_M for start, shipped_start in pairs)
    return near and (record.map, record.instruction) == (shipped.map, shipped.instruction)


def write(out: Path, share: float, jobs: int) -> int:
    """Write the records to a folder and return their number. The same arguments give the same files.

    Each map has its own folder, so that the records are flown map by map and each map is built once.

    Raises UsageError if the folder cannot be written, or if a record is in the benchmark.
    """
    count = 0
    for batch in process_map(propose, requests(share), jobs):
        must_be_new(batch)
        for record in batch:
            folder = out / f"{record.map_seed:02d}-{record.map}"
            with file_errors_as(UsageError, f"'{folder}' cannot be created", "."):
                folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{record.id}.json").write_text(record.to_json(), encoding="utf-8")
            count += 1
        print(f"{count} records; {batch[-1].id}: {batch[-1].instruction}", flush=True)
    return count


def main(words: list[str] | None = None) -> int:
    """Read the command line and write the records."""
    parser = argparse.ArgumentParser(prog="python -m examples.action_head.records", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the record files")
    parser.add_argument(
        "--share", type=float, default=1.0, metavar="X", help="share of the records to make, 0 … 1 (default 1)"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="J", help="processes (default 2)")
    args = parser.parse_args(words)
    if not 0.0 < args.share <= 1.0:
        raise UsageError(f"--share must be above 0 and at most 1, got {args.share:g}.")
    if args.jobs < 1:
        raise UsageError(f"--jobs must be 1 or more, got {args.jobs}.")
    write(args.out, args.share, args.jobs)
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("action_head", main))
