"""The program as a user starts it, and the object that it prints last."""

import json
import sys

DRONECATS = (sys.executable, "-m", "dronecats.cli.main")


def last_object(output: str) -> dict:
    """Return the JSON object on the last line of what a command printed, as `--json` prints its result."""
    return json.loads(output.splitlines()[-1])
