"""A flight as a film wants it: everything that its folder tells, at any time of the episode."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from dronecats.flight.sitl.scenario import origin, world_of
from dronecats.judge.judged_flight import JudgedFlight, judged_flight
from dronecats.report.afterflight.sources import kept_ulog
from dronecats.report.results.flown_run import flown_run
from dronecats.view.film.track import DroneTrack, logged, onboard, traced
from episodes.maps.assets.multirotor import Outline, outline
from episodes.records import record as records
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import episode_folder
from foundation.run_folder.rows import Decision
from foundation.truth import Origin
from vehicles import airframe as airframes

DEFAULT_AIRFRAME = "x500"


@dataclass(frozen=True)
class FilmedFlight:
    """One flight of one episode, and the world in which it was flown."""

    episode: JudgedFlight
    who: str  # who flew it; a built-in pilot is said to be one
    pictured: bool  # the frames show something: they were not left grey
    airframe: str
    camera: CameraModel  # through which the frames were taken
    tracks: Mapping[int, DroneTrack]  # by drone
    world: World

    @property
    def instruction(self) -> str:
        """What the pilot was told."""
        return str(self.episode.record.get("instruction") or "")

    @property
    def drones(self) -> tuple[int, ...]:
        """The numbers of all that flew."""
        return tuple(sorted(self.tracks))

    @property
    def outline(self) -> Outline:
        """Where the parts of such a drone are."""
        return outline(airframes.load(self.airframe))

    @property
    def end_s(self) -> float:
        """When the flight ended, s since the episode began."""
        return end_of(self.episode)

    @cached_property
    def decisions(self) -> dict[int, tuple[Decision, ...]]:
        """The decisions of each drone in the order of their pictures."""
        told: dict[int, list[Decision]] = {drone: [] for drone in self.drones}
        for decision in sorted(self.episode.logs.decisions, key=lambda each: (each.t_frame, each.t_decided)):
            told.setdefault(decision.drone, []).append(decision)
        return {drone: tuple(each) for drone, each in told.items()}

    def looked_at(self, drone: int, t: float) -> Decision | None:
        """Return the decision whose picture was the newest at a time, decided yet or not; None before the first."""
        return _newest(self.decisions.get(drone, ()), t, lambda each: each.t_frame)

    def flown_by(self, drone: int, t: float) -> Decision | None:
        """Return the newest decision that had been made by then; None before the first."""
        return _newest(self.decisions.get(drone, ()), t, lambda each: each.t_decided)

    def frame(self, decision: Decision) -> Path | None:
        """Return the file of the picture of a decision, None where the folder has none."""
        path = self.episode.folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
        return path if path.is_file() else None


def told(path: Path) -> JudgedFlight:
    """Return what the logs of an episode folder, or of a run's only one, tell.

    Raises UsageError where that is no episode, tells no truth, or was flown in no world of ours.
    """
    if not path.is_dir():
        raise UsageError(f"there is no folder {path}")
    folder = episode_folder(path)
    episode = judged_flight(folder)
    if not episode.logs.true:
        raise UsageError(f"{folder} tells only what an autopilot said of itself: a film shows what was true")
    if episode.logs.begin is None or not episode.logs.poses:
        raise UsageError(f"{folder / layout.TRUTH} tells no place of any drone: there is nothing to film")
    if not (folder / layout.EPISODE).is_file():
        raise UsageError(f"{folder} has no {layout.EPISODE}: nobody can tell in which world it was flown")
    return episode


def end_of(episode: JudgedFlight) -> float:
    """Return when a flight ended, s since it began; of one without an end, when it was last heard of."""
    end = episode.logs.end
    return max((pose.t for pose in episode.logs.poses), default=0.0) if end is None else end.t


def filmed_flight(episode: JudgedFlight) -> FilmedFlight:
    """Return a flight with its world. Raises UsageError where its map is not to be had on this machine."""
    folder, logs = episode.folder, episode.logs
    run = flown_run(folder)
    simulated = run.flight.get("simulated") or {}
    airframe = str(simulated.get("airframe") or DEFAULT_AIRFRAME)
    world = world_of(records.load(folder / layout.EPISODE), airframe)
    begin_us = logs.begin.t0_us if logs.begin is not None else 0
    fine = logged(folder / layout.TLOG, begin_us, origin(world))
    tracks = {
        drone: fine.get(drone) or _onboard(folder, drone, begin_us, origin(world)) or track
        for drone, track in traced((*logs.poses, *logs.frames.values())).items()
    }
    who = run.pilot if run.is_model else f"built-in pilot {run.pilot}, no model"
    pictured = simulated.get("rendered") is not False
    return FilmedFlight(episode, who, pictured, airframe, CameraModel(), tracks, world)


def _onboard(folder: Path, drone: int, begin_us: int, map_origin: Origin) -> DroneTrack | None:
    """Return the track in the log that a PX4 wrote on board; None without one that tells the truth."""
    kept = kept_ulog(folder, drone)
    with suppress(UsageError):  # torn: the trace of truth.jsonl stands
        return onboard(kept, begin_us, map_origin) if kept else None
    return None


def _newest(decisions: Sequence[Decision], t: float, when: Callable[[Decision], float]) -> Decision | None:
    found = [each for each in decisions if when(each) <= t + 1e-9]
    return max(found, key=when) if found else None
