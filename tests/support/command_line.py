"""The command that starts the program, and a reader of the last JSON object of its output."""

import json
import sys
from typing import Any

DRONECATS = (sys.executable, "-m", "dronecats.cli.main")


def last_object(output: str) -> dict[str, Any]:
    """Return the JSON object on the last line of a command's output, as `--json` prints its result."""
    document: dict[str, Any] = json.loads(output.splitlines()[-1])
    return document
