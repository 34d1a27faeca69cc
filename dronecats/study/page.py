"""The table of docs/studies.md, made from the registry of factors: `make studies` writes it, a test compares."""

from pathlib import Path

from dronecats.judge.metrics import page
from dronecats.study.factor import Factor
from dronecats.study.factors import FACTORS


def tables() -> dict[str, str]:
    """Return the page's table by its name, Markdown."""
    rows = [(f"`{each.name}`", _levels(each), each.unit, each.what) for each in FACTORS.values()]
    return {"factors": page.markdown(("factor", "levels", "unit", "what it sets"), rows)}


def write(path: Path) -> None:
    """Make the page's table anew. Raises OSError, and ValueError where it has no place for it."""
    page.write(path, tables())


def _levels(factor: Factor) -> str:
    if factor.span is None:
        return ", ".join(f"`{word}`" for word in factor.words) if factor.words else "words"
    more = ", whole" * factor.whole + "; real time only" * factor.real_time
    low, high = factor.span
    return f"{low:g} … {high:,.10g}{more}"
