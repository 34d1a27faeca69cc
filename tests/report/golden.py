"""The reviewed report of the small benchmark. `python -m tests.report.golden` regenerates it."""

from pathlib import Path

from dronecats.report.report_folder import opening, tables, write
from foundation.protocol import RADIUS_M
from tests.report.small import small

FOLDER = Path(__file__).with_name("golden")


def report(out: Path) -> None:
    """Write the report without its figures into a folder."""
    entrants = small()
    write(tables(entrants), {}, opening(entrants, RADIUS_M), out)


if __name__ == "__main__":
    report(FOLDER)
