"""All that was flown in some runs, one row an episode: the table from which reports, comparisons and SQL are made."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from dronecats.judge.metrics.deliberation import StepOutlook, outlooks
from dronecats.judge.metrics.failure_mode import failure_mode
from dronecats.judge.metrics.judging import of_each
from dronecats.judge.metrics.metric import Metric, MetricValue
from dronecats.judge.metrics.registry import METRICS, value_of
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun, recorded_runs
from dronecats.report.results.identity import record_digest, served
from dronecats.report.results.usage import NONE_TOLD, Usage, usage
from foundation.errors import UsageError
from foundation.protocol import RADIUS_M
from foundation.run_folder.results import SCORED, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredEpisode:
    """One flight of one episode, with every metric of the whole episode."""

    run: RecordedRun
    folder: Path
    episode: str  # id of its record
    map: str
    cell: str
    verdict: Verdict | None  # None: its logs are damaged
    values: Mapping[str, MetricValue]  # by the metric's name
    error: str | None  # why it is nobody's score; None: it is scored
    steps: Mapping[str, tuple[MetricValue, ...]] = field(
        default_factory=dict
    )  # by the metric's name, a value a decision
    mode: str | None = None  # how it ended, success or its failure mode; None: it is nobody's score
    outlooks: tuple[StepOutlook, ...] = ()  # its steps beside one another, for what a think bought
    host_stalls: int | None = None  # steps that the host held up; None: not told, as in lockstep
    left_out: str | None = None  # why the reader of a report does not want it counted
    usage: Usage = NONE_TOLD
    record_sha256: str = ""  # of the record that was flown; empty: there is none
    served: tuple[str, ...] = ()  # models that answered, in the vendors' words; empty: not told

    @property
    def scored(self) -> bool:
        """Whether it counts: what the infrastructure broke is nobody's success and nobody's failure."""
        return self.verdict is not None and self.verdict.outcome in SCORED and self.left_out is None

    @property
    def success(self) -> bool:
        """Whether it succeeded."""
        return self.scored and self.verdict is not None and self.verdict.outcome == "success"


@dataclass(frozen=True, slots=True, kw_only=True)
class Collection:
    """Runs with all of their episodes."""

    runs: tuple[RecordedRun, ...]
    episodes: tuple[ScoredEpisode, ...]  # in the order of the runs, then by name


def collect(
    paths: Iterable[Path],
    delta_m: float = RADIUS_M,
    metrics: Sequence[Metric] = tuple(METRICS.values()),
    on_episode: Callable[[ScoredEpisode], None] = lambda scored: None,
    processes: int | None = None,
) -> Collection:
    """Return what stands in these folders. One damaged episode spoils no other. Raises UsageError.

    It is read by so many processes; None: by as many as pay.
    """
    runs = recorded_runs(paths)
    folders = [(run, folder) for run in runs for folder in run.episodes]

    def read(number: int) -> ScoredEpisode:
        run, folder = folders[number]
        scored = scored_episode(run, folder, delta_m, metrics)
        return replace(scored, run=replace(run, configuration={}, episodes=()))  # which need not be sent here

    scored = []
    for (run, _), each in zip(folders, of_each(read, range(len(folders)), processes), strict=True):
        scored.append(replace(each, run=run))
        on_episode(scored[-1])
    return Collection(runs=tuple(runs), episodes=tuple(scored))


def scored_episode(run: RecordedRun, folder: Path, delta_m: float, metrics: Sequence[Metric]) -> ScoredEpisode:
    """Return one episode of a run with its metrics. Raises UsageError where one of the user's own breaks."""
    try:
        flown = RecordedFlight.read(folder, delta_m)
    except UsageError as damage:
        return ScoredEpisode(
            run=run, folder=folder, episode=folder.resolve().name, map="", cell="", verdict=None, values={},
            error=str(damage),
        )  # fmt: skip
    verdict = flown.verdict
    return ScoredEpisode(
        run=run,
        folder=folder,
        episode=flown.id,
        map=flown.map,
        cell=flown.cell,
        verdict=verdict,
        values=dict(_of_the_whole(flown, metrics)),
        error=None if verdict.outcome in SCORED else verdict.error or verdict.outcome,
        steps=dict(_of_steps(flown, metrics)),
        mode=failure_mode(flown),
        outlooks=tuple(outlooks(flown)),
        host_stalls=_host_stalls(flown),
        usage=usage(flown),
        record_sha256=record_digest(flown.record) if flown.record else "",
        served=served(folder),
    )


def without_stalled(collection: Collection) -> Collection:
    """Return the collection with every flight that the host held up left uncounted."""
    kept = (
        replace(each, left_out="the host held it up", error=f"the host held it up on {each.host_stalls} steps")
        if each.scored and each.host_stalls
        else each
        for each in collection.episodes
    )
    return replace(collection, episodes=tuple(kept))


def _host_stalls(flown: RecordedFlight) -> int | None:
    told = any(isinstance(decision.host_lag_s, float) for decision in flown.logs.decisions)
    stalls = flown.verdict.host_stalls
    return stalls if isinstance(stalls, int) else 0 if told else None


def _of_the_whole(flown: RecordedFlight, metrics: Sequence[Metric]) -> Iterator[tuple[str, MetricValue]]:
    for metric in metrics:
        value = value_of(metric, flown) if metric.level == "episode" else ()
        if value is None or isinstance(value, bool | float | int):
            yield metric.name, value


def _of_steps(flown: RecordedFlight, metrics: Sequence[Metric]) -> Iterator[tuple[str, tuple[MetricValue, ...]]]:
    for metric in metrics:
        values = value_of(metric, flown) if metric.level == "step" else None
        if isinstance(values, Sequence):
            yield metric.name, tuple(values)
