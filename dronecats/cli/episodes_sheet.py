"""`dronecats episodes sheet`: every asset as the camera sees it from near and from far."""

import argparse
from pathlib import Path


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("sheet", help="draw assets at 6, 12, 24 and 48 m on one sheet")
    parser.add_argument("assets", nargs="*", metavar="ASSET", help="names of assets (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="picture to write (.jpg)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the sheet."""
    from episodes.authoring.pictures.contact_sheet import contact_sheet
    from foundation.errors import UsageError

    if args.out.suffix.lower() not in (".jpg", ".jpeg"):
        raise UsageError(f"--out {args.out}: a sheet is a JPEG; call it {args.out.with_suffix('.jpg')}")

    contact_sheet(args.assets, args.out)
    print(args.out)
    return 0
