"""How episodes ended: by cell, by map, approaching in detail, and how often arrival was declared in vain."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from dronecats.report import names
from dronecats.report.blocks import FLOOR, ONE_DRONE, Lineup, floor, titled
from dronecats.report.entries import ERRORS, FLIGHTS, NAME, NONE, PERCENT, count, errors, mean, percent
from dronecats.report.report_table import ReportTable, TableBlock, TableCell, TableColumn, TableRow
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant

CELLWISE = (
    "In brackets Wilson's 95 % interval; where episodes were flown several times they are the unit, and the interval is"
    " as wide as their own scatter asks."
)


def of_cell(flown: Iterable[ScoredEpisode], cell: str, map_: str | None = None) -> list[ScoredEpisode]:
    """Return the flights of one cell, of one map alone where it is named."""
    return [each for each in flown if each.cell == cell and map_ in (None, each.map)]


def main(lineup: Lineup) -> ReportTable | None:
    """Return success and oracle success by cell, of one drone. Paper, "Main Results"."""
    cells = lineup.cells()
    if not cells:
        return None
    columns = [NAME, FLIGHTS]
    for cell in cells:
        columns += [rate(names.SUCCESS, "SR", cell), rate(names.ORACLE_SUCCESS, "OSR", cell)]
    columns += [rate(names.SUCCESS, "SR", None), rate(names.ORACLE_SUCCESS, "OSR", None), ERRORS]

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = [each for each in entrant.episodes if each.cell in ONE_DRONE]
        if not flown:
            return None
        groups = [of_cell(flown, cell) for cell in cells] + [flown]
        rates = [percent(group, name) for group in groups for name in (names.SUCCESS, names.ORACLE_SUCCESS)]
        return [count(sum(each.scored for each in flown)), *rates, errors(flown)]

    blocks = lineup.blocks(columns, row)
    below = _floor(lineup, cells, columns)
    return ReportTable(
        name="main",
        title="Main results",
        caption=(
            f"One drone: success rate (SR) and oracle success rate (OSR), % of the flights that were scored. {CELLWISE}"
        ),
        columns=tuple(columns),
        blocks=(*blocks, *([below[0]] if below else [])),
        notes=(below[1],) if below else (),
        command=lineup.command,
    )


def per_map(lineup: Lineup) -> ReportTable | None:
    """Return successes by map and cell. Paper, "Additional Results"."""
    cells, maps = lineup.cells(), lineup.maps()
    places = [(m, c) for m in maps for c in cells if of_cell(lineup.episodes, c, m)]
    if not places:
        return None
    columns = [NAME, *(replace(rate(names.SUCCESS, titled(c), c), name=f"{m}_{c.replace('-', '_')}_success_percent",
                               group=titled(m), map=m, as_count=True) for m, c in places)]  # fmt: skip

    def row(entrant: Entrant) -> list[TableCell] | None:
        told = [percent(of_cell(entrant.episodes, c, m), names.SUCCESS) for m, c in places]
        return told if any(cell.of for cell in told) else None

    return ReportTable(
        name="per_map",
        title="By map",
        caption="Successes of the scored flights, by map and cell.",
        columns=tuple(columns),
        blocks=lineup.blocks(columns, row),
        command=lineup.command,
    )


def approaching(lineup: Lineup) -> ReportTable | None:
    """Return what reaching, declaring and succeeding come to apart. Paper, "The Failure Is Declaration"."""
    if not lineup.cells(["approaching"]):
        return None
    columns = [
        NAME,
        FLIGHTS,
        *(
            replace(rate(metric, title, "approaching"), group="")
            for metric, title in ((names.SUCCESS, "SR"), (names.ORACLE_SUCCESS, "OSR"), (names.DECLARED, "Declared"))
        ),
        TableColumn(name="approach_ratio", title="Approach ratio", decimals=2, better="more"),
        TableColumn(name="ne_m", title="NE", unit="m", decimals=1, better="less"),
        TableColumn(name="declared_to_start_ratio", title="Declared / start", decimals=2),
    ]

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = of_cell(entrant.scored, "approaching")
        if not flown:
            return None
        rates = [percent(flown, name) for name in (names.SUCCESS, names.ORACLE_SUCCESS, names.DECLARED)]
        means = [mean(flown, name) for name in (names.APPROACH, names.NE, names.DECLARED_TO_START)]
        return [count(len(flown)), *rates, *means]

    return ReportTable(
        name="approaching",
        title="Approaching, taken apart",
        caption=(
            "Rates in %. The approach ratio is the share of the start distance that was closed; NE the distance at the"
            " decisive declaration, or at the last action; the last column the distance at the decisive declaration"
            " over that at the start, so that a large one declared early. Means over the flights that have them."
            f" {CELLWISE}"
        ),
        columns=tuple(columns),
        blocks=lineup.blocks(columns, row),
        notes=_cut_off(of_cell(lineup.episodes, "approaching")),
        command=lineup.command,
    )


def declarations(lineup: Lineup) -> ReportTable | None:
    """Return how often arrival was declared, and how often that was so: beside the criterion, which forgives."""
    columns = [
        NAME,
        FLIGHTS,
        *(
            replace(rate(metric, title, None), group="")
            for metric, title in ((names.SUCCESS, "SR"), (names.FIRST, "SR₁"), (names.WITHIN_THREE, "SR₃"))
        ),
        TableColumn(name="declarations_per_flight", title="Declarations", decimals=1),
        TableColumn(name="false_per_flight", title="of these false", decimals=1, better="less"),
        TableColumn(name="precision_percent", title="Precision", unit="%", better="more"),
    ]

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = entrant.scored
        if not flown:
            return None
        rates = [percent(flown, name) for name in (names.SUCCESS, names.FIRST, names.WITHIN_THREE)]
        precise = mean(flown, names.PRECISION)
        in_percent = NONE if precise.value is None else TableCell(value=PERCENT * float(precise.value), of=precise.of)
        counts = [mean(flown, names.DECLARATIONS), mean(flown, names.FALSE)]
        return [count(len(flown)), *rates, *counts, in_percent]

    if not any(entrant.scored for entrant in lineup.entrants):
        return None
    return ReportTable(
        name="declarations",
        title="Declarations",
        caption=(
            "SR₁ and SR₃: solved by the first declaration, or by one of the first three. Declarations a flight, and"
            " how many of them did not qualify; precision is the share that did, the mean over flights that declared."
            " All cells, a fleet's declarations pooled."
        ),
        columns=tuple(columns),
        blocks=lineup.blocks(columns, row),
        notes=_cut_off(lineup.episodes),
        command=lineup.command,
    )


def rate(metric: str, title: str, cell: str | None) -> TableColumn:
    where = cell.replace("-", "_") if cell else "all"
    return TableColumn(name=f"{where}_{metric}_percent", title=title, group=titled(cell) if cell else "All",
                       unit="%", better=None if metric == names.DECLARED else "more", cell=cell)  # fmt: skip


def _cut_off(flown: Iterable[ScoredEpisode]) -> tuple[str, ...]:
    """Return what is to be said of flights that ended with their first success."""
    cut = sum(bool(each.verdict and each.verdict.censored) for each in flown if each.scored)
    if not cut:
        return ()
    return (
        f"Flights that ended with their first success: {cut}. What they would have done until the cap is not here.",
    )


def _floor(lineup: Lineup, cells: Sequence[str], columns: Sequence[TableColumn]) -> tuple[TableBlock, str] | None:
    """Return the line of what can be had without looking, and whose it is; None where it is not known."""
    flown = [each for each in lineup.episodes if each.cell in ONE_DRONE]
    groups = [[e.episode for e in of_cell(flown, cell)] for cell in cells] + [[e.episode for e in flown]]
    best = [floor(lineup.blind, group) for group in groups]
    if not any(best):
        return None
    rates: list[TableCell] = []
    for each in best:
        rates += [TableCell(value=PERCENT * each[1] / each[2], count=each[1], of=each[2]) if each else NONE, NONE]
    row = TableRow(cells=(TableCell(value=FLOOR), NONE, *rates, NONE))
    assert len(row.cells) == len(columns)
    who = ", ".join(f"{titled(c)} {b[0]}" for c, b in zip([*cells, "all"], best, strict=True) if b)
    return TableBlock(
        title="", rows=(row,)
    ), f"{FLOOR}: the best blind pilot's one flight of the same episodes ({who})."
