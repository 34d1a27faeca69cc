"""The tables of docs/metrics.md, made from the registry and the modes: `make metrics` writes them, a test compares."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dronecats.judge.metrics.audit import RULES
from dronecats.judge.metrics.failure_mode import MODES
from dronecats.judge.metrics.registry import METRICS

BEGIN, END = "<!-- {name} begin -->", "<!-- {name} end -->"
GOOD = {"more": "↑", "less": "↓", None: ""}


def tables() -> dict[str, str]:
    """Return the page's tables by name, Markdown."""
    return {
        "metrics": markdown(
            ("name", "in tables", "unit", "of", "what it is", "paper"),
            [
                (f"`{m.name}`", f"{m.title} {GOOD[m.better]}".strip(), m.unit, m.level, m.definition, m.paper or "ours")
                for m in METRICS.values()
            ],
        ),
        "modes": markdown(("mode", "holds when"), list(MODES.items())),
        "rules": markdown(("rule", "a success would be"), [(f"`{name}`", said) for name, (said, _) in RULES.items()]),
    }


def filled(page: str, made: Mapping[str, str] | None = None) -> str:
    """Return a page with its tables made anew, or with those that are `made`.

    Raises ValueError where it has no place for one.
    """
    for name, table in (tables() if made is None else made).items():
        begin, end = BEGIN.format(name=name), END.format(name=name)
        before, _, rest = page.partition(begin)
        _, found, after = rest.partition(end)
        if not found:
            raise ValueError(f"the page has no place for {name}")
        page = f"{before}{begin}\n{table}{end}{after}"
    return page


def write(page: Path, made: Mapping[str, str] | None = None) -> None:
    """Make a page's tables anew, as `filled` does. Raises OSError, and ValueError as that."""
    page.write_text(filled(page.read_text(encoding="utf-8"), made), encoding="utf-8")


def markdown(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "".join(f"| {' | '.join(cell.replace('|', '∣') for cell in line)} |\n" for line in lines)
