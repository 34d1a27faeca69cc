"""Outcomes of episodes: by cell and map, approaching in detail, declarations, failure modes, fleets drone by drone."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from dronecats.report import names
from dronecats.report.cells import ERRORS, FLIGHTS, NAME, NONE, PERCENT, count, errors, mean, part, percent, total
from dronecats.report.report_data import COMMANDING, FLOOR, ONE_DRONE, ReportData, floor, titled
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant
from dronecats.report.table import ReportTable, TableBlock, TableCell, TableColumn, TableRow

CELLWISE = (
    "In brackets Wilson's 95 % interval; where episodes were flown several times they are the unit, and the interval is"
    " as wide as their own scatter asks."
)


def of_cell(flown: Iterable[ScoredEpisode], cell: str, map_: str | None = None) -> list[ScoredEpisode]:
    """Return the flights of one cell, of one map alone where it is named."""
    return [each for each in flown if each.cell == cell and map_ in (None, each.map)]


def main(data: ReportData) -> ReportTable | None:
    """Return success and oracle success by cell, of one drone. Paper, "Main Results"."""
    cells = data.cells()
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

    blocks = data.blocks(columns, row)
    below = _floor(data, cells, columns)
    return ReportTable(
        name="main",
        title="Main results",
        caption=(
            f"One drone: success rate (SR) and oracle success rate (OSR), % of the flights that were scored. {CELLWISE}"
        ),
        columns=tuple(columns),
        blocks=(*blocks, *([below[0]] if below else [])),
        notes=(below[1],) if below else (),
        command=data.command,
    )


def per_map(data: ReportData) -> ReportTable | None:
    """Return successes by map and cell. Paper, "Additional Results"."""
    cells, maps = data.cells(), data.maps()
    places = [(m, c) for m in maps for c in cells if of_cell(data.episodes, c, m)]
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
        blocks=data.blocks(columns, row),
        command=data.command,
    )


def approaching(data: ReportData) -> ReportTable | None:
    """Return what reaching, declaring and succeeding come to apart. Paper, "The Failure Is Declaration"."""
    if not data.cells(["approaching"]):
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
        blocks=data.blocks(columns, row),
        notes=_cut_off(of_cell(data.episodes, "approaching")),
        command=data.command,
    )


def declarations(data: ReportData) -> ReportTable | None:
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

    if not any(entrant.scored for entrant in data.entrants):
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
        blocks=data.blocks(columns, row),
        notes=_cut_off(data.episodes),
        command=data.command,
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


def _floor(data: ReportData, cells: Sequence[str], columns: Sequence[TableColumn]) -> tuple[TableBlock, str] | None:
    """Return the line of what can be had without looking, and whose it is; None where it is not known."""
    flown = [each for each in data.episodes if each.cell in ONE_DRONE]
    groups = [[e.episode for e in of_cell(flown, cell)] for cell in cells] + [[e.episode for e in flown]]
    best = [floor(data.blind, group) for group in groups]
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


def failures(data: ReportData) -> ReportTable | None:
    """Return what share of flights ended in which way; None where it is not known of any."""
    columns = [NAME, FLIGHTS] + [TableColumn(name=mode.column, title=mode.title, unit="%") for mode in names.MODES]

    def row(entrant: Entrant) -> list[TableCell] | None:
        ended = Counter(each.mode for each in entrant.scored if each.cell in ONE_DRONE and each.mode is not None)
        flown = sum(ended.values())
        if not flown:
            return None
        return [count(flown), *(part(ended[mode.name], flown) for mode in names.MODES)]

    blocks = data.blocks(columns, row)
    if not blocks:
        return None
    return ReportTable(
        name="failures",
        title="Failure modes",
        caption="One drone: how the scored flights ended, % of them. The modes part all flights between them.",
        columns=tuple(columns),
        blocks=blocks,
        command=data.command,
    )


APPROACHING = "approaching"


def commanding(data: ReportData) -> ReportTable | None:
    """Return success with one drone beside what a fleet reached, declared and solved."""
    if not data.cells([COMMANDING]):
        return None
    columns = [
        NAME,
        replace(rate(names.SUCCESS, "SR", APPROACHING), group="One drone"),
        rate(names.ORACLE_SUCCESS, "Reached", COMMANDING),
        rate(names.DECLARED, "Declared", COMMANDING),
        rate(names.SUCCESS, "SR", COMMANDING),
        TableColumn(name="identical_percent", title="One point for all", group="Commanding", unit="%"),
        ERRORS,
    ]

    def row(entrant: Entrant) -> list[TableCell] | None:
        fleet = of_cell(entrant.episodes, COMMANDING)
        if not fleet:
            return None
        rates = [percent(fleet, name) for name in (names.ORACLE_SUCCESS, names.DECLARED, names.SUCCESS)]
        told = [each.verdict.commanding for each in fleet if each.scored and each.verdict and each.verdict.commanding]
        copied = part(sum(one.identical_points for one in told), sum(one.all_go_steps for one in told))
        return [percent(of_cell(entrant.episodes, APPROACHING), names.SUCCESS), *rates, copied, errors(fleet)]

    return ReportTable(
        name="commanding",
        title="Commanding",
        caption=(
            "Approaching with one drone beside commanding a fleet, %. Reached: any drone came within the radius of the"
            " named target. Declared: any drone declared arrival. One point for all: of the steps on which every drone"
            f" was told to go, those with the same point in all views. {CELLWISE}"
        ),
        columns=tuple(columns),
        blocks=data.blocks(columns, row),
        command=data.command,
    )


def drones(data: ReportData) -> ReportTable | None:
    """Return what each drone of a fleet came to, beside the episodes that were won; None where it is not known."""
    columns = [
        NAME,
        TableColumn(name="drones", title="Drones"),
        *(TableColumn(name=o.column, title=o.title, group="Of the drones", unit="%") for o in names.DRONES),
        replace(rate(names.SUCCESS, "SR", COMMANDING), group="Of the episodes"),
    ]

    def row(entrant: Entrant) -> list[TableCell] | None:
        fleet = of_cell(entrant.scored, COMMANDING)
        came_to = [int(total(fleet, outcome.name).value or 0) for outcome in names.DRONES]
        every = sum(came_to)
        if not every:
            return None
        return [count(every), *(part(each, every) for each in came_to), percent(fleet, names.SUCCESS)]

    blocks = data.blocks(columns, row)
    if not blocks:
        return None
    return ReportTable(
        name="drones",
        title="Commanding, drone by drone",
        caption=(
            "What each drone of each scored flight came to, % of the drones. One that declares truly wins the"
            " episode, so that the success rate beside is of episodes."
        ),
        columns=tuple(columns),
        blocks=blocks,
        command=data.command,
    )
