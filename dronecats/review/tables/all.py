"""Every table of the report, in its order."""

from collections.abc import Sequence

from dronecats.metrics.metric import Metric
from dronecats.review.lineup import Lineup
from dronecats.review.report_table import ReportTable
from dronecats.review.tables.commanding import commanding, drones
from dronecats.review.tables.comparison import comparison
from dronecats.review.tables.costs import costs
from dronecats.review.tables.failures import failures
from dronecats.review.tables.grounding import grounding
from dronecats.review.tables.outcomes import approaching, declarations, main, per_map
from dronecats.review.tables.own import own
from dronecats.review.tables.replies import replies
from dronecats.review.tables.served import served
from dronecats.review.tables.setup import setup
from dronecats.review.tables.thinking import thinking
from dronecats.review.tables.variance import variance

TABLES = (
    main, per_map, approaching, failures, commanding, drones, variance, comparison, declarations, thinking, grounding,
    replies, served, costs, setup,
)  # fmt: skip


def tables(lineup: Lineup, metrics: Sequence[Metric] = ()) -> tuple[ReportTable, ...]:
    """Return the tables that there is something to tell in; `metrics` are the user's own."""
    made = (table(lineup) for table in (*TABLES, own(metrics)))
    return tuple(table for table in made if table is not None and table.rows)
