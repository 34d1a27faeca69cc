"""Generates the tables of docs/metrics.md, docs/studies.md and docs/disturbances.md.

`make metrics` and `make studies` write the tables from the registries of metrics and factors and from the declarations
of disturbances.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dronecats.flight.spec.disturbances import DECLARED, Disturbance, DisturbanceOption
from dronecats.judge.metrics.audit import RULES
from dronecats.judge.metrics.failure_mode import MODES
from dronecats.judge.metrics.judging import METRICS
from dronecats.study.factors import FACTORS, Factor
from foundation.declaration import DeclaredNumber, declarations, shown
from hil.impairment import Impairment

BEGIN, END = "<!-- {name} begin -->", "<!-- {name} end -->"
ARROWS = {"more": "↑", "less": "↓", None: ""}  # better direction of a metric → sign


def tables(page: str) -> dict[str, str]:
    """Return the Markdown tables of metrics.md, studies.md or disturbances.md, by name."""
    if page == "metrics.md":
        metrics = [
            (f"`{m.name}`", f"{m.title} {ARROWS[m.better]}".strip(), m.unit, m.level, m.definition, m.paper or "ours")
            for m in METRICS.values()
        ]
        return {
            "metrics": markdown(("name", "in tables", "unit", "level", "meaning", "section of the paper"), metrics),
            "modes": markdown(("mode", "holds when"), [(mode, text) for mode, (text, _) in MODES.items()]),
            "rules": markdown(
                ("rule", "a flight succeeds if"), [(f"`{name}`", text) for name, (text, _) in RULES.items()]
            ),
        }
    if page == "studies.md":
        rows = [(f"`{factor.name}`", _levels(factor), factor.unit, factor.help) for factor in FACTORS.values()]
        return {"factors": markdown(("factor", "levels", "unit", "meaning"), rows)}
    quantities = [declared.quantity for declared in declarations(Impairment).values() if declared.quantity]
    return {
        "pictures": _options("frame"),
        "vehicle": _options("vehicle"),
        "conditions": _options("conditions"),
        "wire": markdown(("name", "values", "meaning"), [(f"`{q.name}`", _range(q), q.help) for q in quantities]),
    }


def filled(text: str, made: Mapping[str, str]) -> str:
    """Return a page's text with each table in `made` between its markers. Raises ValueError for a missing marker."""
    for name, table in made.items():
        begin, end = BEGIN.format(name=name), END.format(name=name)
        before, _, rest = text.partition(begin)
        _, marker, after = rest.partition(end)
        if not marker:
            raise ValueError(f"the page has no place for {name}")
        text = f"{before}{begin}\n{table}{end}{after}"
    return text


def write(docs: Path, *pages: str) -> None:
    """Replace the tables in these pages. Raises OSError, and ValueError for a missing marker."""
    for name in pages:
        page = docs / name
        page.write_text(filled(page.read_text(encoding="utf-8"), tables(name)), encoding="utf-8")


def markdown(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "".join(f"| {' | '.join(cell.replace('|', '∣') for cell in line)} |\n" for line in lines)


def _options(part: str) -> str:
    """Return the table of the disturbance options for one part: frame, vehicle or conditions."""
    rows = [
        (
            f"`--{option.name.replace('_', '-')} {option.metavar}`",
            _values(option, declared),
            ". ".join(filter(None, (option.help, option.more))),
        )
        for declared_part, _, declared in DECLARED
        if declared_part == part and (option := declared.option)
    ]
    return markdown(("option", "values", "effect"), rows)


def _values(option: DisturbanceOption, declared: Disturbance) -> str:
    if option.choices:
        return ", ".join(f"`{word}`" for word in option.choices)
    return "" if option.read or not declared.quantity else _range(declared.quantity)


def _levels(factor: Factor) -> str:
    if factor.quantity is None:
        return ", ".join(f"`{word}`" for word in factor.words) if factor.words else "words"
    integer, real_time = ", whole" * factor.quantity.whole, "; real time only" * factor.real_time
    return f"{shown(factor.quantity.low)} … {shown(factor.quantity.high)}{integer}{real_time}"


def _range(quantity: DeclaredNumber) -> str:
    return f"{shown(quantity.low)} … {shown(quantity.high)} {quantity.unit}".strip()
