"""How scores scatter from flight to flight, beside chance. Paper, "Variance and Throughput Sensitivity"."""

from collections.abc import Sequence

from dronecats.judge.statistics.shares import Spread, spread
from dronecats.report.blocks import BUILT_IN, MODELS, ONE_DRONE, Lineup, titled
from dronecats.report.entries import NAME, NONE
from dronecats.report.report_table import ReportTable, TableBlock, TableCell, TableColumn, TableRow
from dronecats.report.results.entrants import Entrant
from episodes.records.record import CELLS


def variance(lineup: Lineup) -> ReportTable | None:
    """Return each flight's successes, their scatter, and what coins would scatter; None where nobody flew twice."""
    cells = lineup.cells(CELLS)
    columns = [NAME, TableColumn(name="flight", title="Flight", align="left")]
    columns += [
        TableColumn(name=f"{cell.replace('-', '_')}_successes", title=titled(cell), decimals=1, cell=cell)
        for cell in cells
    ]
    columns.append(TableColumn(name="one_drone_successes", title="One drone", decimals=1))
    blocks, notes = [], []
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        rows = []
        for entrant in lineup.entrants:
            flights = repeated(entrant)
            if entrant.is_model is is_model and flights:
                scatter = [_spread(flights, [cell]) for cell in cells] + [_spread(flights, ONE_DRONE)]
                rows += _rows(entrant.label, scatter)
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
        command=lineup.command,
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


def _rows(label: str, scatter: Sequence[Spread | None]) -> list[TableRow]:
    """Return a line a flight, and the lines that sum them up."""
    count = max(len(each.totals) for each in scatter if each)
    lines: list[tuple[str, list[TableCell]]] = []
    for k in range(count):
        lines.append((str(k + 1), [_cell(None if s is None else s.totals[k], s) for s in scatter]))
    lines.append(("mean", [_cell(None if s is None else s.mean, s) for s in scatter]))
    lines.append((f"s.d. of {count}", [_deviation(s) for s in scatter]))
    lines.append(("binomial", [_cell(None if s is None else s.binomial, s) for s in scatter]))
    lines.append(("by episode", [_cell(None if s is None else s.by_episode, s) for s in scatter]))
    return [
        TableRow(cells=(TableCell(value=label if k == 0 else ""), TableCell(value=flight), *cells), entrant=label)
        for k, (flight, cells) in enumerate(lines)
    ]


def _cell(value: float | None, scatter: Spread | None) -> TableCell:
    return TableCell(value=value, of=scatter.episodes if scatter else None)


def _deviation(scatter: Spread | None) -> TableCell:
    if scatter is None:
        return NONE
    return TableCell(value=scatter.deviation, low=scatter.low, high=scatter.high, of=scatter.episodes)
