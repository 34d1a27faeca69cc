"""What the page knows when it opens: who flew, every episode with its outcome and metrics, the tables."""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dronecats import __version__
from dronecats.judge.metrics.registry import METRICS
from dronecats.judge.metrics.value import MetricValue
from dronecats.report.page.ground import GroundPicture
from dronecats.report.page.pictures import rendered
from dronecats.report.page.told_tables import PageTable, page_table
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.report_table import ReportTable
from dronecats.report.results.collection import Collection, ScoredEpisode
from dronecats.report.results.entrants import entrants

RESERVED = ("of",)  # first words of addresses that name no run
CELLS = ("approaching", "searching", "tracking", "search-and-track", "commanding")  # in the order of the paper
TOLD = ("command", "scripted", "latency", "rate_hz", "parser", "drones", "seed", "seconds", "full")  # of a flight


@dataclass(frozen=True, slots=True, kw_only=True)
class PageEntrant:
    """Who flew, under which settings: runs that differ in their seed alone."""

    key: str
    title: str
    model: bool  # a built-in pilot is none
    runs: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRun:
    """One run folder."""

    key: str
    entrant: int
    seed: int
    rendered: bool  # whether its frames show anything
    settings: tuple[tuple[str, str], ...]  # as words


@dataclass(frozen=True, slots=True, kw_only=True)
class PageEpisode:
    """One flight of one episode."""

    key: str
    run: int
    id: str
    map: str
    cell: str
    outcome: str
    mode: str | None  # how it ended, success or its failure mode
    counted: bool  # it is somebody's score, and nobody has left it out
    error: str | None
    steps: int | None
    declarations: int | None
    ground: str  # key of the picture of its map; empty: there is none
    shown: bool  # whether its steps can be looked at
    values: tuple[MetricValue, ...]  # of the metrics, in their order


@dataclass(frozen=True, slots=True, kw_only=True)
class PageMetric:
    """What is measured of every flight."""

    name: str
    title: str
    unit: str
    definition: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PageIndex:
    """All that is read when the page opens."""

    made: str
    cells: tuple[str, ...]
    metrics: tuple[PageMetric, ...]
    entrants: tuple[PageEntrant, ...]
    runs: tuple[PageRun, ...]
    episodes: tuple[PageEpisode, ...]
    tables: tuple[PageTable, ...]
    grounds: dict[str, GroundPicture]
    embedded: bool
    pictures: str  # what is to be said of pictures that were left out; empty: none was


def keys(names: Sequence[str]) -> list[str]:
    """Return a word for each name that is a file's name and a part of an address anywhere, no two alike."""
    taken: set[str] = set(RESERVED)
    found = []
    for name in names:
        word = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip(".-") or "run"
        key, count = word, 2
        while key.lower() in taken:
            key, count = f"{word}-{count}", count + 1
        taken.add(key.lower())
        found.append(key)
    return found


def page_runs(collection: Collection) -> tuple[list[PageRun], list[PageEntrant]]:
    """Return the runs in the order of the collection, and who flew them in that of the tables.

    Raises UsageError when two records bear one id.
    """
    places = {run.folder: number for number, run in enumerate(collection.runs)}
    found = entrants(collection, pool_anyway=True)
    flown_by = {run.folder: number for number, entrant in enumerate(found) for run in entrant.runs}
    run_keys = keys([run.folder.name for run in collection.runs])
    runs = [
        PageRun(key=key, entrant=flown_by[run.folder], seed=run.seed, rendered=rendered(run), settings=_settings(run))
        for key, run in zip(run_keys, collection.runs, strict=True)
    ]
    flown = [
        PageEntrant(
            key=key,
            title=entrant.label,
            model=entrant.is_model,
            runs=tuple(places[run.folder] for run in entrant.runs),
        )
        for key, entrant in zip(keys([entrant.label for entrant in found]), found, strict=True)
    ]
    return runs, flown


def page_episode(
    scored: ScoredEpisode,
    metrics: Sequence[PageMetric],
    key: str,
    run: int,
    ground: str,
    error: str | None,
    shown: bool,
) -> PageEpisode:
    """Return what the page says of a flight before its steps are looked at."""
    verdict = scored.verdict
    return PageEpisode(
        key=key,
        run=run,
        id=scored.episode,
        map=scored.map,
        cell=scored.cell,
        outcome="damaged" if verdict is None else verdict.outcome,
        mode=scored.mode,
        counted=scored.scored,
        error=error,
        steps=None if verdict is None else verdict.steps,
        declarations=None if verdict is None else verdict.declarations,
        ground=ground,
        shown=shown,
        values=tuple(_seen(scored.values.get(metric.name)) for metric in metrics),
    )


def page_index(
    metrics: Sequence[PageMetric],
    runs: Sequence[PageRun],
    flown_by: Sequence[PageEntrant],
    episodes: Sequence[PageEpisode],
    tables: Sequence[ReportTable],
    grounds: dict[str, GroundPicture],
    *,
    embedded: bool,
    pictures: str,
) -> PageIndex:
    """Return the index of a page."""
    flown = {episode.cell for episode in episodes}
    places = {entrant.title: number for number, entrant in enumerate(flown_by)}
    return PageIndex(
        made=f"dronecats {__version__}",
        cells=(*(cell for cell in CELLS if cell in flown), *sorted(flown - {*CELLS, ""})),
        metrics=tuple(metrics),
        entrants=tuple(flown_by),
        runs=tuple(runs),
        episodes=tuple(episodes),
        tables=tuple(page_table(table, places) for table in tables),
        grounds=grounds,
        embedded=embedded,
        pictures=pictures,
    )


def script_json(value: Any) -> str:
    """Return a value as JSON that may stand in a script element or file, whatever is in its texts.

    Of a dataclass the fields that are None are left out.
    """
    text = json.dumps(value, default=_fields, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _fields(value: Any) -> dict[str, Any]:
    names = type(value).__dataclass_fields__
    return {name: told for name in names if (told := getattr(value, name)) is not None}


def page_metrics(collection: Collection) -> list[PageMetric]:
    """Return what is measured of every flight: the registry's metrics, then one's own, of which the name is known."""
    ours = [each for each in METRICS.values() if each.level == "episode"]
    own = {name for scored in collection.episodes for name in scored.values} - {*METRICS}
    return [
        *(PageMetric(name=each.name, title=each.title, unit=each.unit, definition=each.definition) for each in ours),
        *(PageMetric(name=name, title=name, unit="", definition="a metric of one's own") for name in sorted(own)),
    ]


def _seen(value: MetricValue | None) -> MetricValue:
    """Return a value as it can be shown: to five digits, and None for what is no number."""
    if value is None or isinstance(value, bool):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _settings(run: RecordedRun) -> tuple[tuple[str, str], ...]:
    """Return a run's settings as words, those that it has."""
    flight, simulated = run.flight, run.flight.get("simulated")
    model, commander = flight.get("model"), flight.get("commander")
    told = {key: flight.get(key) for key in TOLD}
    if isinstance(simulated, dict):
        told.update({key: simulated.get(key) for key in ("airframe", "autopilot")})
    if isinstance(model, dict):
        told.update({key: model.get(key) for key in ("temperature", "top_p", "max_tokens", "axis_order")})
    if isinstance(commander, dict):
        told["commander"] = f"{commander.get('provider')}/{commander.get('name')}"
    told.update(
        {
            key: run.configuration.get(key)
            for key in ("clock", "disturbed", "served_rate_hz", "prompt_name", "prompt_sha256")
        }
    )
    return tuple((key, str(value)) for key, value in told.items() if value is not None and value != "")
