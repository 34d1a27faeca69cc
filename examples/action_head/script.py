"""Helpers of the example's scripts."""

from pathlib import Path

from foundation.errors import UsageError


def print_line(text: str) -> None:
    """Print a line of progress at once, also into a file."""
    print(text, flush=True)


def make_folder(path: Path) -> None:
    """Make a folder and those above it. Raises UsageError where there can be none."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"'{path}' cannot be created: {error.strerror}.") from None
