"""The small benchmark's report as it was last looked at: `python -m tests.report.golden` writes it anew."""

from pathlib import Path

from dronecats.report.report_folder import opening, tables, write
from foundation.protocol import RADIUS_M
from tests.report.small import small

FOLDER = Path(__file__).with_name("golden")


def report(out: Path) -> None:
    """Write the report without its figures into the folder."""
    who = small()
    write(tables(who), {}, opening(who, RADIUS_M), out)


if __name__ == "__main__":
    report(FOLDER)
