"""The study's flights as data: a row a flight, as CSV and as Parquet."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.judge.metrics.registry import METRICS
from dronecats.report.results.columns import array
from dronecats.study.analysis.studied import Studied
from foundation.whole_file import whole_file

CSV, PARQUET = "flights.csv", "flights.parquet"


@dataclass(frozen=True, slots=True)
class FlightColumn:
    """A column of the data."""

    name: str
    type: str  # of SQL
    values: tuple[Any, ...]  # one a flight


def columns(studied: Studied) -> list[FlightColumn]:
    """Return who flew, episode, flight, levels, outcome and every metric of the whole episode."""
    flights = studied.flights
    found = [
        FlightColumn("entrant", "VARCHAR", tuple(each.entrant for each in flights)),
        FlightColumn("run", "VARCHAR", tuple(each.scored.run.folder.name for each in flights)),
        FlightColumn("episode", "VARCHAR", tuple(each.scored.episode for each in flights)),
        FlightColumn("cell", "VARCHAR", tuple(each.scored.cell for each in flights)),
        FlightColumn("map", "VARCHAR", tuple(each.scored.map for each in flights)),
        FlightColumn("flight_number", "BIGINT", tuple(each.number for each in flights)),
        FlightColumn("seed", "BIGINT", tuple(each.scored.run.seed for each in flights)),
    ]
    for k, factor in enumerate(studied.factors):
        kind = "DOUBLE" if factor.numeric else "VARCHAR"
        found.append(FlightColumn(f"level_{factor.name}", kind, tuple(each.levels[k] for each in flights)))
    found.append(FlightColumn("scored", "BOOLEAN", tuple(each.scored.scored for each in flights)))
    if any(each.scored.left_out for each in flights):
        found.append(FlightColumn("left_out", "VARCHAR", tuple(each.scored.left_out for each in flights)))
    for name, metric in METRICS.items():
        if metric.level == "episode":
            values = tuple(each.scored.values.get(name) for each in flights)
            if any(value is not None for value in values):
                truth = all(value is None or isinstance(value, bool) for value in values)
                told = values if truth else tuple(None if value is None else float(value) for value in values)
                found.append(FlightColumn(name, "BOOLEAN" if truth else "DOUBLE", told))
    return found


def write_csv(studied: Studied, path: Path) -> None:
    """Write the rows as CSV; what is not known is empty. Raises OSError."""
    told = columns(studied)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in told])
        writer.writerows(zip(*(map(_plain, column.values) for column in told), strict=True))


def write_parquet(studied: Studied, path: Path) -> None:
    """Write the rows as Parquet. Raises ImportError without the extra `query`, OSError where they cannot be."""
    import duckdb

    from dronecats.report.results.database import literal

    told = columns(studied)
    connection = duckdb.connect(":memory:")
    try:
        names = ", ".join(f'"{column.name}" {column.type}' for column in told)
        connection.execute(f"CREATE TABLE flights ({names})")
        arrays = {column.name: array(column.values, column.type) for column in told}
        connection.register("rows", arrays)
        connection.execute("INSERT INTO flights SELECT * FROM rows")
        try:
            with whole_file(path) as draft:
                connection.execute(f"COPY flights TO {literal(str(draft))} (FORMAT parquet, COMPRESSION zstd)")
        except duckdb.IOException as fault:
            raise OSError(None, str(fault)) from None
    finally:
        connection.close()


def _plain(value: Any) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
