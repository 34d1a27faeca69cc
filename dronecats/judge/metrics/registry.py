"""The registry of all metrics, for the docs' table, reports, `--json` and SQL; and a user's own metrics.

A user's metrics are in a Python file with `METRICS`, as in the modules beside this one. The file is executed, so it
must be trusted.
"""

import importlib.util
import math
from collections.abc import Sequence
from pathlib import Path

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics import fleets, outcomes, pointing, replies
from dronecats.judge.metrics.metric import Metric, MetricValue
from foundation.errors import UsageError

METRICS: dict[str, Metric] = {
    metric.name: metric for metric in (*outcomes.METRICS, *replies.METRICS, *pointing.METRICS, *fleets.METRICS)
}


def own_metrics(file: Path) -> tuple[Metric, ...]:
    """Return the metrics of a file. Raises UsageError if the file has no valid metrics."""
    if not file.is_file():
        raise UsageError(f"--metric: there is no file {file}")
    module = importlib.util.module_from_spec(
        importlib.util.spec_from_loader(f"own_metrics_{file.stem}", loader=None)  # type: ignore[arg-type]
    )
    module.__file__ = str(file)
    try:
        exec(compile(file.read_bytes(), str(file), "exec"), vars(module))
    except Exception as broken:
        raise UsageError(f"--metric: {file} cannot be run: {type(broken).__name__}: {broken}") from None
    metrics = getattr(module, "METRICS", None)
    if not isinstance(metrics, tuple) or not metrics or not all(isinstance(metric, Metric) for metric in metrics):
        raise UsageError(f"--metric: {file} has no METRICS = (Metric(…), …). See: dronecats/judge/metrics/outcomes.py")
    for metric in metrics:
        _check(metric, file)
    return metrics


def value_of(metric: Metric, flight: JudgedFlight) -> MetricValue | Sequence[MetricValue]:
    """Return the value of a metric for an episode. Raises UsageError if a user's metric fails."""
    if METRICS.get(metric.name) is metric:
        return metric.of(flight)
    try:
        value = metric.of(flight)
    except Exception as broken:
        raise UsageError(f"--metric: {metric.name} of {flight.id} breaks: {type(broken).__name__}: {broken}") from None
    several = isinstance(value, Sequence) and not isinstance(value, str)
    if metric.level == "step" and not (several and len(value) == len(flight.logs.decisions)):  # type: ignore[arg-type]
        raise UsageError(f"--metric: {metric.name} of {flight.id} is not a value per decision")
    values = value if isinstance(value, Sequence) else [value]
    if (several and metric.level == "episode") or not all(map(_is_value, values)):
        raise UsageError(f"--metric: {metric.name} of {flight.id} is no number, True, False or None: {value!r:.60}")
    return value


def _check(metric: Metric, file: Path) -> None:
    if not (isinstance(metric.name, str) and metric.name.isidentifier()):
        raise UsageError(f"--metric: {file}: {metric.name!r} is no name: letters, digits and _ are wanted")
    if metric.name in METRICS:
        raise UsageError(f"--metric: {file}: {metric.name} is the name of one of ours")
    if metric.level not in ("episode", "step"):
        raise UsageError(f"--metric: {file}: the level of {metric.name} is neither episode nor step")
    if not callable(metric.of):
        raise UsageError(f"--metric: {file}: {metric.name} measures nothing: its `of` is no function")
    if not metric.definition or not metric.unit:
        raise UsageError(f"--metric: {file}: {metric.name} lacks its definition or its unit")


def _is_value(value: object) -> bool:
    return value is None or isinstance(value, bool | int) or (isinstance(value, float) and math.isfinite(value))
