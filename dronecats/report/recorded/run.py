"""Reads a run folder: its pilot, settings and episodes."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dronecats.agent.names import PAPER, agent_name
from foundation.camera import CameraModel
from foundation.conditions import SceneConditions, recorded
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import episodes, run_configuration

DEFAULT_AIRFRAME = "x500"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """One run folder: episodes flown by one pilot under one configuration, once each."""

    folder: Path
    configuration: dict[str, Any]  # contents of run.json
    episodes: tuple[Path, ...]  # folders of the episodes, sorted by name

    @property
    def flight(self) -> dict[str, Any]:
        """The specification of the run's flights: the fields of a FlightSpec; empty: not recorded."""
        return dict(self.configuration.get("flight") or {})

    @property
    def pilot(self) -> str:
        """Name of the built-in pilot, PROVIDER/NAME of the model, or HARNESS:NAME of another harness's policy."""
        flight = self.flight
        model, outside = flight.get("model"), flight.get("outside")
        if outside:
            return f"{outside.get('harness')}:{outside.get('name')}"
        return str(flight.get("pilot") or (f"{model.get('provider')}/{model.get('name')}" if model else "unknown"))

    @property
    def is_model(self) -> bool:
        """Whether the pilot is a model, or the policy of another harness. Built-in pilots are not models."""
        return self.flight.get("model") is not None or self.flight.get("outside") is not None

    @property
    def agent(self) -> str:
        """The agent's name: `paper`, another shipped agent, or MODULE:NAME."""
        return agent_name(self.flight.get("agent") or self.configuration.get("agent"))

    @property
    def seed(self) -> int:
        """The seed, which distinguishes flights of the same episodes."""
        return int(self.flight.get("seed") or 0)

    @property
    def camera(self) -> CameraModel:
        """The camera in run.json. Missing values are those of the benchmark's camera."""
        announced, default = self.configuration.get("camera"), CameraModel()
        try:
            camera = announced if isinstance(announced, dict) else {}
            return CameraModel(
                int(camera.get("width", default.width)),
                int(camera.get("height", default.height)),
                float(camera.get("hfov_deg", default.hfov_deg)),
                pitch_deg=float(camera.get("pitch_deg", 0.0)),
                gimballed=camera.get("gimbal") is True,
            )
        except (TypeError, ValueError):
            return default

    @property
    def airframe(self) -> str:
        """The simulated airframe, or the default."""
        return str(self._simulated.get("airframe") or DEFAULT_AIRFRAME)

    @property
    def is_rendered(self) -> bool:
        """Whether the frames were rendered. Otherwise they are grey."""
        return self._simulated.get("rendered") is not False

    @property
    def conditions(self) -> SceneConditions:
        """Light and season of the frames."""
        return recorded(self.flight)

    @property
    def pilot_title(self) -> str:
        """Name of the pilot for a title. A built-in pilot is marked as one."""
        return self.pilot if self.is_model else f"built-in pilot {self.pilot}"

    @property
    def title(self) -> str:
        """`pilot_title`, with agent, autopilot and seed if they are not the default."""
        agent = "" if self.agent == PAPER else f", agent {self.agent}"
        autopilot = self._simulated.get("autopilot")
        on = f", on {autopilot}" if autopilot not in (None, "", "ours") else ""
        return f"{self.pilot_title}{agent}{on}{f', seed {self.seed}' if self.seed else ''}"

    @property
    def _simulated(self) -> dict[str, Any]:
        simulated = self.flight.get("simulated")
        return simulated if isinstance(simulated, dict) else {}


def recorded_run(folder: Path) -> RecordedRun:
    """Return the run in a run folder. For an episode folder, the run has only this episode. Raises UsageError."""
    folders = episodes(folder)
    if not folders:
        raise UsageError(f"{folder} has no episode. Name a folder that has {layout.DECISIONS} and {layout.TRUTH}")
    run = folders[0].resolve().parent
    return RecordedRun(folder=run, configuration=run_configuration(run) or {}, episodes=tuple(folders))


def recorded_runs(paths: Iterable[Path]) -> list[RecordedRun]:
    """Return the runs at or below these folders, in this order, without duplicates.

    A folder may be a run, an episode of a run, a folder of runs (such as a benchmark), or a folder of such folders.
    Raises UsageError.
    """
    by_folder: dict[Path, RecordedRun] = {}
    for path in paths:
        if not path.is_dir():
            raise UsageError(f"folder {path} does not exist")
        inside = [path] if episodes(path) else _run_folders(path)
        runs = [recorded_run(folder) for folder in inside if episodes(folder)]
        if not runs:
            raise UsageError(
                f"{path} has no run. Name a folder that has {layout.RUN} and flown episodes, or a folder"
                " of such folders"
            )
        for run in runs:
            known = by_folder[run.folder].episodes if run.folder in by_folder else ()
            unique = {folder.resolve(): folder for folder in (*run.episodes, *known)}
            by_folder[run.folder] = replace(run, episodes=tuple(sorted(unique.values(), key=lambda path: path.name)))
    return list(by_folder.values())


def _run_folders(folder: Path) -> list[Path]:
    """Return the run folders in a folder and in its subfolders, sorted by path. Does not search inside a run folder."""
    runs = {path.parent for path in folder.glob(f"*/{layout.RUN}")}
    deeper = {path.parent for path in folder.glob(f"*/*/{layout.RUN}")}
    return sorted(runs | {run for run in deeper if run.parent not in runs})
