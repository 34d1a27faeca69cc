"""Helpers of the example's scripts."""

from pathlib import Path

from foundation.errors import UsageError


def print_line(text: str) -> None:
    """Print a line of progress and flush the output."""
    print(text, flush=True)


def make_folder(path: Path) -> None:
    """Create a folder and its parents. Raises UsageError if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"'{path}' cannot be created: {error.strerror}.") from None
