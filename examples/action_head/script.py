"""What the example's scripts share with the commands: a fault in one sentence, and its status."""

import sys
from collections.abc import Callable
from pathlib import Path

from foundation.errors import DronecatsError, UsageError


def ended(main: Callable[[], int]) -> int:
    """Return the status of a script: its own, 2 for wrong input, 3 when something broke, 130 when interrupted."""
    try:
        return main()
    except DronecatsError as error:
        print(f"action_head: {error}", file=sys.stderr)
        return error.exit_status
    except ImportError as missing:
        if (missing.name or "").split(".")[0] != "torch":  # a mistake of ours, which its traceback tells best
            raise
        print("action_head: PyTorch is not installed: `pip install -e '.[train]'` does it.", file=sys.stderr)
        return UsageError.exit_status
    except KeyboardInterrupt:
        return 130


def say(text: str) -> None:
    """Print a line of progress at once, also into a file."""
    print(text, flush=True)


def make_folder(path: Path) -> None:
    """Make a folder and those above it. Raises UsageError where there can be none."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"'{path}' cannot be made a folder: {error.strerror}.") from None
