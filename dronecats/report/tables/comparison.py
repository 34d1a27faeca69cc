"""Pilots compared pair by pair on the episodes that both flew, and the scatter of scores from flight to flight."""

import itertools
from collections.abc import Sequence

from dronecats.judge.statistics.paired import ALPHA, POWER, Paired, holm, paired
from dronecats.judge.statistics.shares import Spread, spread
from dronecats.report.cells import NAME, NONE, PERCENT
from dronecats.report.report_data import BUILT_IN, COMMANDING, MODELS, ONE_DRONE, ReportData, titled
from dronecats.report.results.entrants import Entrant
from dronecats.report.table import ReportTable, TableBlock, TableCell, TableColumn, TableRow, row
from episodes.records.record import CELLS

SUITES = (("one drone", ONE_DRONE), ("commanding", (COMMANDING,)))
COLUMNS = (
    TableColumn(name="first", title="First", align="left"),
    TableColumn(name="second", title="Second", align="left"),
    TableColumn(name="suite", title="Suite", align="left"),
    TableColumn(name="episodes", title="Episodes"),
    TableColumn(name="only_first", title="Only first"),
    TableColumn(name="only_second", title="Only second"),
    TableColumn(name="difference_points", title="Difference", unit="points", decimals=1),
    TableColumn(name="p", title="p", decimals=3),
    TableColumn(name="p_holm", title="p, Holm", decimals=3),
    TableColumn(name="smallest_points", title="Could have shown", unit="points", decimals=1),
)


def comparison(data: ReportData) -> ReportTable | None:
    """Return every two models beside one another, and every two built-in pilots; None where there are no two."""
    blocks = []
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        among = [entrant for entrant in data.entrants if entrant.is_model is is_model]
        rows = [row for suite, cells in SUITES for row in _rows(among, suite, cells)]
        if rows:
            blocks.append(TableBlock(title=title, rows=tuple(rows)))
    if not blocks:
        return None
    return ReportTable(
        name="comparison",
        title="Pair by pair",
        caption=(
            "Only first, only second: episodes that the one solved and the other did not; of several flights, that it"
            " solved in the larger share of its own. p: McNemar's exact test, two-sided; beside it Holm's correction"
            " for all pairs of the block and suite. Difference: of the success rates, in points of 100. Could have"
            f" shown: the smallest true difference that the test finds with power {POWER:g} at α = {ALPHA:g} (before"
            " Holm's correction) among so many episodes, the share of those with different outcomes being as observed,"
            " or the difference itself where that is larger."
        ),
        columns=COLUMNS,
        blocks=tuple(blocks),
        command=data.command,
    )


def _rows(among: Sequence[Entrant], suite: str, cells: Sequence[str]) -> list[TableRow]:
    """Return a line for every two of these that have flown episodes in common."""
    pairs = [(a, b, _paired(a, b, cells)) for a, b in itertools.combinations(among, 2)]
    told = [(a, b, result) for a, b, result in pairs if result.episodes]
    adjusted = holm([result.p for _, _, result in told])
    return [_row(a, b, suite, result, p) for (a, b, result), p in zip(told, adjusted, strict=True)]


def _paired(a: Entrant, b: Entrant, cells: Sequence[str]) -> Paired:
    both = [name for name, flown in a.by_episode.items() if name in b.by_episode and flown[0].cell in cells]
    one, other = ([[each.success for each in e.by_episode[name]] for name in both] for e in (a, b))
    return paired(one, other)


def _row(a: Entrant, b: Entrant, suite: str, told: Paired, adjusted: float) -> TableRow:
    shown = NONE if told.smallest is None else TableCell(value=PERCENT * told.smallest, of=told.episodes)
    difference = TableCell(value=PERCENT * told.difference, of=told.episodes)
    counts = told.episodes, told.only_first, told.only_second
    return row(a.label, b.label, suite, *counts, difference, told.p, adjusted, shown)


