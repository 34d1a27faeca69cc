"""Reads all episodes of some runs, one row per episode. Reports, comparisons and studies use these rows.

Flights can be left out by the value of a metric, for example flights with more than two estimator resets. By default no
flight is left out. Reports state every such rule, because a rule that leaves out more flights of one pilot than of
another biases a comparison.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from msgspec import UNSET

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.audit import StepOutlook, step_outlooks
from dronecats.judge.metrics.failure_mode import failure_mode
from dronecats.judge.metrics.judging import METRICS, parallel_map, values_of
from dronecats.judge.metrics.metric import Metric, MetricValue
from dronecats.report.recorded.run import RecordedRun, recorded_runs
from dronecats.report.results.identity import record_digest, served
from foundation.errors import UsageError
from foundation.protocol import RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.reading import exchanges, json_object, rows
from foundation.run_folder.results import SCORED, Verdict
from foundation.run_folder.rows import Decision
from foundation.wording import did_you_mean, nearest


@dataclass(frozen=True, slots=True)
class Usage:
    """Numbers of answered questions and tokens of an episode. A fleet's joint question counts once."""

    questions: int = 0
    tokens_in: int | None = None  # None: not logged for any question
    tokens_out: int | None = None
    commander_questions: int = 0
    commander_in: int | None = None  # tokens of the questions to the commander
    commander_out: int | None = None
    cached: int | None = None  # part of tokens_in that came from the vendor's cache
    reasoning: int | None = None  # part of tokens_out that was used for reasoning
    endpoints: tuple[str, ...] = ()  # endpoints that a router chose, in the order of their first answers


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredEpisode:
    """One flight of one episode, with its metrics."""

    run: RecordedRun
    folder: Path
    episode: str  # id of the episode record
    map: str
    cell: str
    verdict: Verdict | None  # None: the logs are damaged
    values: Mapping[str, MetricValue]  # by the metric's name
    error: str | None  # why the flight is not scored; None: it is scored
    # by the metric's name, a value per decision
    steps: Mapping[str, tuple[MetricValue, ...]] = field(default_factory=dict)
    mode: str | None = None  # success, or the failure mode; None: the flight is not scored
    step_outlooks: tuple[StepOutlook, ...] = ()  # for the comparison of `think` with other actions, an entry per step
    host_stalls: int | None = None  # steps that the host delayed; None: not logged, as in lockstep
    left_out: str | None = None  # why the flight is left out of a report; None: it is not
    usage: Usage = Usage()
    record_sha256: str = ""  # of the flown record; empty: there is none
    served: tuple[str, ...] = ()  # models that answered, as the vendors name them; empty: not logged

    @property
    def scored(self) -> bool:
        """Whether the flight counts: it is a success or a failure, and is not left out."""
        return self.verdict is not None and self.verdict.outcome in SCORED and self.left_out is None

    @property
    def success(self) -> bool:
        """Whether the flight counts and is a success."""
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
    """Return the runs in these folders. A damaged episode does not affect the others. Raises UsageError.

    `processes`: number of reading processes; None: as many as are useful.
    """
    runs = recorded_runs(paths)
    folders = [(run, folder) for run in runs for folder in run.episodes]

    def read(number: int) -> ScoredEpisode:
        run, folder = folders[number]
        scored = scored_episode(run, folder, delta_m, metrics)
        return replace(scored, run=replace(run, configuration={}, episodes=()))  # the parent process has both fields

    episodes = []
    for (run, _), scored in zip(folders, parallel_map(read, range(len(folders)), processes), strict=True):
        episodes.append(replace(scored, run=run))
        on_episode(episodes[-1])
    return Collection(runs=tuple(runs), episodes=tuple(episodes))


