"""Reads the logs of a run folder, independently of the reader under test."""

import json
from pathlib import Path
from typing import Any


def rows(path: Path, kind: str | None = None) -> list[dict[str, Any]]:
    """Return the objects of a file of JSON lines, optionally of one kind."""
    objects = [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines()]
    return [row for row in objects if kind is None or row["kind"] == kind]
