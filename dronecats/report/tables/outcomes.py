"""Makes the tables of flight outcomes. A cell is a kind of episode, such as `approaching`."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from dronecats.report.report_data import (
    BLIND_ROW_TITLE,
    COMMANDING,
    DRONE_OUTCOMES,
    ERRORS,
    FAILURE_MODE_COLUMNS,
    FLIGHTS,
    NAME,
    NONE,
    ONE_DRONE,
    Cells,
    Entrant,
    ReportData,
    best_blind,
    by_entrant,
    cell_heading,
    fraction,
    mean,
    not_scored,
    percent,
    total,
)
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.table import ReportTable, TableBlock, TableCell, TableColumn, row

APPROACHING = "approaching"
INTERVALS = (
    "In brackets: Wilson's 95 % interval. If episodes were flown several times, the episode is the unit,"
    " and the interval follows from the scatter between episodes."
)


def of_cell(flights: Iterable[ScoredEpisode], cell: str, map_: str | None = None) -> list[ScoredEpisode]:
    """Return the flights of one cell, or of one cell and one map."""
    return [flight for flight in flights if flight.cell == cell and map_ in (None, flight.map)]


def rate(metric: str, title: str, cell: str | None) -> TableColumn:
    """Return the column of a rate in one cell; `cell` None: in all cells."""
    where = cell.replace("-", "_") if cell else "all"
    return TableColumn(name=f"{where}_{metric}_percent", title=title, group=cell_heading(cell) if cell else "All",
                       unit="%", better=None if metric == "declared" else "more", cell=cell)  # fmt: skip


def main(data: ReportData) -> ReportTable | None:
    """Return the success and oracle success (came within the radius) of one drone, by cell. Paper, "Main Results"."""
    cells = data.cells()
    columns = [NAME, FLIGHTS]
    for cell in (*cells, None):
        columns += [rate("success", "SR", cell), rate("oracle_success", "OSR", cell)]
    columns.append(ERRORS)

    def row_of(entrant: Entrant) -> Cells | None:
        flights = [flight for flight in entrant.episodes if flight.cell in ONE_DRONE]
        if not flights:
            return None
        groups = [of_cell(flights, cell) for cell in cells] + [flights]
        rates = [percent(group, name) for group in groups for name in ("success", "oracle_success")]
        return [sum(flight.scored for flight in flights), *rates, not_scored(flights)]

    table = data.table(
        name="main",
        title="Main results",
        caption=(
            "One drone: success rate (SR) and oracle success rate (OSR), % of the flights that were scored. "
            f"{INTERVALS}"
        ),
        columns=columns,
        row_of=row_of,
    )
    floor = _floor(data, cells)
    return replace(table, blocks=(*table.blocks, floor[0]), notes=(floor[1],)) if table and floor else table


def _floor(data: ReportData, cells: Sequence[str]) -> tuple[TableBlock, str] | None:
    """Return a block with the row of the best blind pilots, and a note that names them; None: no results are known."""
    flights = [flight for flight in data.episodes if flight.cell in ONE_DRONE]
    groups = [[e.episode for e in of_cell(flights, cell)] for cell in cells] + [[e.episode for e in flights]]
    best = [best_blind(data.blind, group) for group in groups]
    if not any(best):
        return None
    rates: list[TableCell] = []
    for result in best:
        _, solved, count = result or ("", 0, 0)
        rates += [fraction(solved, count), NONE]
    pilots = ", ".join(f"{cell_heading(c)} {b[0]}" for c, b in zip([*cells, "all"], best, strict=True) if b)
    note = f"{BLIND_ROW_TITLE}: one flight of the same episodes by a pilot that never looks at an image ({pilots})."
    return TableBlock(title="", rows=(row(BLIND_ROW_TITLE, None, *rates, None),)), note


def per_map(data: ReportData) -> ReportTable | None:
    """Return successes by map and cell. Paper, "Additional Results"."""
    places = [(m, c) for m in data.maps() for c in data.cells() if of_cell(data.episodes, c, m)]
    columns = [NAME, *(replace(rate("success", cell_heading(c), c), name=f"{m}_{c.replace('-', '_')}_success_percent",
                               group=cell_heading(m), map=m, as_count=True) for m, c in places)]  # fmt: skip

    def row_of(entrant: Entrant) -> Cells | None:
        rates = [percent(of_cell(entrant.episodes, c, m), "success") for m, c in places]
        return rates if any(cell.of for cell in rates) else None

    caption = "Successes of the scored flights, by map and cell."
    return data.table(columns, row_of, name="per_map", title="By map", caption=caption)


def approaching(data: ReportData) -> ReportTable | None:
    """Return the rates of reaching, declaring and succeeding. Paper, "The Failure Is Declaration"."""
    rates = {"success": "SR", "oracle_success": "OSR", "declared": "Declared"}
    columns = [
        NAME,
        FLIGHTS,
        *(replace(rate(metric, title, APPROACHING), group="") for metric, title in rates.items()),
        TableColumn(name="approach_ratio", title="Approach ratio", decimals=2, better="more"),
        TableColumn(name="ne_m", title="NE", unit="m", decimals=1, better="less"),
        TableColumn(name="declared_to_start_ratio", title="Declared / start", decimals=2),
    ]

    def row_of(entrant: Entrant) -> Cells | None:
        flights = of_cell(entrant.scored, APPROACHING)
        means = [mean(flights, metric) for metric in ("approach_ratio", "ne_m", "declared_to_start")]
        return [len(flights), *(percent(flights, metric) for metric in rates), *means] if flights else None

    return data.table(
        name="approaching",
        title="Approaching in detail",
        caption=(
            "Rates in %. Approach ratio: the share of the start distance that was closed. NE: distance at the decisive"
            " declaration, or at the last action. Last column: distance at the decisive declaration over the"
            " start distance; a large value means an early declaration. Means over the flights that have the"
            f" value. {INTERVALS}"
        ),
        columns=columns,
        row_of=row_of,
        notes=cut_off(of_cell(data.episodes, APPROACHING)),
    )


def cut_off(flights: Iterable[ScoredEpisode]) -> tuple[str, ...]:
    """Return a note about the flights that ended with their first success."""
    cut = sum(bool(flight.verdict and flight.verdict.censored) for flight in flights if flight.scored)
    if not cut:
        return ()
    return (f"Flights that ended at their first success: {cut}. Values after that are missing.",)


@by_entrant(
    title="Failure modes",
    caption="One drone: how the scored flights ended, in %. Each flight has exactly one mode.",
    columns=[NAME, FLIGHTS]
    + [TableColumn(name=mode.column, title=mode.title, unit="%") for mode in FAILURE_MODE_COLUMNS],
)
def failures(entrant: Entrant) -> Cells | None:
    """Return the shares of the failure modes of one-drone flights; None if no mode is known."""
    flights = [flight for flight in entrant.scored if flight.cell in ONE_DRONE and flight.mode is not None]
    if not flights:
        return None
    ended = Counter(flight.mode for flight in flights)
    return [len(flights), *(fraction(ended[mode.name], len(flights)) for mode in FAILURE_MODE_COLUMNS)]


@by_entrant(
    title="Commanding",
    caption=(
        "Approaching with one drone, compared with commanding a fleet, %. Reached: any drone came within the radius"
        " of the named target. Declared: any drone declared arrival. One point for all: of the steps with"
        f" a go for every drone, the share in which all points are equal. {INTERVALS}"
    ),
    columns=[
        NAME,
        replace(rate("success", "SR", APPROACHING), group="One drone"),
        rate("oracle_success", "Reached", COMMANDING),
        rate("declared", "Declared", COMMANDING),
        rate("success", "SR", COMMANDING),
        TableColumn(name="identical_percent", title="One point for all", group="Commanding", unit="%"),
        ERRORS,
    ],
)
def commanding(entrant: Entrant) -> Cells | None:
    """Return the success rate with one drone, and the rates of reaching, declaring and succeeding with a fleet."""
    fleet = of_cell(entrant.episodes, COMMANDING)
    if not fleet:
        return None
    rates = [percent(fleet, metric) for metric in ("oracle_success", "declared", "success")]
    commanded = [e.verdict.commanding for e in fleet if e.scored and e.verdict and e.verdict.commanding]
    copied = fraction(sum(c.identical_points for c in commanded), sum(c.all_go_steps for c in commanded))
    return [percent(of_cell(entrant.episodes, APPROACHING), "success"), *rates, copied, not_scored(fleet)]


@by_entrant(
    title="Commanding, drone by drone",
    caption=(
        "Result of each drone of each scored flight, % of the drones. The success rate counts episodes instead:"
        " one drone with a true declaration solves the episode."
    ),
    columns=[
        NAME,
        TableColumn(name="drones", title="Drones"),
        *(TableColumn(name=o.column, title=o.title, group="Of the drones", unit="%") for o in DRONE_OUTCOMES),
        replace(rate("success", "SR", COMMANDING), group="Of the episodes"),
    ],
)
def drones(entrant: Entrant) -> Cells | None:
    """Return the outcomes of the drones of a fleet, and the success rate; None if the outcomes are not known."""
    fleet = of_cell(entrant.scored, COMMANDING)
    counts = [total(fleet, outcome.name) for outcome in DRONE_OUTCOMES]
    shares = [fraction(count, sum(counts)) for count in counts]
    return [sum(counts), *shares, percent(fleet, "success")] if sum(counts) else None


TABLES = (main, per_map, approaching, failures, commanding, drones)
