"""A row of the preflight table, and a parameter that ought to be changed."""

from collections.abc import Sequence
from dataclasses import dataclass


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


def summary(rows: Sequence[Row]) -> str:
    """Return the last line: how many passed, failed and are not known."""
    count = {mark: sum(row.passed is mark for row in rows) for mark in (True, False, None)}
    return f"{count[True]} passed, {count[False]} failed, {count[None]} for you to judge"
