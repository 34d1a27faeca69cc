"""`dronecats export RUN… --to FORMAT`: flights in other people's formats. What opens them: docs/export.md."""

import argparse
import json
import sys
from pathlib import Path

FORMATS = ("mcap", "rerun", "lerobot", "ulog", "kml", "geojson", "csv", "parquet")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("export")
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="run folders, episodes of them, or folders that hold runs"
    )
    parser.add_argument("--to", required=True, choices=FORMATS, help="the format: docs/export.md says what opens it")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write into (default: RUN-FORMAT, here)")
    parser.add_argument("--overwrite", action="store_true", help="write anew what is there already")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the files; status 0, episodes that are left out named on standard error."""
    from dronecats.report.export.formats import export
    from dronecats.report.recorded.run import recorded_runs

    out = args.out or Path(f"{args.runs[0].resolve().name}-{args.to}")
    done = export(args.to, recorded_runs(args.runs), out, args.overwrite)
    for said in done.left_out:
        print(f"dronecats export: left out: {said}", file=sys.stderr)
    if args.json:
        files = {str(path): count for path, count in done.files.items()}
        print(json.dumps({"to": args.to, "out": str(out), "files": files, "left_out": done.left_out}))
    else:
        for path, count in done.files.items():
            print(f"{path}  {count}")
    return 0
