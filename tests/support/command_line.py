"""The program as a user starts it, and the object that it prints last."""

import json
import sys
from typing import Any

DRONECATS = (sys.executable, "-m", "dronecats.cli.main")


def last_object(output: str) -> dict[str, Any]:
    """Return the JSON object on the last line of what a command printed, as `--json` prints its result."""
    found: dict[str, Any] = json.loads(output.splitlines()[-1])
    return found
