"""Registers all metrics, loads a user's own metrics, and judges many episodes.

METRICS is the source for the table in the docs, for reports, `--json` and SQL. A user's metrics are in a Python file
that defines `METRICS` like the other modules of this package. The file is executed, so it must be trusted. Episodes are
judged in parallel on all cores.
"""

import gc
import importlib.util
import math
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from dronecats.judge.episode import Comparison, check_radius, compare_stored, contradictions, damaged_verdict
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics import fleets, outcomes, pointing, replies
from dronecats.judge.metrics.failure_mode import FailureMode, failure_mode
from dronecats.judge.metrics.metric import Metric, MetricValue
from foundation.errors import UsageError
from foundation.machine import cores
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.results import Verdict

METRICS: dict[str, Metric] = {
    metric.name: metric for metric in (*outcomes.METRICS, *replies.METRICS, *pointing.METRICS, *fleets.METRICS)
}


def own_metrics(file: Path) -> tuple[Metric, ...]:
    """Return the metrics of a file. Raises UsageError if the file has no valid metrics."""
    if not file.is_file():
        raise UsageError(f"--metric: file {file} does not exist")
    module = importlib.util.module_from_spec(
        importlib.util.spec_from_loader(f"own_metrics_{file.stem}", loader=None)  # type: ignore[arg-type]
    )
    module.__file__ = str(file)
    try:
        exec(compile(file.read_bytes(), str(file), "exec"), vars(module))
    except Exception as broken:
        raise UsageError(f"--metric: {file} ends in an error: {type(broken).__name__}: {broken}") from None
    metrics = getattr(module, "METRICS", None)
    if not isinstance(metrics, tuple) or not metrics or not all(isinstance(metric, Metric) for metric in metrics):
        raise UsageError(f"--metric: {file} has no METRICS = (Metric(…), …). See: dronecats/judge/metrics/outcomes.py")
    for metric in metrics:
        _check(metric, file)
    return metrics


def _value(metric: Metric, flight: JudgedFlight) -> MetricValue | Sequence[MetricValue]:
    """Return the value of a metric for an episode. Raises UsageError if a user's metric fails."""
    if METRICS.get(metric.name) is metric:
        return metric.of(flight)
    try:
        value = metric.of(flight)
    except Exception as broken:
        raise UsageError(
            f"--metric: {metric.name} of {flight.id} ends in an error: {type(broken).__name__}: {broken}"
        ) from None
    several = isinstance(value, Sequence) and not isinstance(value, str)
    if metric.level == "step" and not (several and len(value) == len(flight.logs.decisions)):  # type: ignore[arg-type]
        raise UsageError(f"--metric: {metric.name} of {flight.id} must give one value per decision")
    values = value if isinstance(value, Sequence) else [value]
    if (several and metric.level == "episode") or not all(map(_is_value, values)):
        raise UsageError(
            f"--metric: {metric.name} of {flight.id} must be a number, True, False or None; got {value!r:.60}"
        )
    return value


def _check(metric: Metric, file: Path) -> None:
    if not (isinstance(metric.name, str) and metric.name.isidentifier()):
        raise UsageError(f"--metric: {file}: {metric.name!r} cannot name a metric. Use letters, digits and _")
    if metric.name in METRICS:
        raise UsageError(f"--metric: {file}: {metric.name} is the name of a built-in metric. Choose another name")
    if metric.level not in ("episode", "step"):
        raise UsageError(f"--metric: {file}: the level of {metric.name} must be episode or step")
    if not callable(metric.of):
        raise UsageError(f"--metric: {file}: {metric.name} needs a function as `of`")
    if not metric.definition or not metric.unit:
        raise UsageError(f"--metric: {file}: {metric.name} needs a definition and a unit")


def _is_value(value: object) -> bool:
    return value is None or isinstance(value, bool | int) or (isinstance(value, float) and math.isfinite(value))


EPISODES_A_PROCESS = 50  # least number of episodes per process; fewer are not worth the start of a process
AT_ONCE = 8  # episodes that a process gets at a time
FORKS = "fork" in multiprocessing.get_all_start_methods()  # else one process: a user's metric cannot be pickled
Item = TypeVar("Item")
ItemResult = TypeVar("ItemResult")


