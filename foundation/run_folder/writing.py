"""Writes the append-only logs of a run folder. JSON lines are flushed one by one, and stay readable after any kill."""

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, Literal, TextIO

from msgspec import UNSET

from foundation.files import write_text
from foundation.run_folder.rows import LoggedPrompt

NEW_LINE = "\n"
_TIME = struct.Struct(">Q")
PLAIN = frozenset((float, int, str, bool, type(None)))


def as_json(value: Any) -> Any:
    """Return a row as JSON values. A class's own fields come before inherited ones; UNSET fields are omitted.

    A value that is neither a row nor a list of rows is returned unchanged.
    """
    if isinstance(value, tuple | list):
        return [as_json(item) for item in value]
    names = field_names(value.__class__)
    if not names:
        return value
    items = [(name, getattr(value, name)) for name in names]
    return {name: item if type(item) in PLAIN else as_json(item) for name, item in items if item is not UNSET}


@cache
def field_names(kind: type) -> tuple[str, ...]:
    """Return the names of a row's fields in the order of writing; empty for any other class."""
    bases = (base for base in kind.__mro__ if "__dataclass_fields__" in vars(base)) if is_dataclass(kind) else ()
    return tuple(name for base in bases for name in base.__annotations__)


class LineLog:
    """Appends rows to a file of JSON lines."""

    def __init__(self, path: Path) -> None:
        self._file: TextIO = path.open("a", encoding="utf-8")

    def write(self, row: Any) -> None:
        """Append a row and flush it."""
        self._file.write(_line(row))
        self._file.flush()

    def close(self) -> None:
        self._file.close()


class TelemetryLog:
    """Writes a tlog: each MAVLink frame as received, after its time (µs) as a big-endian 64-bit integer."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("ab")

    def write(self, time_us: int, frame: bytes) -> None:
        """Append a frame received at `time_us` (µs, vehicle clock)."""
        self._file.write(_TIME.pack(time_us) + frame)

    def flush(self) -> None:
        """Flush the file, for readers that follow it while it grows."""
        self._file.flush()

    def close(self) -> None:
        self._file.close()


class PromptLog:
    """Writes prompts.jsonl. Each line is flushed before the question is sent.

    Most of a prompt is the same at every step, so most rows hold only the lines that differ from the last full text.
    """

    def __init__(self, path: Path) -> None:
        self._log = LineLog(path)
        # role and drone → lines of the last text that was written in full
        self._bases: dict[tuple[str, int], list[str]] = {}

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
        lines, base = text.split(NEW_LINE), self._bases.get((role, drone), [])
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
            self._bases[role, drone] = lines
        self._log.write(row)

    def close(self) -> None:
        self._log.close()


def write_lines(path: Path, rows: Iterable[Any]) -> None:
    """Write a file of JSON lines atomically. Raises OSError."""
    write_text(path, "".join(_line(row) for row in rows))


def _common(a: Sequence[str], b: Sequence[str]) -> int:
    """Return how many lines at the beginning of both are equal."""
    return next((k for k, (line, other) in enumerate(zip(a, b, strict=False)) if line != other), min(len(a), len(b)))


def _line(row: Any) -> str:
    return json.dumps(as_json(row)) + "\n"