def variance(data: ReportData) -> ReportTable | None:
    """Return each flight's successes, their scatter, and what coins would scatter; None where nobody flew twice."""
    cells = data.cells(CELLS)
    columns = [NAME, TableColumn(name="flight", title="Flight", align="left")]
    columns += [
        TableColumn(name=f"{cell.replace('-', '_')}_successes", title=titled(cell), decimals=1, cell=cell)
        for cell in cells
    ]
    columns.append(TableColumn(name="one_drone_successes", title="One drone", decimals=1))
    blocks, notes = [], []
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        rows = []
        for entrant in data.entrants:
            flights = repeated(entrant)
            if entrant.is_model is is_model and flights:
                scatter = [_spread(flights, [cell]) for cell in cells] + [_spread(flights, ONE_DRONE)]
                rows += _scatter_rows(entrant.label, scatter)
                left = len(entrant.by_episode) - len(flights)
                if any(each and len(each.totals) == 2 for each in scatter):
                    notes.append(
                        f"Of {entrant.label} there are two flights: a standard deviation from two says hardly more than"
                        " that they differed, see its interval."
                    )
                notes += (
                    [f"Of {entrant.label}, episodes left out that were not scored in every flight: {left}."]
                    if left
                    else []
                )
        if rows:
            blocks.append(TableBlock(title=title, rows=tuple(rows)))
    if not blocks:
        return None
    return ReportTable(
        name="variance",
        title="From flight to flight",
        caption=(
            "Successes of each flight over the same episodes. s.d. of N: standard deviation over N flights, in brackets"
            " its 95 % interval by chi-square, which of few flights is wide. Binomial: sqrt(n p (1 − p)), what n coins"
            " of one share would scatter. By episode: what flights that know nothing of one another would, each episode"
            " with a share of its own, as it was estimated."
        ),
        columns=tuple(columns),
        blocks=tuple(blocks),
        notes=tuple(notes),
        command=data.command,
    )


def repeated(entrant: Entrant) -> dict[str, tuple[str, tuple[bool, ...]]]:
    """Return cell and successes of each episode that was scored in every flight, by id; nothing of a single flight."""
    by_episode = entrant.by_episode
    most = max(map(len, by_episode.values()), default=0)
    if most < 2:
        return {}
    return {
        name: (flown[0].cell, tuple(each.success for each in flown))
        for name, flown in by_episode.items()
        if len(flown) == most
    }


def _spread(flights: dict[str, tuple[str, tuple[bool, ...]]], cells: Sequence[str]) -> Spread | None:
    chosen = [outcomes for cell, outcomes in flights.values() if cell in cells]
    return spread(list(zip(*chosen, strict=True))) if chosen else None


def _scatter_rows(label: str, scatter: Sequence[Spread | None]) -> list[TableRow]:
    """Return a line a flight, and the lines that sum them up."""
    count = max(len(each.totals) for each in scatter if each)
    lines: list[tuple[str, list[TableCell]]] = []
    for k in range(count):
        lines.append((str(k + 1), [_scatter_cell(None if s is None else s.totals[k], s) for s in scatter]))
    lines.append(("mean", [_scatter_cell(None if s is None else s.mean, s) for s in scatter]))
    lines.append((f"s.d. of {count}", [_deviation(s) for s in scatter]))
    lines.append(("binomial", [_scatter_cell(None if s is None else s.binomial, s) for s in scatter]))
    lines.append(("by episode", [_scatter_cell(None if s is None else s.by_episode, s) for s in scatter]))
    return [
        TableRow(cells=(TableCell(value=label if k == 0 else ""), TableCell(value=flight), *cells), entrant=label)
        for k, (flight, cells) in enumerate(lines)
    ]


def _scatter_cell(value: float | None, scatter: Spread | None) -> TableCell:
    return TableCell(value=value, of=scatter.episodes if scatter else None)


def _deviation(scatter: Spread | None) -> TableCell:
    if scatter is None:
        return NONE
    return TableCell(value=scatter.deviation, low=scatter.low, high=scatter.high, of=scatter.episodes)
