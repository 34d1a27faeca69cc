"""Which pilot is better, pair by pair, on the episodes that both have flown."""

import itertools
from collections.abc import Sequence

from dronecats.judge.statistics.paired import ALPHA, POWER, Paired, holm, paired
from dronecats.report.blocks import BUILT_IN, COMMANDING, MODELS, ONE_DRONE, Lineup
from dronecats.report.entries import NONE, PERCENT, count
from dronecats.report.report_table import ReportTable, TableBlock, TableCell, TableColumn, TableRow
from dronecats.report.results.entrants import Entrant

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


def comparison(lineup: Lineup) -> ReportTable | None:
    """Return every two models beside one another, and every two built-in pilots; None where there are no two."""
    blocks = []
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        among = [entrant for entrant in lineup.entrants if entrant.is_model is is_model]
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
        command=lineup.command,
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
    return TableRow(cells=(
        TableCell(value=a.label),
        TableCell(value=b.label),
        TableCell(value=suite),
        count(told.episodes),
        count(told.only_first),
        count(told.only_second),
        TableCell(value=PERCENT * told.difference, of=told.episodes),
        TableCell(value=told.p),
        TableCell(value=adjusted),
        shown,
    ))  # fmt: skip
