"""Groups runs into the entrants of a table: all runs of one pilot under one setting."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dronecats.agent.names import PAPER
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.collection import Collection, ScoredEpisode
from dronecats.report.results.identity import odd_runs, refusal
from foundation.errors import UsageError

FLAT = "flat"


@dataclass(frozen=True, slots=True)
class Setting:
    """The fields that make separate entrants of one pilot; runs of one entrant must agree in everything else."""

    pilot: str
    replayed: bool  # recorded replies flew it; no model was called
    is_model: bool
    command: str  # flat, hierarchical or solo
    commander: str  # PROVIDER/NAME, or a script; empty: none
    latency: str  # the policy; it may fix the rate too
    agent: str  # paper, or another, which is never counted together with the paper's
    disturbed: str = ""  # its disturbances, in words; empty: none
    temperature: str = ""  # in words, as the three below; empty: no model, or not sent
    top_p: str = ""
    max_tokens: str = ""
    reasoning: str = ""  # fields that switch reasoning on all steps but those after a think


@dataclass(frozen=True)
class Entrant:
    """A row of the tables: all flights of a pilot under one setting."""

    label: str
    setting: Setting
    runs: tuple[RecordedRun, ...]
    episodes: tuple[ScoredEpisode, ...]  # every flight of every episode, those that are not scored too

    @property
    def is_model(self) -> bool:
        """Whether a model flew; built-in pilots and replays are never listed among models."""
        return self.setting.is_model and not self.setting.replayed

    @cached_property
    def scored(self) -> tuple[ScoredEpisode, ...]:
        """The flights that count."""
        return tuple(flight for flight in self.episodes if flight.scored)

    @cached_property
    def by_episode(self) -> Mapping[str, tuple[ScoredEpisode, ...]]:
        """The flights that count by the episode's id, in the order of their seeds."""
        flights: dict[str, list[ScoredEpisode]] = {}
        for flight in sorted(self.scored, key=lambda flight: flight.run.seed):
            flights.setdefault(flight.episode, []).append(flight)
        return {name: tuple(flights[name]) for name in sorted(flights)}


def entrants(collection: Collection, *, pool_anyway: bool = False) -> tuple[Entrant, ...]:
    """Return the entrants, models first, each in the order of the runs.

    Raises UsageError when runs of one setting are of different kinds, when a flight occurs twice, or when two records
    have one id. `pool_anyway` permits the first two; the last is never permitted.
    """
    _check_record_ids(collection.episodes)
    runs: dict[Setting, list[RecordedRun]] = {}
    for run in collection.runs:
        runs.setdefault(setting(run), []).append(run)
    by_run: dict[Path, list[ScoredEpisode]] = {}
    for flight in collection.episodes:
        by_run.setdefault(flight.run.folder, []).append(flight)
    entries = []
    for settings, members in runs.items():
        episodes = tuple(flight for run in members for flight in by_run.get(run.folder, ()))
        if not pool_anyway:
            advice = "or count them together with --pool-anyway"
            if reason := refusal(members):
                odd = ", ".join(str(run.folder) for run, _ in odd_runs(members)) or "it"
                raise UsageError(f"{reason}; leave {odd} out and report it by itself, {advice}")
            if reason := _repeated_flight(episodes):
                raise UsageError(f"{reason}; leave one of them out, {advice}")
        entries.append(Entrant(_label(settings, list(runs)), settings, tuple(members), episodes))
    return tuple(sorted(entries, key=lambda entrant: not entrant.is_model))


def setting(run: RecordedRun) -> Setting:
    """Return the setting of a run."""
    flight = run.flight
    commander = flight.get("commander")
    return Setting(
        pilot=run.pilot,
        replayed=flight.get("replay") is not None,
        is_model=run.is_model,
        command=str(flight.get("command") or FLAT),
        commander=f"{commander.get('provider')}/{commander.get('name')}"
        if isinstance(commander, dict)
        else str(flight.get("scripted") or ""),
        latency=str(flight.get("latency") or ""),
        agent=run.agent,
        disturbed=str(run.configuration.get("disturbed") or ""),
        **_request_words(flight.get("model")),
    )


def _request_words(model: Any) -> dict[str, str]:
    """Return the request fields of a model in words, by the field of a Setting."""
    if not isinstance(model, dict):
        return {}
    sent = {name: model.get(name) for name in ("temperature", "top_p", "max_tokens")}
    words = {name: f"{name} {value}" for name, value in sent.items() if value is not None}
    quick = model.get("quick")
    return words if quick is None else {**words, "reasoning": f"reasoning {json.dumps(quick, sort_keys=True)}"}


def _label(entry: Setting, entries: Sequence[Setting]) -> str:
    """Return the pilot's name, with the fields of its setting that differ among entrants of that name.

    An agent other than the paper's is always named.
    """
    name = f"replay of {entry.pilot}" if entry.replayed else entry.pilot
    name = name if entry.agent == PAPER else f"{name} · {entry.agent}"
    key = (entry.pilot, entry.replayed, entry.agent)
    namesakes = [setting for setting in entries if (setting.pilot, setting.replayed, setting.agent) == key]
    differing = []
    for field in ("command", "commander", "latency", "disturbed", "temperature", "top_p", "max_tokens", "reasoning"):
        value = getattr(entry, field)
        if value and any(getattr(namesake, field) != value for namesake in namesakes):
            differing.append(value)
    return ", ".join([name, *differing])


def _repeated_flight(episodes: Iterable[ScoredEpisode]) -> str | None:
    """Return a sentence that names a flight that occurs twice, the same episode with the same seed; None: none does."""
    seen: dict[tuple[str, int], ScoredEpisode] = {}
    for flight in episodes:
        before = seen.setdefault((flight.episode, flight.run.seed), flight)
        if before is not flight:
            return f"{before.folder} and {flight.folder} are of one episode and of the same seed {flight.run.seed}"
    return None


def _check_record_ids(episodes: Iterable[ScoredEpisode]) -> None:
    seen: dict[str, ScoredEpisode] = {}
    for flight in episodes:
        before = seen.setdefault(flight.episode, flight)
        if flight.record_sha256 and before.record_sha256 and flight.record_sha256 != before.record_sha256:
            raise UsageError(
                f"{before.folder} and {flight.folder} were flown after different records of the id '{flight.episode}':"
                " they are different episodes, and no table can hold both"
            )
