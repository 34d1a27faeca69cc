"""An episode that was flown, read once, as every format takes it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.judge.judged_flight import FlightStep, JudgedFlight, judged_flight
from dronecats.judge.measured import measured
from dronecats.judge.verdict import Measured
from dronecats.report.export.tracks import FlownTrack, FlownTracks, from_rows, from_tlog
from dronecats.report.results.flown_run import FlownRun
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.results import Verdict
from foundation.run_folder.rows import FrameTruth, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedDrone:
    """One drone: where it was, and where it was told to go."""

    number: int  # 0 is the first
    estimate: FlownTrack | None  # as its autopilot thought; None: there is no tlog that tells
    held: FlownTrack | None  # the estimate, with the sample before the episode that still held when it began
    truth: FlownTrack | None  # the judge's; None: nobody knew it
    setpoints: NDArray[np.float64] | None  # as in `FlownTracks`


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenFrame:
    """One picture that the pilot was shown."""

    drone: int
    frame_id: int
    t_s: float  # s, when it was taken
    jpeg: Path


@dataclass(frozen=True, kw_only=True)
class ExportedFlight:
    """One flight of one episode. Times are s since it began, places m in the map's NED frame."""

    run: FlownRun
    episode: JudgedFlight
    t0_us: int  # µs, the vehicle's clock at t = 0
    end_s: float
    origin: Vec3 | None  # lat °, lon °, alt m above mean sea level of the map's frame; None: nobody tells
    camera: CameraModel  # as it was announced; of a run that tells none, the benchmark's
    drones: tuple[ExportedDrone, ...]
    frames: tuple[SeenFrame, ...]  # in the order of time
    target: FlownTrack | None  # the judge's: its centre; None: nobody knew it
    declarations: tuple[Measured, ...]  # all of them, with what the judge measured

    @property
    def id(self) -> str:
        """The record's id."""
        return self.episode.id

    @property
    def instruction(self) -> str:
        """What was asked for; empty: not told."""
        return str(self.episode.record.get("instruction") or "")

    @property
    def steps(self) -> tuple[FlightStep, ...]:
        """The decisions, in the order of the log."""
        return self.episode.steps

    @property
    def verdict(self) -> Verdict:
        """The judge's verdict, derived anew."""
        return self.episode.verdict

    def about(self) -> dict[str, str]:
        """Return who flew what, and how, in words."""
        return {
            "run": self.run.folder.resolve().name,
            "pilot": self.run.pilot,
            "agent": self.run.agent,
            "seed": str(self.run.seed),
            "episode": self.id,
            "map": self.episode.map,
            "cell": self.episode.cell,
            "instruction": self.instruction,
        }

    def judged(self) -> dict[str, str]:
        """Return the verdict in words, each key under `judge/`."""
        verdict = self.verdict
        told = {"outcome": verdict.outcome, "success": verdict.success, "ne_m": verdict.ne_m, "error": verdict.error}
        return {f"judge/{key}": str(value) for key, value in told.items() if value is not None}


def exported_flight(run: FlownRun, folder: Path) -> ExportedFlight:
    """Return the episode of a folder. Raises UsageError when it is damaged or was never flown to its end."""
    episode = judged_flight(folder)
    logs = episode.logs
    if logs.begin is None or logs.end is None:
        missing = "has no beginning" if logs.begin is None else "has no end"
        raise UsageError(f"{folder} is unfinished: its {layout.TRUTH} {missing}")
    numbers = {step.decision.drone for step in episode.steps} | {pose.drone for pose in logs.poses}
    count = max(numbers, default=0) + 1
    tlog, origin = folder / layout.TLOG, _map_origin(episode)
    nothing = FlownTracks((), (), (), origin)
    heard = from_tlog(tlog, logs.begin.t0_us, origin, count) if tlog.exists() else nothing
    return ExportedFlight(
        run=run,
        episode=episode,
        t0_us=logs.begin.t0_us,
        end_s=logs.end.t,
        origin=heard.origin,
        camera=_camera(run),
        drones=tuple(_drone(number, episode, heard, logs.end.t) for number in range(count)),
        frames=tuple(sorted(_frames(episode), key=lambda frame: (frame.t_s, frame.drone))),
        target=_target(episode),
        declarations=tuple(measured(d, logs) for d in logs.decisions if d.declares),
    )


