"""A row of the preflight table, a parameter that ought to be changed, and both as lines of text."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH = 118  # characters of a line
MARKS = {True: "pass", False: "FAIL", None: "?"}


@dataclass(frozen=True, slots=True)
class Row:
    """One thing that was looked at."""

    name: str
    passed: bool | None  # None: could not be found out, or only a person can judge it
    why: str
    fix: str = ""  # what to do about it; empty where there is nothing to do


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter that ought to hold another value."""

    name: str
    old: float
    new: float
    reason: str


@dataclass(frozen=True, slots=True)
class Finding:
    """A row, and the change of a parameter that would mend it."""

    row: Row
    change: Change | None = None


def table(rows: Sequence[Row]) -> str:
    """Return the rows as text, one or more lines each: mark, name, why, and what to do."""
    wide = max((len(row.name) for row in rows), default=0)
    lines = []
    for row in rows:
        lines += _wrapped(f"{MARKS[row.passed]:4}  {row.name:{wide}}  ", row.why)
        if row.fix and row.passed is not True:
            lines += _wrapped(" " * (wide + 8) + "→ ", row.fix)
    return "\n".join(lines)


def proposal(changes: Sequence[Change]) -> str:
    """Return the changes as text: name, old → new, and the reason."""
    wide = max((len(change.name) for change in changes), default=0)
    lines = []
    for change in changes:
        lines += _wrapped(f"{change.name:{wide}}  {change.old:>6g} → {change.new:<6g}  ", change.reason)
    return "\n".join(lines)


def summary(rows: Sequence[Row]) -> str:
    """Return the last line: how many passed, failed and are not known."""
    count = {mark: sum(row.passed is mark for row in rows) for mark in (True, False, None)}
    return f"{count[True]} passed, {count[False]} failed, {count[None]} for you to judge"


def _wrapped(head: str, text: str) -> list[str]:
    width = max(WIDTH - len(head), 40)
    first, *rest = textwrap.wrap(text, width) or [""]
    return [f"{head}{first}".rstrip(), *(" " * len(head) + line for line in rest)]
