"""A run folder read back: who flew, under which settings, and which episodes stand in it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.names import agent_name
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import episodes, run_configuration


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownRun:
    """One run folder: episodes flown by one pilot under one configuration, once each."""

    folder: Path
    configuration: dict[str, Any]  # what run.json holds
    episodes: tuple[Path, ...]  # their folders, by name

    @property
    def flight(self) -> dict[str, Any]:
        """What was asked for, the fields of FlightSpec."""
        return dict(self.configuration.get("flight") or {})

    @property
    def pilot(self) -> str:
        """The built-in pilot's name, or PROVIDER/NAME of the model."""
        flight = self.flight
        model = flight.get("model")
        return str(flight.get("pilot") or (f"{model.get('provider')}/{model.get('name')}" if model else "unknown"))

    @property
    def is_model(self) -> bool:
        """Whether a model flew it; a built-in pilot is none and is never reported as one."""
        return self.flight.get("model") is not None

    @property
    def agent(self) -> str:
        """Who decided: `paper`, another name, or MODULE:NAME."""
        return agent_name(self.flight.get("agent") or self.configuration.get("agent"))

    @property
    def seed(self) -> int:
        """What tells flights of the same episodes apart."""
        return int(self.flight.get("seed") or 0)


def flown_run(folder: Path) -> FlownRun:
    """Return a run folder, or the run of an episode folder with that episode alone. Raises UsageError."""
    found = episodes(folder)
    if not found:
        raise UsageError(f"{folder} holds no episode: a folder with {layout.DECISIONS} and {layout.TRUTH} is wanted")
    run = found[0].resolve().parent
    return FlownRun(folder=run, configuration=run_configuration(run) or {}, episodes=tuple(found))


def flown_runs(paths: Iterable[Path]) -> list[FlownRun]:
    """Return every run at or below these folders, in their order, each once.

    A folder may be a run, an episode of one, or hold runs, as that of a benchmark does. Raises UsageError.
    """
    found: dict[Path, FlownRun] = {}
    for path in paths:
        if not path.is_dir():
            raise UsageError(f"there is no folder {path}")
        inside = [path] if episodes(path) else sorted(p.parent for p in path.glob(f"*/{layout.RUN}"))
        runs = [flown_run(each) for each in inside if episodes(each)]
        if not runs:
            raise UsageError(f"{path} holds no run: a folder with {layout.RUN} and flown episodes is wanted")
        for run in runs:
            before = found.get(run.folder)
            found[run.folder] = run if before is None or len(run.episodes) > len(before.episodes) else before
    return list(found.values())
