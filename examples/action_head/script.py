"""Helpers of the example's scripts."""

from pathlib import Path

from foundation.errors import UsageError
from foundation.files import file_errors_as


def print_line(text: str) -> None:
    """Print a line of progress and flush the output."""
    print(text, flush=True)


def make_folder(path: Path) -> None:
    """Create a folder and its parents. Raises UsageError if that fails."""
    with file_errors_as(UsageError, f"'{path}' cannot be created", "."):
        path.mkdir(parents=True, exist_ok=True)
