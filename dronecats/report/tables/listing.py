"""Every table of the report, in its order."""

from collections.abc import Sequence

from dronecats.judge.metrics.metric import Metric
from dronecats.report.report_data import ReportData
from dronecats.report.table import ReportTable
from dronecats.report.tables.comparison import comparison, variance
from dronecats.report.tables.measures import grounding, own, replies, served, thinking
from dronecats.report.tables.outcomes import approaching, commanding, declarations, drones, failures, main, per_map
from dronecats.report.tables.setup import costs, setup

TABLES = (
    main, per_map, approaching, failures, commanding, drones, variance, comparison, declarations, thinking, grounding,
    replies, served, costs, setup,
)  # fmt: skip


def tables(data: ReportData, metrics: Sequence[Metric] = ()) -> tuple[ReportTable, ...]:
    """Return the tables that there is something to tell in; `metrics` are the user's own."""
    made = (table(data) for table in (*TABLES, own(metrics)))
    return tuple(table for table in made if table is not None and table.rows)
