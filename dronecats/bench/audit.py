"""What an audit says of a suite: how many of its episodes a pilot solved, and in how many steps."""

import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from episodes import suites
from episodes.record import CELLS

Result = Mapping[str, Any]  # keys episode, outcome, steps, ne_m; as `Runner.fly` returns them


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the report."""

    name: str  # a suite, or a map and cell
    solved: int
    flown: int  # scored flights; errors of the infrastructure are nobody's
    errors: int
    steps: float | None  # median over the solved

    def as_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "solved": self.solved,
            "flown": self.flown,
            "errors": self.errors,
            "median_steps": self.steps,
        }


def row(name: str, results: Iterable[Result]) -> Row:
    """Return the line of these results."""
    results = list(results)
    solved = [r for r in results if r["outcome"] == "success"]
    errors = sum(r["outcome"] not in ("success", "failure") for r in results)
    steps = statistics.median(r["steps"] for r in solved) if solved else None
    return Row(name, len(solved), len(results) - errors, errors, steps)


def table(results: Iterable[Result]) -> list[Row]:
    """Return a line per map and cell, one per suite that is among the results, and one for everything."""
    results = sorted(results, key=lambda r: str(r["episode"]))
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(_group(str(result["episode"])), []).append(result)
    rows = [row(name, groups[name]) for name in sorted(groups, key=_order)]
    for suite in ("quick", "one-drone", "commanding"):
        members = [r for r in results if suite in suites.of(str(r["episode"]))]
        if members:
            rows.append(row(suite, members))
    rows.append(row("all", results))
    return rows


def pars(results: Iterable[Result]) -> dict[str, int]:
    """Return the steps of every solved episode by id."""
    return {str(r["episode"]): int(r["steps"]) for r in results if r["outcome"] == "success"}


def _group(episode: str) -> str:
    """Return an id without its number: `residential-tracking-03` is one of `residential-tracking`."""
    stem, _, number = episode.rpartition("-")
    return stem if number.isdigit() else episode


def _order(group: str) -> tuple[int, str]:
    cells = [k for k, cell in enumerate(CELLS) if group.endswith(f"-{cell}")]
    # 'search-and-track' is no 'tracking', and a file of the user's is neither
    return (cells[-1] if cells else len(CELLS), group)


def text(rows: Iterable[Row]) -> str:
    """Return the report as text."""
    lines = [f"{'':36} solved   steps (median)"]
    for each in rows:
        steps = f"{each.steps:g}" if each.steps is not None else "–"
        errors = f"   {each.errors} error{'s' * (each.errors > 1)}, not scored" if each.errors else ""
        lines.append(f"{each.name:36} {each.solved:3d}/{each.flown:<3d}  {steps}{errors}")
    return "\n".join(lines)
