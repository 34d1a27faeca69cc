"""The one writer of the logs: append-only, flushed line by line, readable after a kill at any byte."""

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, Literal, TextIO

from msgspec import UNSET

from foundation.run_folder.rows import LoggedPrompt
from foundation.whole_file import write_text

NEW_LINE = "\n"
_TIME = struct.Struct(">Q")
PLAIN = frozenset((float, int, str, bool, type(None)))


def as_json(value: Any) -> Any:
    """Return a row as JSON has it: fields in their order, a class's own before those that it inherits, UNSET left out.

    Anything else than a row, or a list of rows, is returned as it is.
    """
    if isinstance(value, tuple | list):
        return [as_json(each) for each in value]
    names = field_names(value.__class__)
    if not names:
        return value
    told = [(name, getattr(value, name)) for name in names]
    return {name: each if type(each) in PLAIN else as_json(each) for name, each in told if each is not UNSET}


@cache
def field_names(kind: type) -> tuple[str, ...]:
    """Return the fields of a row in the order in which they are written; nothing of anything else."""
    bases = (each for each in kind.__mro__ if "__dataclass_fields__" in vars(each)) if is_dataclass(kind) else ()
    return tuple(name for each in bases for name in each.__annotations__)


class LineLog:
    """A file of JSON lines that grows."""

    def __init__(self, path: Path) -> None:
        # half a surrogate pair, which JSON has and UTF-8 has not, is escaped
        self._file: TextIO = path.open("a", encoding="utf-8", errors="backslashreplace")

    def write(self, row: Any) -> None:
        """Append a row, and have it on disk before anything else happens."""
        self._file.write(_line(row))
        self._file.flush()

    def close(self) -> None:
        self._file.close()


class TelemetryLog:
    """A tlog: MAVLink frames as they came, each after eight bytes of time."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("ab")

    def write(self, time_us: int, frame: bytes) -> None:
        """Append a frame that was heard at `time_us` (µs, vehicle clock)."""
        self._file.write(_TIME.pack(time_us) + frame)

    def flush(self) -> None:
        """Have what was written on disk, for whoever follows the file while it grows."""
        self._file.flush()

    def close(self) -> None:
        self._file.close()


class PromptLog:
    """Writes prompts.jsonl. Each line is on disk before the model is asked.

    Most of a prompt is the same at every step, so a line holds only the lines of text that differ from an earlier one.
    """

    def __init__(self, path: Path) -> None:
        self._log = LineLog(path)
        # role and drone → the lines of the last text that was written whole
        self._whole: dict[tuple[str, int], list[str]] = {}

    def write(
        self,
        role: Literal["pilot", "commander"],
        drone: int,
        number: int,
        t_asked: float,
        frames: Sequence[int],
        labels: Sequence[str],
        text: str,
    ) -> None:
        """Append one question; the arguments are the fields of `LoggedPrompt`."""
        lines, base = text.split(NEW_LINE), self._whole.get((role, drone), [])
        head = _common(base, lines)
        tail = _common(base[head:][::-1], lines[head:][::-1])
        row = LoggedPrompt(
            role=role,
            drone=drone,
            number=number,
            t_asked=round(t_asked, 6),
            frames=tuple(frames),
            labels=tuple(labels),
            **(
                {"head": head, "lines": tuple(lines[head : len(lines) - tail]), "tail": tail}
                if head + tail > len(lines) / 2
                else {"text": text}
            ),
        )
        if row.text is not UNSET:
            self._whole[role, drone] = lines
        self._log.write(row)

    def close(self) -> None:
        self._log.close()


def write_lines(path: Path, rows: Iterable[Any]) -> None:
    """Write a whole file of JSON lines beside its place and move it there. Raises OSError."""
    write_text(path, "".join(_line(row) for row in rows))


def _common(one: Sequence[str], other: Sequence[str]) -> int:
    """Return how many of their first lines are the same."""
    return next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


def _line(row: Any) -> str:
    return json.dumps(as_json(row)) + "\n"
