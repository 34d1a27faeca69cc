"""`dronecats episodes new`: proposes records that pass the checks, from a seed."""

import argparse
from pathlib import Path


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("new", help="propose records that pass the checks, from a seed")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the record files")
    parser.add_argument("--map", metavar="NAME", help="a map's name")
    parser.add_argument("--cell", metavar="CELL", help="approaching, searching, tracking, search-and-track, commanding")
    parser.add_argument("--count", type=int, default=1, metavar="N", help="how many (default: 1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the same seed gives the same records")
    parser.add_argument(
        "--first", type=int, metavar="N", help="number in the first record's id (default: the next after what ships)"
    )
    parser.add_argument("--map-seed", type=int, default=1, metavar="N", help="the map's own seed (default: 1)")
    parser.add_argument("--official", action="store_true", help="instead of all that: make the shipped catalogue again")
    parser.add_argument(
        "--jobs", type=int, default=0, metavar="N", help="processes for --official (default: one per core)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the records and print their files."""
    from episodes.authoring.propose import proposals
    from foundation.errors import UsageError

    if args.official:
        if args.map or args.cell:
            raise UsageError("--official makes every map and cell: leave --map and --cell out.")
        batches = proposals.make(args.jobs or None)
    else:
        if not (args.map and args.cell):
            raise UsageError("choose a map and a cell: --map residential --cell approaching, for example.")
        first = proposals.first_free(args.map, args.cell) if args.first is None else args.first
        task = proposals.RecordRequest(args.map, args.cell, first, args.count, args.seed, args.map_seed)
        proposals.must_be_possible(task)
        batches = (proposals.propose(each) for each in [task])
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out '{args.out}' cannot be made a folder: {error.strerror}.") from None
    for batch in batches:
        for record in batch:
            file = args.out / f"{record.id}.json"
            _write(file, record.to_json(), replace=args.official)
            print(f"{file}  {record.instruction}", flush=True)
    return 0


def _write(file: Path, text: str, replace: bool) -> None:
    """Write a record. Raises UsageError for a file that holds another one, unless `replace`, or cannot be written."""
    from foundation.errors import UsageError

    try:
        if not replace and file.exists() and file.read_bytes() != text.encode():
            raise UsageError(f"'{file}' holds another record: choose another --out or --first.")
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"'{file}' cannot be written: {error.strerror}.") from None