def scored_episode(run: RecordedRun, folder: Path, delta_m: float, metrics: Sequence[Metric]) -> ScoredEpisode:
    """Return one episode of a run with its metrics. Raises UsageError when a metric of the user fails."""
    try:
        flight = JudgedFlight.read(folder, delta_m)
    except UsageError as damage:
        return _damaged_episode(run, folder, str(damage))
    verdict, values = flight.verdict, values_of(flight, metrics)
    return ScoredEpisode(
        run=run,
        folder=folder,
        episode=flight.id,
        map=flight.map,
        cell=flight.cell,
        verdict=verdict,
        values={name: value for name, value in values.items() if not isinstance(value, Sequence)},
        error=None if verdict.outcome in SCORED else verdict.error or verdict.outcome,
        steps={name: tuple(value) for name, value in values.items() if isinstance(value, Sequence)},
        mode=failure_mode(flight),
        step_outlooks=tuple(step_outlooks(flight)),
        host_stalls=_host_stalls(flight),
        usage=_usage(flight.logs.decisions, flight.folder),
        record_sha256=record_digest(flight.record) if flight.record else "",
        served=served(folder),
    )


def _damaged_episode(run: RecordedRun, folder: Path, error: str) -> ScoredEpisode:
    """Return an episode with damaged logs. Its record, if readable, says in which cell it is counted as not scored."""
    record = json_object(folder / layout.EPISODE) or {}
    return ScoredEpisode(
        run=run,
        folder=folder,
        episode=str(record.get("id", folder.resolve().name)),
        map=str(record.get("map", "")),
        cell=str(record.get("cell", "")),
        verdict=None,
        values={},
        error=error,
        record_sha256=record_digest(record) if record else "",
    )


def _host_stalls(flight: JudgedFlight) -> int | None:
    is_logged = any(isinstance(decision.host_lag_s, float) for decision in flight.logs.decisions)
    stalls = flight.verdict.host_stalls
    return stalls if isinstance(stalls, int) else 0 if is_logged else None


def usage_of(folder: Path) -> Usage:
    """Return the usage of an episode by its folder. Raises UsageError for a damaged log."""
    return _usage(rows(folder / layout.DECISIONS, Decision), folder)


def _usage(decisions: Iterable[Decision], folder: Path) -> Usage:
    """Return the usage. A joint reply is in the log once per drone, but counts once.

    Confirmations are replies of the commander, so they are not counted as replies of the pilot.
    """
    steps = {decision.step: decision for decision in decisions if decision.confirmed_by is UNSET}.values()
    try:
        answered = [exchange for exchange in exchanges(folder) if exchange.reply is not None]
    except UsageError:  # a damaged commander.jsonl affects no score
        answered = []
    return Usage(
        questions=len(steps),
        tokens_in=_sum([step.tokens_in for step in steps]),
        tokens_out=_sum([step.tokens_out for step in steps]),
        commander_questions=len(answered),
        commander_in=_sum([exchange.tokens_in for exchange in answered]),
        commander_out=_sum([exchange.tokens_out for exchange in answered]),
        cached=_sum([None if step.tokens_cached is UNSET else step.tokens_cached for step in steps]),
        reasoning=_sum([None if step.tokens_reasoning is UNSET else step.tokens_reasoning for step in steps]),
        endpoints=tuple(dict.fromkeys(str(step.endpoint) for step in steps if step.endpoint is not UNSET)),
    )


def _sum(counts: list[int | None]) -> int | None:
    logged = [count for count in counts if count is not None]
    return sum(logged) if logged else None


def without_stalled(collection: Collection) -> Collection:
    """Return the collection; flights in which the host computer delayed steps are marked as left out."""
    kept = (
        replace(flight, left_out="the host delayed steps", error=f"the host delayed {flight.host_stalls} steps")
        if flight.scored and flight.host_stalls
        else flight
        for flight in collection.episodes
    )
    return replace(collection, episodes=tuple(kept))


