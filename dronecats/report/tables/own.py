"""Metrics of the user's own, cell by cell."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace

from dronecats.judge.metrics.metric import Metric
from dronecats.report.blocks import Lineup, titled
from dronecats.report.entries import NAME, PERCENT, mean, part, percent, quantile, steps
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant
from episodes.records.record import CELLS


def own(metrics: Sequence[Metric]) -> Callable[[Lineup], ReportTable | None]:
    """Return what makes the table of these metrics; of none it makes none."""

    def table(lineup: Lineup) -> ReportTable | None:
        cells = lineup.cells(CELLS)
        if not metrics or not cells:
            return None
        columns = [NAME]
        for metric in metrics:
            columns += [_column(metric, cell, lineup) for cell in cells]

        def row(entrant: Entrant) -> list[TableCell] | None:
            told = [_cell(m, [e for e in entrant.scored if e.cell == cell]) for m in metrics for cell in cells]
            return told if any(cell.value is not None for cell in told) else None

        blocks = lineup.blocks(columns, row)
        said = tuple(f"{metric.title}: {metric.definition}." for metric in metrics)
        return ReportTable(
            name="own",
            title="Metrics of our own",
            caption="Means over the scored flights; of what is measured step by step, the median over all steps.",
            columns=tuple(columns),
            blocks=blocks,
            notes=said,
            command=lineup.command,
        )

    return table


def _column(metric: Metric, cell: str, lineup: Lineup) -> TableColumn:
    unit = "%" if metric.is_share else "" if metric.unit in ("count", "ratio") else metric.unit
    return TableColumn(
        name=f"{cell.replace('-', '_')}_{metric.name}{'_percent' if metric.is_share else ''}",
        title=titled(cell),
        group=metric.title,
        unit=unit,
        decimals=0 if metric.is_share else _decimals(metric, lineup),
        better=metric.better,
        cell=cell,
    )


def _cell(metric: Metric, flown: Sequence[ScoredEpisode]) -> TableCell:
    if metric.level == "step":
        every = steps(flown, metric.name)
        return part(int(sum(every)), len(every)) if metric.is_share else quantile(every, 0.5)
    if metric.is_share and all(each.values.get(metric.name) in (None, False, True) for each in flown):
        return percent(flown, metric.name)
    told = mean(flown, metric.name)
    return replace(told, value=PERCENT * told.value) if metric.is_share and isinstance(told.value, float) else told


def _decimals(metric: Metric, lineup: Lineup) -> int:
    """Return as many as show about three digits."""
    told = [abs(value) for each in lineup.episodes if isinstance(value := each.values.get(metric.name), int | float)]
    size = statistics.median(told) if told else 1.0
    return 0 if size >= 100 else 1 if size >= 10 else 2
