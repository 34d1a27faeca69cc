"""How one-drone flights failed. Paper, "Failure Taxonomy": the modes part all flights between them."""

from collections import Counter

from dronecats.report import names
from dronecats.report.blocks import ONE_DRONE, Lineup
from dronecats.report.entries import FLIGHTS, NAME, count, part
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant


def failures(lineup: Lineup) -> ReportTable | None:
    """Return what share of flights ended in which way; None where it is not known of any."""
    columns = [NAME, FLIGHTS] + [TableColumn(name=mode.column, title=mode.title, unit="%") for mode in names.MODES]

    def row(entrant: Entrant) -> list[TableCell] | None:
        ended = Counter(each.mode for each in entrant.scored if each.cell in ONE_DRONE and each.mode is not None)
        flown = sum(ended.values())
        if not flown:
            return None
        return [count(flown), *(part(ended[mode.name], flown) for mode in names.MODES)]

    blocks = lineup.blocks(columns, row)
    if not blocks:
        return None
    return ReportTable(
        name="failures",
        title="Failure modes",
        caption="One drone: how the scored flights ended, % of them. The modes part all flights between them.",
        columns=tuple(columns),
        blocks=blocks,
        command=lineup.command,
    )
