"""The tables of docs/studies.md and docs/disturbances.md, made from the declarations: `make studies` writes them."""

from pathlib import Path

from dronecats.flight.disturbances import DECLARED
from dronecats.judge.metrics import page
from dronecats.study.factors import FACTORS, Factor
from foundation.declaration import DeclaredNumber, declarations, shown
from hil.impairment import Impairment

STUDIES, DISTURBANCES = "studies.md", "disturbances.md"
PARTS = {"frame": "pictures", "vehicle": "vehicle"}  # part of the disturbances → its table


def tables(name: str) -> dict[str, str]:
    """Return a page's tables by their names, Markdown."""
    if name == STUDIES:
        rows = [(f"`{each.name}`", _levels(each), each.unit, each.help) for each in FACTORS.values()]
        return {"factors": page.markdown(("factor", "levels", "unit", "what it sets"), rows)}
    columns = ("option", "values", "what happens")
    return {
        **{table: page.markdown(columns, _options(part)) for part, table in PARTS.items()},
        "wire": page.markdown(("name", "values", "meaning"), _wire()),
    }


def write(docs: Path) -> None:
    """Make the tables of both pages anew. Raises OSError, and ValueError where one has no place for them."""
    for name in (STUDIES, DISTURBANCES):
        page.write(docs / name, tables(name))


def _options(part: str) -> list[tuple[str, ...]]:
    return [
        (
            f"`--{option.name.replace('_', '-')} {option.metavar}`",
            "" if option.read or not each.quantity else _range(each.quantity),
            "; ".join(filter(None, (option.help, option.more))),
        )
        for of, _, each in DECLARED
        if of == part and (option := each.option)
    ]


def _wire() -> list[tuple[str, ...]]:
    quantities = [each.quantity for each in declarations(Impairment).values() if each.quantity]
    return [(f"`{each.name}`", _range(each), each.help) for each in quantities]


def _levels(factor: Factor) -> str:
    if factor.quantity is None:
        return ", ".join(f"`{word}`" for word in factor.words) if factor.words else "words"
    whole, real_time = ", whole" * factor.quantity.whole, "; real time only" * factor.real_time
    return f"{shown(factor.quantity.low)} … {shown(factor.quantity.high)}{whole}{real_time}"


def _range(quantity: DeclaredNumber) -> str:
    return f"{shown(quantity.low)} … {shown(quantity.high)} {quantity.unit}".strip()
