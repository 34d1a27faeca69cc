"""Synthetic runs and scored episodes in memory, for tests."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.judge.episode import NOTHING
from dronecats.judge.judged_flight import outcome
from dronecats.judge.metrics.metric import MetricValue
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.collection import Collection, ScoredEpisode

NO_VERDICT = outcome(NOTHING)
MODEL = {"provider": "vllm", "name": "Qwen/Qwen3.5-9B", "temperature": 0.4, "max_tokens": 8192}
TOLD: dict[str, Any] = {
    "agent": "dronecats.run.pilot.papers_agent",
    "prompt_sha256": "c" * 64,
    "code_sha256": "a" * 64,
    "clock": "lockstep",
    "camera": {"width": 640, "height": 480, "fov_deg": 90.0},
    "protocol": {"RADIUS_M": 5.0, "CAP_S": 300.0},
    "suite": {"name": "one-drone", "version": 1, "sha256": "5" * 64},
    "versions": {"dronecats": "0.1.0", "python": "3.11.7", "numpy": "2.4.6"},
}


def a_run(
    name: str = "runs/a",
    pilot: str | None = "vision",
    model: Mapping[str, Any] | None = None,
    seed: int = 0,
    flight: Mapping[str, Any] | None = None,
    **configuration: Any,
) -> RecordedRun:
    """Return a run without flights. The spec `model` replaces the pilot."""
    flight_fields = {"pilot": None if model else pilot, "model": model, "seed": seed, "command": "flat",
             "latency": "fixed:0.5", "parser": "strict", "replay": None, "accounts": {}, **(flight or {})}  # fmt: skip
    return RecordedRun(folder=Path(name), configuration={**TOLD, "flight": flight_fields, **configuration}, episodes=())


def named(name: str, **fields: Any) -> dict[str, Any]:
    """Return a model's spec."""
    return {**MODEL, "name": name, **fields}


def an_episode(run: RecordedRun, name: str, outcome: str = "failure", **fields: Any) -> ScoredEpisode:
    """Return a flight of the episode MAP-CELL-NUMBER. Fields that `ScoredEpisode` lacks are fields of its verdict."""
    place, _, rest = name.partition("-")
    verdict = {key: fields.pop(key) for key in list(fields.keys() - ScoredEpisode.__dataclass_fields__)}
    success = outcome == "success"
    values: dict[str, MetricValue] = {"success": success, "declared": success, "oracle_success": success}
    values |= fields.pop("values", {})
    return ScoredEpisode(
        run=run,
        folder=run.folder / name,
        episode=name,
        map=place,
        cell=rest.rpartition("-")[0],
        verdict=replace(NO_VERDICT, **{"outcome": outcome, "success": success, "error": None, **verdict}),
        values=values if outcome in ("success", "failure") else {},
        error=None if outcome in ("success", "failure") else "it broke",
        **{"record_sha256": "0" * 64, **fields},
    )


def flights(run: RecordedRun, outcomes: Mapping[str, str], **fields: Any) -> list[ScoredEpisode]:
    """Return an episode for each letter of `outcomes` (MAP-CELL → letters): s success, f failure, e error."""
    word = {"s": "success", "f": "failure", "e": "error"}
    return [
        an_episode(run, f"{group}-{number:02}", word[letter], **fields)
        for group, letters in outcomes.items()
        for number, letter in enumerate(letters, 1)
    ]


def collected(*episodes: Sequence[ScoredEpisode]) -> Collection:
    """Return the collection of these flights, their runs in order of first appearance."""
    every = [each for some in episodes for each in some]
    runs = list({each.run.folder: each.run for each in every}.values())
    return Collection(runs=tuple(runs), episodes=tuple(every))