@dataclass(frozen=True, slots=True, kw_only=True)
class Judging:
    """The options of judging."""

    delta_m: float = RADIUS_M  # m, success radius
    cap_s: float = CAP_S  # s, declarations after it do not count
    measured: bool = False  # whether all of METRICS are measured
    own: tuple[Path, ...] = ()  # files of the user's metrics, which are always measured

    def check(self) -> None:
        """Raise UsageError for invalid values, and for a file without valid metrics."""
        check_radius(self.delta_m)
        if not math.isfinite(self.cap_s) or self.cap_s <= 0:
            raise UsageError(f"--cap must be seconds above 0, got {self.cap_s:g}")
        _metrics(self)


@dataclass(frozen=True, slots=True)
class JudgedEpisode:
    """The judgement of one episode folder: its verdict, compared with its other files, and its metrics."""

    folder: Path
    verdict: Verdict
    stored: Comparison | None  # comparison with verdict.json; None: no such file, or another radius or time limit
    contradictions: tuple[str, ...] = ()  # sentences about contradictions in the logs
    mode: FailureMode | None = None  # None: not scored
    # metric name → value or values; empty for damaged logs
    values: Mapping[str, MetricValue | Sequence[MetricValue]] = field(default_factory=dict)

    @property
    def doubtful(self) -> bool:
        """Whether the stored verdict differs or the logs contradict each other."""
        return bool(self.contradictions or (self.stored and not self.stored.agrees))

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of an episode in the output of `dronecats judge --json`."""
        stored = self.stored
        return {
            **self.verdict.as_json(),
            "stored_agrees": stored.agrees if stored else None,
            "stored_differs": [*stored.differing] if stored else [],
            "stored_older": bool(stored and stored.older),
            "contradictions": [*self.contradictions],
            "failure_mode": self.mode,
            "metrics": {**self.values},
        }


def judged_episodes(folders: Sequence[Path], options: Judging, processes: int | None = None) -> Iterator[JudgedEpisode]:
    """Yield the judgement of each episode folder; damaged logs have the outcome error.

    `processes` None: chosen by the number of episodes. Raises UsageError for invalid options, and if a user's metric
    fails.
    """
    options.check()
    yield from parallel_map(partial(judged_episode, options=options), folders, processes)


def parallel_map(
    function: Callable[[Item], ItemResult], items: Sequence[Item], processes: int | None = None
) -> Iterator[ItemResult]:
    """Yield the result of a function for each item, such as an episode folder, in the order of the items.

    `processes` None: chosen by the number of items. The function is inherited by forks, so it need not be picklable.
    """
    count = min(cores(), len(items) // EPISODES_A_PROCESS) if processes is None else processes
    if count > 1 and FORKS:
        fork = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(count, mp_context=fork, initializer=_begin, initargs=(function,)) as pool:
            yield from pool.map(_call, items, chunksize=AT_ONCE)
    else:
        yield from map(function, items)


_function: Callable[[Any], Any]  # the function that a worker process calls


def _begin(function: Callable[[Any], Any]) -> None:
    global _function
    _function = function
    gc.disable()  # rows have no reference cycles, and the search for them takes a quarter of the time


def _call(item: Any) -> Any:
    return _function(item)


def judged_episode(folder: Path, options: Judging) -> JudgedEpisode:
    try:
        flight = JudgedFlight.read(folder, options.delta_m, options.cap_s)
    except UsageError as damage:
        verdict = damaged_verdict(damage, options.delta_m, options.cap_s)
        return JudgedEpisode(folder, verdict, compare_stored(folder, verdict))
    stored, values = compare_stored(folder, flight.verdict), values_of(flight, _metrics(options))
    return JudgedEpisode(folder, flight.verdict, stored, contradictions(flight), failure_mode(flight), values)


def values_of(flight: JudgedFlight, metrics: Sequence[Metric]) -> dict[str, MetricValue | Sequence[MetricValue]]:
    """Return the values of these metrics for an episode, by name. Raises UsageError if one of them fails."""
    return {metric.name: _value(metric, flight) for metric in metrics}


@cache
def _metrics(options: Judging) -> tuple[Metric, ...]:
    own = [metric for file in options.own for metric in own_metrics(file)]
    twice = {metric.name for metric in own if [m.name for m in own].count(metric.name) > 1}
    if twice:
        raise UsageError(f"--metric: two metrics have the name {min(twice)}. Rename one")
    return (*(METRICS.values() if options.measured else ()), *own)
