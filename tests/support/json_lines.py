"""The logs of a run folder, read without the reader that is tested with them."""

import json
from pathlib import Path
from typing import Any


def rows(path: Path, kind: str | None = None) -> list[dict[str, Any]]:
    """Return the objects of a file of JSON lines; of one kind, where one is named."""
    found = [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines()]
    return [row for row in found if kind is None or row["kind"] == kind]
