"""JSON files that a kill or a full disk leaves whole: the old one or the new one, never half of one."""

import json
from pathlib import Path
from typing import Any

from foundation.whole_file import write_text


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file beside its place and move it there. Raises OSError, and leaves no draft behind then."""
    text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, errors="backslashreplace")  # half a surrogate pair: JSON has it