def _map_origin(episode: JudgedFlight) -> Vec3 | None:
    """Return where the map lies; None without a map. Raises UsageError for a map that is not here."""
    if not episode.map:
        return None
    from episodes import maps

    scene = maps.build(episode.map, int(episode.record.get("map_seed") or 1))
    return (scene.latitude_deg, scene.longitude_deg, scene.altitude_m)


def _camera(run: FlownRun) -> CameraModel:
    told = run.configuration.get("camera")
    known = {key: told[key] for key in ("width", "height", "hfov_deg") if key in told} if isinstance(told, dict) else {}
    return CameraModel(**known)


def _drone(number: int, episode: JudgedFlight, heard: FlownTracks, end_s: float) -> ExportedDrone:
    logs = episode.logs
    truth = heard.truth[number] if number < len(heard.truth) else None
    if truth is None and logs.true:
        framed = (frame for frame in logs.frames.values() if frame.drone == number)
        truth = from_rows([*(pose for pose in logs.poses if pose.drone == number), *framed])
    estimate = heard.estimate[number] if number < len(heard.estimate) else None
    setpoints = heard.setpoints[number] if number < len(heard.setpoints) else None
    if setpoints is not None:
        setpoints = setpoints[(setpoints[:, 0] >= 0.0) & (setpoints[:, 0] <= end_s)]
    return ExportedDrone(
        number=number,
        estimate=_flown(estimate, end_s),
        held=_flown(estimate, end_s, held=True),
        truth=_flown(truth if logs.true else None, end_s),
        setpoints=setpoints,
    )


def _flown(track: FlownTrack | None, end_s: float, held: bool = False) -> FlownTrack | None:
    """Return what of a track is of the episode, with the sample that `held` when it began; None where nothing is."""
    if track is None:
        return None
    kept = track.between(min(0.0, float(track.t_s[track.at(0.0)])) if held else 0.0, end_s)
    return kept if len(kept) else None


def _frames(episode: JudgedFlight) -> Iterator[SeenFrame]:
    """Yield the pictures on which something was decided, each once. Raises UsageError where one is missing."""
    seen = set[tuple[int, int]]()
    folder = episode.folder / layout.FRAMES
    if not any(folder.glob("*.jpg")):
        return  # a flight that was not rendered, or whose pictures nobody kept
    for step in episode.steps:
        decision = step.decision
        if (decision.drone, decision.frame_id) in seen:
            continue
        seen.add((decision.drone, decision.frame_id))
        jpeg = folder / layout.frame_name(decision.frame_id, decision.drone)
        if not jpeg.exists():
            raise UsageError(f"{episode.folder} is damaged: the picture {jpeg.name} of step {decision.step} is missing")
        yield SeenFrame(drone=decision.drone, frame_id=decision.frame_id, t_s=decision.t_frame, jpeg=jpeg)


def _target(episode: JudgedFlight) -> FlownTrack | None:
    """Return where the target's centre was, where the logs tell it."""
    logs = episode.logs
    if not logs.true:
        return None
    rows: list[Pose | FrameTruth] = [*logs.poses, *logs.frames.values()]
    told = {row.t: row.target_ned for row in rows if row.target_ned is not None}
    if not told:
        return None
    times = np.array(sorted(told))
    places = np.array([told[t] for t in sorted(told)], np.float64)
    nothing = np.full_like(places, math.nan)
    return FlownTrack(times, places, nothing, np.tile((1.0, 0.0, 0.0, 0.0), (len(times), 1)))
