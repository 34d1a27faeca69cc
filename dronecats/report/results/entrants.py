"""Who stands in a table: the runs of one pilot under one setting, their flights of each episode put together."""

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
ASKED = ("temperature", "top_p", "max_tokens", "reasoning")  # fields of a Setting


@dataclass(frozen=True, slots=True)
class Setting:
    """What makes two lines of a table out of one pilot; all else that differs keeps runs from being one line."""

    pilot: str
    replayed: bool  # recorded replies flew it, and nobody was asked
    is_model: bool
    command: str  # flat, hierarchical or solo
    commander: str  # PROVIDER/NAME, or a script; empty: nobody
    latency: str  # the policy, by which a rate is pinned too
    agent: str  # paper, or another; its runs are never counted together with the paper's
    disturbed: str = ""  # what was done to it on purpose, in words; empty: nothing
    temperature: str = ""  # in words, as the three below; empty: no model, or not sent
    top_p: str = ""
    max_tokens: str = ""
    reasoning: str = ""  # what a model is sent to switch it, on all steps but those after a think


@dataclass(frozen=True)
class Entrant:
    """A line of the tables: every flight that a pilot flew under one setting."""

    label: str
    setting: Setting
    runs: tuple[RecordedRun, ...]
    episodes: tuple[ScoredEpisode, ...]  # every flight of every episode, those that are nobody's score too

    @property
    def is_model(self) -> bool:
        """Whether a model was asked; built-in pilots and replays never stand among models."""
        return self.setting.is_model and not self.setting.replayed

    @cached_property
    def scored(self) -> tuple[ScoredEpisode, ...]:
        """The flights that count."""
        return tuple(each for each in self.episodes if each.scored)

    @cached_property
    def by_episode(self) -> Mapping[str, tuple[ScoredEpisode, ...]]:
        """The flights that count by the episode's id, in the order of their seeds."""
        found: dict[str, list[ScoredEpisode]] = {}
        for each in sorted(self.scored, key=lambda each: each.run.seed):
            found.setdefault(each.episode, []).append(each)
        return {name: tuple(found[name]) for name in sorted(found)}


def entrants(collection: Collection, *, pool_anyway: bool = False) -> tuple[Entrant, ...]:
    """Return who flew, models first, each in the order of the runs.

    Raises UsageError when runs of one setting are of different kinds, when a flight is there twice, or when two
    records bear one id. `pool_anyway` counts the first two together all the same; the last never can be.
    """
    _one_record_an_id(collection.episodes)
    runs: dict[Setting, list[RecordedRun]] = {}
    for run in collection.runs:
        runs.setdefault(setting(run), []).append(run)
    flown: dict[Path, list[ScoredEpisode]] = {}
    for each in collection.episodes:
        flown.setdefault(each.run.folder, []).append(each)
    found = []
    for one, members in runs.items():
        episodes = tuple(each for run in members for each in flown.get(run.folder, ()))
        if not pool_anyway and (said := refusal(members)):
            odd = ", ".join(str(run.folder) for run, _ in odd_runs(members)) or "it"
            raise UsageError(
                f"{said}; leave {odd} out and report it by itself, or count them together with --pool-anyway"
            )
        if not pool_anyway and (said := _twice(episodes)):
            raise UsageError(f"{said}; leave one of them out, or count them together with --pool-anyway")
        found.append(Entrant(_label(one, list(runs)), one, tuple(members), episodes))
    return tuple(sorted(found, key=lambda entrant: not entrant.is_model))


def setting(run: RecordedRun) -> Setting:
    """Return under which setting a run was flown."""
    flight = run.flight
    commander = flight.get("commander")
    command = str(flight.get("command") or FLAT)
    return Setting(
        pilot=run.pilot,
        replayed=flight.get("replay") is not None,
        is_model=run.is_model,
        command=command,
        commander=_title(commander) if isinstance(commander, dict) else str(flight.get("scripted") or ""),
        latency=str(flight.get("latency") or ""),
        agent=run.agent,
        disturbed=str(run.configuration.get("disturbed") or ""),
        **_asked(flight.get("model")),
    )


def _asked(model: Any) -> dict[str, str]:
    """Return how a model is asked, in words by the field of a Setting."""
    if not isinstance(model, dict):
        return {}
    sent = {name: model.get(name) for name in ("temperature", "top_p", "max_tokens")}
    told = {name: f"{name} {value}" for name, value in sent.items() if value is not None}
    quick = model.get("quick")
    return told if quick is None else {**told, "reasoning": f"reasoning {json.dumps(quick, sort_keys=True)}"}


def _label(one: Setting, others: Sequence[Setting]) -> str:
    """Return the pilot's name, with as much of its setting as tells it from the others of that name.

    An agent that is not the paper's is always told.
    """
    name = f"replay of {one.pilot}" if one.replayed else one.pilot
    name = name if one.agent == PAPER else f"{name} · {one.agent}"
    namesakes = [
        other for other in others if (other.pilot, other.replayed, other.agent) == (one.pilot, one.replayed, one.agent)
    ]
    said = []
    for field in ("command", "commander", "latency", "disturbed", *ASKED):
        value = getattr(one, field)
        if value and any(getattr(other, field) != value for other in namesakes):
            said.append(value)
    return ", ".join([name, *said])


def _twice(episodes: Iterable[ScoredEpisode]) -> str | None:
    """Return which flight is there twice: the same episode with the same seed is no second flight."""
    seen: dict[tuple[str, int], ScoredEpisode] = {}
    for each in episodes:
        before = seen.setdefault((each.episode, each.run.seed), each)
        if before is not each:
            return f"{before.folder} and {each.folder} are of one episode and of the same seed {each.run.seed}"
    return None


def _one_record_an_id(episodes: Iterable[ScoredEpisode]) -> None:
    seen: dict[str, ScoredEpisode] = {}
    for each in episodes:
        before = seen.setdefault(each.episode, each)
        if each.record_sha256 and before.record_sha256 and each.record_sha256 != before.record_sha256:
            raise UsageError(
                f"{before.folder} and {each.folder} were flown after different records of the id '{each.episode}':"
                " they are different episodes, and no table can hold both"
            )


def _title(model: Mapping[str, Any]) -> str:
    return f"{model.get('provider')}/{model.get('name')}"
