"""Tables of pairwise comparisons of pilots on common episodes, and of the scatter of scores between flights."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

from dronecats.judge.statistics.shares import ALPHA, POWER, Paired, Spread, holm, paired, spread
from dronecats.report.report_data import COMMANDING, NAME, ONE_DRONE, PERCENT, Entrant, ReportData, cell_heading
from dronecats.report.table import ReportTable, TableCell, TableColumn, TableRow, row
from episodes.records.record import CELLS

SUITES = (("one drone", ONE_DRONE), ("commanding", (COMMANDING,)))  # title, cells (kinds of episode)
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
    TableColumn(name="smallest_points", title="Detectable", unit="points", decimals=1),
)

Flights = dict[str, tuple[str, tuple[bool, ...]]]  # episode → (its cell, the successes of its flights)


def comparison(data: ReportData) -> ReportTable | None:
    """Return the comparison of every pair of models and every pair of built-in pilots.

    None if no pair has common episodes.
    """
    return data.table_of_rows(
        name="comparison",
        title="Pair by pair",
        caption=(
            "Only first, only second: number of episodes that only this pilot solved. An episode with several"
            " flights counts for the pilot that solved the larger share of them. p: McNemar's exact test, two-sided."
            " p, Holm: the same with Holm's correction for all pairs of the block and suite. Difference: success rate"
            " of the first minus that of the second, in percentage points. Detectable: the smallest true difference"
            f" that the test finds in this number of episodes with power {POWER:g} at α = {ALPHA:g}, before Holm's"
            " correction. The assumed share of episodes with different outcomes is the observed share, or the"
            " difference itself if that is larger."
        ),
        columns=COLUMNS,
        rows_of=lambda among: [row for suite, cells in SUITES for row in _pair_rows(among, suite, cells)],
    )


def _pair_rows(among: Sequence[Entrant], suite: str, cells: Sequence[str]) -> list[TableRow]:
    """Return a row for every pair of these entrants with common episodes."""
    results = [(a, b, _paired(a, b, cells)) for a, b in itertools.combinations(among, 2)]
    results = [(a, b, result) for a, b, result in results if result.episodes]
    adjusted = holm([result.p for _, _, result in results])
    rows = []
    for (a, b, result), p_holm in zip(results, adjusted, strict=True):
        difference = TableCell(value=PERCENT * result.difference, of=result.episodes)
        smallest = TableCell(
            value=None if result.smallest is None else PERCENT * result.smallest,
            of=None if result.smallest is None else result.episodes,
        )
        counts = result.episodes, result.only_first, result.only_second
        rows.append(row(a.label, b.label, suite, *counts, difference, result.p, p_holm, smallest))
    return rows


def _paired(a: Entrant, b: Entrant, cells: Sequence[str]) -> Paired:
    common = [name for name, flights in a.by_episode.items() if name in b.by_episode and flights[0].cell in cells]
    first, second = ([[flight.success for flight in e.by_episode[name]] for name in common] for e in (a, b))
    return paired(first, second)


def variance(data: ReportData) -> ReportTable | None:
    """Return the number of successes in each pass over the episodes, and the scatter between passes.

    Pass k has the k-th flight of every episode. None if no entrant flew its episodes more than once.
    """
    cells = data.cells(CELLS)
    columns = [NAME, TableColumn(name="flight", title="Flight", align="left")]
    columns += [
        TableColumn(name=f"{cell.replace('-', '_')}_successes", title=cell_heading(cell), decimals=1, cell=cell)
        for cell in cells
    ]
    columns.append(TableColumn(name="one_drone_successes", title="One drone", decimals=1))
    notes: list[str] = []

    def rows_of(entrants: Sequence[Entrant]) -> list[TableRow]:
        rows = []
        for entrant in entrants:
            flights = _repeated(entrant)
            if not flights:
                continue
            scatter = [_spread(flights, [cell]) for cell in cells] + [_spread(flights, ONE_DRONE)]
            rows += _scatter_rows(entrant.label, scatter)
            if any(result and len(result.totals) == 2 for result in scatter):
                notes.append(
                    f"For {entrant.label} there are only two flights, so the standard deviation is very uncertain;"
                    " see its interval."
                )
            if left := len(entrant.by_episode) - len(flights):
                notes.append(f"Of {entrant.label}, episodes left out that were not scored in every flight: {left}.")
        return rows

    return data.table_of_rows(
        name="variance",
        title="From flight to flight",
        caption=(
            "Successes of each flight over the same episodes: row 1 counts the first flight of every episode, row 2"
            " the second, and so on. s.d. of N: standard deviation over N flights, in brackets its 95 %"
            " interval by chi-square, which is wide for few flights. Binomial: sqrt(n p (1 − p)), the scatter"
            " of n independent flights with one success rate. By episode: the scatter of"
            " independent flights if each episode has its own estimated success rate."
        ),
        columns=columns,
        rows_of=rows_of,
        notes=notes,
    )


def _repeated(entrant: Entrant) -> Flights:
    """Return the episodes that have a score in every pass over the suite. Empty if there is only one pass."""
    most = max(map(len, entrant.by_episode.values()), default=0)
    return {
        name: (flights[0].cell, tuple(flight.success for flight in flights))
        for name, flights in entrant.by_episode.items()
        if len(flights) == most > 1
    }


def _spread(flights: Flights, cells: Sequence[str]) -> Spread | None:
    chosen = [outcomes for cell, outcomes in flights.values() if cell in cells]
    return spread(list(zip(*chosen, strict=True))) if chosen else None


def _scatter_rows(label: str, scatter: Sequence[Spread | None]) -> list[TableRow]:
    """Return a row for each pass, then the rows of the mean and the scatter. `scatter` has an entry for each column."""
    count = max(len(result.totals) for result in scatter if result)
    names = (*(str(k + 1) for k in range(count)), "mean", f"s.d. of {count}", "binomial", "by episode")
    columns = []
    for result in scatter:
        values = (
            (*result.totals, result.mean, result.deviation, result.binomial, result.binomial_by_episode)
            if result
            else ()
        )
        cells = [TableCell(value=value, of=result.episodes if result else None) for value in values]
        if result:
            cells[count + 1] = replace(cells[count + 1], low=result.low, high=result.high)
        columns.append(cells or [TableCell(value=None)] * len(names))
    lines = zip(names, *columns, strict=True)
    return [row("" if k else label, name, *cells, entrant=label) for k, (name, *cells) in enumerate(lines)]


TABLES = (variance, comparison)
