"""What a `think` bought, beside ordinary steps. Paper, "Test-Time Deliberation"."""

from dronecats.judge.metrics.deliberation import Followed, deliberation
from dronecats.report.blocks import Lineup
from dronecats.report.entries import NAME, NONE, count, part
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant

STALLS, LOSSES = "Stalls broken", "Target seen again"
COLUMNS = (
    NAME,
    TableColumn(name="thinks", title="Thinks"),
    TableColumn(name="matched", title="Matched"),
    TableColumn(name="gain_m_per_step", title="Gain", unit="m/step", decimals=2),
    *(
        TableColumn(name=f"{name}_after_{who}_percent", title=f"after {words}", group=group, unit="%", decimals=1)
        for name, group in (("stalls", STALLS), ("losses", LOSSES))
        for who, words in (("think", "a think"), ("other", "another"))
    ),
)


def thinking(lineup: Lineup) -> ReportTable | None:
    """Return the paper's three comparisons over all steps of each line; None where nobody thought."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        told = deliberation(step for each in entrant.scored for step in each.outlooks)
        if not told.thinks:
            return None
        gain = NONE if told.gain_m_per_step is None else TableCell(value=told.gain_m_per_step, of=told.matched)
        return [count(told.thinks), count(told.matched), gain, *_shares(told.stalls), *_shares(told.losses)]

    blocks = lineup.blocks(COLUMNS, row)
    if not blocks:
        return None
    return ReportTable(
        name="thinking",
        title="What thinking bought",
        caption=(
            "Of the scored flights, step by step. Gain: metres that the three steps after a think closed, each, more"
            " than those after other steps that had closed at the same rate (matched). Stalls broken, and targets"
            " out of view that were seen again, within three steps. Pilots think where they are in trouble: this"
            " observes, and proves nothing."
        ),
        columns=COLUMNS,
        blocks=blocks,
        command=lineup.command,
    )


def _shares(told: Followed) -> tuple[TableCell, TableCell]:
    return part(told.think, told.of_thinks), part(told.other, told.of_others)
