"""Files that a kill or a full disk leaves whole: the old one or the new one, never half of one."""

import contextlib
import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give the path of a draft beside `path`, which takes its place when the block ends well, and else is removed.

    Threads and processes that write the same file have drafts of their own: the one that ends last stays. Raises
    OSError.
    """
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def write_text(path: Path, text: str, *, errors: str = "strict") -> None:
    """Write a text file in UTF-8, its line ends as they are, whole or not at all. Raises OSError."""
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8", errors=errors, newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file beside its place and move it there. Raises OSError, and leaves no draft behind then."""
    text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, errors="backslashreplace")  # half a surrogate pair: JSON has it
