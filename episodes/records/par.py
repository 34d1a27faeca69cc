"""How many steps the oracle takes for each shipped episode: its par, kept by `dronecats episodes audit`."""

import json
from pathlib import Path

FILE = Path(__file__).parent / "par.json"


def load(file: Path = FILE) -> dict[str, int]:
    """Return id → steps of the episodes that have been flown; none when the audit has not been run.

    Raises ValueError when the file is not such a table.
    """
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    if not isinstance(table, dict) or not all(type(steps) is int and steps > 0 for steps in table.values()):
        raise ValueError(f"{file.name} is not a table from episode ids to numbers of steps")
    return table
