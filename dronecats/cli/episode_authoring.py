"""Verb `edit`, and the actions of `episodes` that write records or pictures."""

import argparse
import dataclasses
import json
from pathlib import Path

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import print_next
from dronecats.cli.options import add_page, page_of, serve
from dronecats.cli.output import print_line, show
from dronecats.report.table import numbers, table_of, words
from dronecats.view.scene.page_hosts import reach
from foundation.errors import UsageError
from foundation.files import file_errors_as


def add_edit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "what", nargs="?", default="residential", metavar="MAP|ID", help="map or episode to edit (default residential)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("my-episodes"), metavar="DIR", help="folder for records (default my-episodes)"
    )
    add_page(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address, and open no browser")
    parser.set_defaults(run=_edit)


def _edit(args: argparse.Namespace) -> int:
    """Serve the editor until Ctrl-C."""
    interrupt_on_signals()
    port, hosts = page_of(args)
    from dronecats.view.editor.editor import Editor

    print_line("building the map …")
    editor = Editor(args.what, args.out, port, hosts)
    return serve(
        editor,
        f"editing at {editor.url} ({reach(hosts)})\nrecords are written to {args.out}/, Ctrl-C ends",
        browser=not args.no_browser,
    )


def add_new_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the record files")
    parser.add_argument("--map", metavar="NAME", help="a map's name")
    parser.add_argument("--cell", metavar="CELL", help="approaching, searching, tracking, search-and-track, commanding")
    parser.add_argument("--count", type=int, default=1, metavar="N", help="number of records (default 1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="equal seeds give equal records (default 0)")
    parser.add_argument(
        "--first",
        type=int,
        metavar="N",
        help="number in the first record's id (default: the first that no shipped record has)",
    )
    parser.add_argument("--map-seed", type=int, default=1, metavar="N", help="seed of the map (default 1)")
    parser.set_defaults(run=_new)


def _new(args: argparse.Namespace) -> int:
    """Write the records and print the paths of their files."""
    from episodes.authoring.propose import proposals

    if not (args.map and args.cell):
        raise UsageError("choose a map and a cell, for example --map residential --cell approaching")
    first = proposals.first_free(args.map, args.cell) if args.first is None else args.first
    request = proposals.RecordRequest(args.map, args.cell, first, args.count, args.seed, args.map_seed)
    records = proposals.propose(request)
    with file_errors_as(UsageError, f"--out '{args.out}' cannot be created", ". Choose another --out"):
        args.out.mkdir(parents=True, exist_ok=True)
    files = []
    for record in records:
        file = args.out / f"{record.id}.json"
        _write(file, record.to_json())
        print(f"{file}  {record.instruction}", flush=True)
        files.append(file)
    print_next("episodes new", files=files, file=files[0])
    return 0


def _write(file: Path, text: str) -> None:
    """Write a record. Raises UsageError if the file has another record or cannot be written."""
    with file_errors_as(UsageError, f"'{file}' cannot be written"):
        if file.exists() and file.read_bytes() != text.encode():
            raise UsageError(f"'{file}' has another record. Choose another --out or --first")
        file.write_text(text, encoding="utf-8")


def add_sheet_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("assets", nargs="*", metavar="ASSET", help="names of assets (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="picture to write (.jpg)")
    parser.set_defaults(run=_sheet)


def _sheet(args: argparse.Namespace) -> int:
    """Write a contact sheet: small pictures of assets."""
    from episodes.authoring.asset_pictures import write_contact_sheet

    if args.out.suffix.lower() not in (".jpg", ".jpeg"):
        raise UsageError(f"--out {args.out}: a sheet is a JPEG. Name it {args.out.with_suffix('.jpg')}")

    write_contact_sheet(args.assets, args.out)
    print(f"written: {args.out}")
    return 0


def add_optics_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="picture to write (.jpg)")
    parser.set_defaults(run=_optics)


def _optics(args: argparse.Namespace) -> int:
    """Write a picture of one place with every lens, sensor and weather option."""
    from episodes.authoring.scene_pictures import write_optics_sheet

    write_optics_sheet(args.file)
    print(f"written: {args.file}")
    return 0


def add_probe_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder for the pictures")
    parser.add_argument("--seed", type=int, default=0, help="seed of the inscriptions (default 0)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_probe)


def _probe(args: argparse.Namespace) -> int:
    """Write pictures of signs and plates at several distances, their index and a contact sheet."""
    if args.seed < 0:
        raise UsageError(f"--seed must be 0 or more, got {args.seed}")
    from episodes.authoring.asset_pictures import write_probe

    probes = write_probe(args.out, args.seed)
    if args.json:
        print(
            json.dumps({"folder": str(args.out), "seed": args.seed, "probes": [dataclasses.asdict(p) for p in probes]})
        )
        return 0
    columns = (words("picture"), words("letters"), numbers("distance", unit="m"), numbers("height of a letter (px)"))
    show(table_of(columns, ((p.file, p.text, f"{p.distance_m:g}", f"{p.letter_px:.2f}") for p in probes)))
    print(f"written: {args.out}, with index.json and contact-sheet.png")
    return 0
