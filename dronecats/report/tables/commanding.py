"""One drone beside a commanded fleet, and what each of its drones came to. Paper, "Commanding Several Drones"."""

from dataclasses import replace

from dronecats.report import names
from dronecats.report.blocks import COMMANDING, Lineup
from dronecats.report.entries import ERRORS, NAME, count, errors, part, percent, total
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant
from dronecats.report.tables.outcomes import CELLWISE, of_cell, rate

APPROACHING = "approaching"


def commanding(lineup: Lineup) -> ReportTable | None:
    """Return success with one drone beside what a fleet reached, declared and solved."""
    if not lineup.cells([COMMANDING]):
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
        blocks=lineup.blocks(columns, row),
        command=lineup.command,
    )


def drones(lineup: Lineup) -> ReportTable | None:
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

    blocks = lineup.blocks(columns, row)
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
        command=lineup.command,
    )
