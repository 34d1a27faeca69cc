"""JSON files that a kill or a full disk leaves whole: the old one or the new one, never half of one."""

import contextlib
import json
from pathlib import Path
from typing import Any


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file beside its place and move it there. Raises OSError, and leaves no draft behind then."""
    draft = path.with_name(path.name + ".part")
    try:
        text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
        draft.write_text(text, encoding="utf-8", errors="backslashreplace")  # half a surrogate pair: JSON has it
        draft.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
