"""How many replies were no actions, and why."""

from dronecats.report import names
from dronecats.report.blocks import Lineup
from dronecats.report.entries import FLIGHTS, NAME, count, part, total
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant

WHY = {names.UNREADABLE: "Unreadable", names.REFUSED: "Refused", names.CUT_OFF: "Cut off"}
COLUMNS = (
    NAME,
    FLIGHTS,
    TableColumn(name="decisions", title="Decisions"),
    *(TableColumn(name=f"{name}_percent", title=title, unit="%", decimals=1, better="less")
      for name, title in WHY.items()),
    TableColumn(name="unreadable_flights", title="Flights with any", better="less"),
)  # fmt: skip


def replies(lineup: Lineup) -> ReportTable | None:
    """Return the shares of unreadable, refused and cut-off replies; None where only built-in pilots flew."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = entrant.scored
        decisions, *counts = (_sum(entrant, name) for name in (names.DECISIONS, *WHY))
        if not (entrant.is_model and decisions):
            return None
        hurt = sum(bool(each.values.get(names.UNREADABLE)) for each in flown)
        return [count(len(flown)), count(decisions), *(part(each, decisions) for each in counts), count(hurt)]

    blocks = lineup.blocks(COLUMNS, row)
    if not blocks:
        return None
    return ReportTable(
        name="replies",
        title="Replies",
        caption=(
            "% of the decisions of all scored flights. Unreadable: the reply holds no action, and the drone holds."
            " Of these, refused: by the model or by a filter of its provider; cut off: at the longest reply that was"
            " allowed, so that a larger max_tokens or less reasoning may help."
        ),
        columns=COLUMNS,
        blocks=blocks,
        command=lineup.command,
    )


def _sum(entrant: Entrant, metric: str) -> int:
    return round(float(total(entrant.scored, metric).value or 0))
