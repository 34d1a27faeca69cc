"""Every table of the report, in its order."""

from collections.abc import Sequence

from dronecats.judge.metrics.metric import Metric
from dronecats.report.blocks import Lineup
from dronecats.report.report_table import ReportTable
from dronecats.report.tables.commanding import commanding, drones
from dronecats.report.tables.comparison import comparison
from dronecats.report.tables.costs import costs
from dronecats.report.tables.failures import failures
from dronecats.report.tables.grounding import grounding
from dronecats.report.tables.outcomes import approaching, declarations, main, per_map
from dronecats.report.tables.own import own
from dronecats.report.tables.replies import replies
from dronecats.report.tables.served import served
from dronecats.report.tables.setup import setup
from dronecats.report.tables.thinking import thinking
from dronecats.report.tables.variance import variance

TABLES = (
    main, per_map, approaching, failures, commanding, drones, variance, comparison, declarations, thinking, grounding,
    replies, served, costs, setup,
)  # fmt: skip


def tables(lineup: Lineup, metrics: Sequence[Metric] = ()) -> tuple[ReportTable, ...]:
    """Return the tables that there is something to tell in; `metrics` are the user's own."""
    made = (table(lineup) for table in (*TABLES, own(metrics)))
    return tuple(table for table in made if table is not None and table.rows)
