"""`dronecats bench export-parquet RUN… --out DIR`: runs as Parquet files, one a table of docs/query.md."""

import argparse
import json
import sys
from pathlib import Path

ACTION = "export-parquet"


def run(args: argparse.Namespace) -> int:
    """Write the files and print how many rows each has; status 0, damaged episodes named on standard error.

    The runs are what stands behind the action among the verb's episodes. Raises UsageError.
    """
    from dronecats.report.recorded.run import recorded_runs
    from dronecats.report.results.database import write_tables
    from foundation.errors import UsageError

    runs = [Path(each) for each in args.episodes[1:]]
    if not runs or args.out is None:
        raise UsageError(f"{ACTION} wants run folders, or folders of runs, and --out DIR for the files")
    rows, damage = write_tables("parquet", recorded_runs(runs), args.out)
    for said in damage:
        print(f"dronecats bench: left out but for its row in episodes: {said}", file=sys.stderr)
    if args.json:
        print(json.dumps({"rows": rows, "damaged": damage, "out": str(args.out)}))
    else:
        for table, count in rows.items():
            print(f"{args.out / f'{table}.parquet'}  {count} rows")
    return 0
