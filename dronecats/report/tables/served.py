"""At which rate the pilots were served, and what the host took from it. Paper, "Throughput sensitivity"."""

from dronecats.report import names
from dronecats.report.blocks import Lineup
from dronecats.report.entries import NAME, NONE, count, part, quantile, steps
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant

QUANTILES = (5, 25, 50, 75, 95)  # %
COLUMNS = (
    NAME,
    TableColumn(name="steps", title="Steps"),
    *(TableColumn(name=f"rate_{q}_hz", title=f"{q} %", group="Control rate", unit="Hz", decimals=2)
      for q in QUANTILES),
    *(TableColumn(name=f"latency_{q}_s", title=f"{q} %", group="Latency", unit="s", decimals=2) for q in (50, 95)),
    TableColumn(name="stalled_steps_percent", title="Steps", group="Held up by the host", unit="%", decimals=1),
    TableColumn(name="stalled_flights", title="Flights", group="Held up by the host"),
)  # fmt: skip


def served(lineup: Lineup) -> ReportTable | None:
    """Return the quantiles of rate and latency over all steps, and how many steps the host held up."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        rates, latencies = (steps(entrant.scored, name) for name in (names.RATE, names.LATENCY))
        if not rates:
            return None
        told = [each for each in entrant.scored if each.host_stalls is not None]
        stalled = sum(each.host_stalls or 0 for each in told)
        asked = sum(each.usage.questions for each in told)
        return [
            count(len(rates)),
            *(quantile(rates, q / 100) for q in QUANTILES),
            *(quantile(latencies, q / 100) for q in (50, 95)),
            part(stalled, asked),
            count(sum(bool(each.host_stalls) for each in told)) if told else NONE,
        ]

    blocks = lineup.blocks(COLUMNS, row)
    if not blocks:
        return None
    return ReportTable(
        name="served",
        title="Served control rate",
        caption=(
            "Decisions per second of vehicle time, and the vehicle time that replies took, as quantiles over the steps"
            " of all scored flights. Held up: steps that the host, and not the model, delayed, as a simulator that"
            " falls behind does; only flights in real time tell."
        ),
        columns=COLUMNS,
        blocks=blocks,
        command=lineup.command,
    )
