"""`dronecats submit RUN… --out FILE.tar.xz`: one archive with everything that is needed to judge runs again."""

import argparse
import os
from pathlib import Path

from foundation.errors import UsageError
from foundation.whole_file import whole_file


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("submit")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="run folders, or folders of runs")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the archive, FILE.tar.xz")
    parser.add_argument("--name", help="of the entry (the pilot's)")
    parser.add_argument("--note", default="", help="a sentence about the entry")
    parser.add_argument("--with-frames", action="store_true", help="take in what the pilot saw, not digests alone")
    parser.add_argument("--partial", action="store_true", help="submit what is no whole suite, or not scored, marked")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the archive and say what is in it; status 0."""
    from dronecats.cli.verify import as_json, print_verification
    from dronecats.judge.metrics.judging import reread
    from dronecats.report.archive.scrubbing import secrets_of
    from dronecats.report.archive.submission import submit
    from dronecats.report.archive.verification import verify
    from dronecats.report.recorded.run import recorded_runs

    if not args.out.name.endswith(".tar.xz"):
        raise UsageError(f"--out wants the name of a file that ends with .tar.xz, got {args.out.name}")
    with whole_file(args.out) as draft:
        submit(
            recorded_runs(args.runs), draft, name=args.name, note=args.note, partial=args.partial,
            with_frames=args.with_frames, secrets=secrets_of(os.environ),
        )  # fmt: skip
        told = verify(draft, reread)
        if not told.verified:
            raise UsageError(f"the archive would not be verified: {told.differences[0]}; `dronecats judge` says more")
    if args.json:
        print(as_json(told))
    else:
        print(f"{args.out}  {told.archive_bytes / 1e6:.1f} MB  SHA-256 {told.archive_sha256}")
        print_verification(told)
    return 0