@dataclass(frozen=True, slots=True)
class Exclusion:
    """A rule that leaves out the flights whose metric is above a limit."""

    metric: str  # name in the registry of metrics
    most: float  # in the metric's unit

    def __str__(self) -> str:
        return f"{self.metric} above {self.most:g}"

    def value(self, scored: ScoredEpisode) -> float | None:
        """Return the metric of a flight; None: unknown."""
        value = scored.values.get(self.metric)
        return None if value is None else float(value)

    def excludes(self, scored: ScoredEpisode) -> bool:
        value = self.value(scored)
        return value is not None and value > self.most


def parse_exclusion(text: str) -> Exclusion:
    """Return the exclusion of `--exclude-above METRIC=N`. Raises UsageError."""
    name, equals, number = text.partition("=")
    example = "for example estimator_resets=2"
    if not equals:
        raise UsageError(f"--exclude-above must be METRIC=N, {example}, got '{text:.60}'")
    names = [metric.name for metric in METRICS.values() if metric.level == "episode"]
    if name not in names:
        near = nearest(name, names)
        hint = did_you_mean(near) if near else f"{example}."
        raise UsageError(f"--exclude-above: '{name:.60}' is not a metric of an episode: {hint} See: docs/metrics.md")
    try:
        most = float(number)
    except ValueError:
        most = math.nan
    if not math.isfinite(most):
        raise UsageError(f"--exclude-above {name} needs a number, {example}, got '{number:.60}'")
    return Exclusion(name, most)


def exclude(collection: Collection, exclusions: Sequence[Exclusion]) -> Collection:
    """Return the collection; flights that an exclusion excludes are marked as left out."""
    return replace(collection, episodes=tuple(_excluded(flight, exclusions) for flight in collection.episodes))


def _excluded(scored: ScoredEpisode, exclusions: Sequence[Exclusion]) -> ScoredEpisode:
    hit = next((exclusion for exclusion in exclusions if exclusion.excludes(scored)), None) if scored.scored else None
    if hit is None:
        return scored
    error = f"left out: {hit.metric} is {hit.value(scored):g}, above {hit.most:g}"
    return replace(scored, left_out=str(hit), error=error)


def exclusion_sentences(flights: Sequence[ScoredEpisode], exclusions: Sequence[Exclusion]) -> Iterator[str]:
    """Yield the report's sentences about the flights that are left out."""
    left_out = Counter(flight.left_out for flight in flights if flight.left_out)
    for exclusion in exclusions:  # also list exclusions that left out no flight
        left_out.setdefault(str(exclusion), 0)
    for reason, count in left_out.items():
        yield f"Left out: {count} of {len(flights)} flights: {reason}."
    for exclusion in exclusions:
        unmeasured = sum(flight.scored and exclusion.value(flight) is None for flight in flights)
        if unmeasured:
            yield f"{unmeasured} flights have no {exclusion.metric} and are counted."


@dataclass(frozen=True, slots=True)
class Unflown:
    """The missing flights of one benchmark. Scores of an incomplete benchmark do not represent its suite."""

    folder: Path  # the folder with bench.json
    flights: int  # number of flights of the benchmark
    missing: int  # number of these flights that have no folder


def unflown(runs: Iterable[RecordedRun]) -> list[Unflown]:
    """Return the benchmarks with missing flights. A damaged bench.json counts as empty."""
    episode_ids: dict[Path, dict[str, set[str]]] = {}  # benchmark → run → ids of its episodes
    for run in runs:
        episode_ids.setdefault(run.folder.parent, {})[run.folder.name] = {folder.name for folder in run.episodes}
    incomplete = []
    for folder, present in episode_ids.items():
        benchmark = json_object(folder / layout.BENCH) or {}
        listed = [run for run in benchmark.get("runs") or () if isinstance(run, dict)]
        planned = {str(run.get("name")): set(run.get("episodes") or ()) for run in listed}
        if missing := sum(len(ids - present.get(name, set())) for name, ids in planned.items()):
            incomplete.append(Unflown(folder, sum(map(len, planned.values())), missing))
    return incomplete
