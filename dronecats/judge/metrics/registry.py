"""Every metric that there is: the docs' table, the reports, `--json` and SQL go by this list."""

from dronecats.judge.metrics import costs, fleets, outcomes, pointing, replies, trajectories
from dronecats.judge.metrics.metric import Metric

METRICS: dict[str, Metric] = {
    metric.name: metric
    for room in (outcomes, trajectories, costs, replies, pointing, fleets)
    for metric in room.METRICS
}  # fmt: skip
