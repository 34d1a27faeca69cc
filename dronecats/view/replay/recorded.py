"""A flight of a run folder at any moment of it: what a page shows, whatever was kept of it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.agent.names import PAPER
from dronecats.judge.judged_flight import JudgedFlight, judged_flight
from dronecats.judge.measured import measured, qualifies
from dronecats.judge.verdict import Measured
from dronecats.report.results.flown_run import FlownRun, flown_run
from dronecats.view.film.flown import FilmedFlight, filmed_flight
from dronecats.view.film.track import DroneTrack, traced
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment, ShownPicture
from dronecats.view.live.questions import AskedQuestions, spec_in
from dronecats.view.live.sight import ChosenSight, chosen_go, sight
from dronecats.view.live.world import lens_in
from dronecats.view.replay.occurrences import OFFBOARD, Occurrence, OccurrenceKind, envelope_rows, occurrences
from dronecats.view.replay.onboard import Timeline, VehicleLog, vehicle_logs, with_onboard_logs
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, episode_folder, exchanges
from foundation.run_folder.rows import Decision, EstimatedPose, FrameTruth, Order, Pose, drone_label

SAID = 8  # texts that a moment remembers
SOON_S = 1e-6
NO_END = "without an end: it was killed, or is still in the air"
NO_TLOG = f"no {layout.TLOG}: drawn level between its places, without modes, battery and setpoints"
NO_PICTURES = "no pictures were kept"
NOT_DRAWN = "flown without drawing pictures"
NO_TRUTH = "nobody knew the truth: places are the autopilot's own, and nothing is judged"
NO_RECORD = f"no {layout.EPISODE}: a plain grid in place of the world"


@dataclass(frozen=True)
class PlayableFlight:
    """One flight of one episode, read once. Times are s since it began, places m in its NED frame."""

    episode: JudgedFlight
    run: FlownRun
    tracks: Mapping[int, DroneTrack]  # by drone
    vehicles: Mapping[int, VehicleLog]  # by drone; {}: there is no tlog
    filmed: FilmedFlight | None  # what views are drawn from; None: its world is not known here
    camera: CameraModel  # through which the frames were taken
    end_s: float
    happened: tuple[Occurrence, ...]  # in the order of time
    missing: tuple[str, ...]  # sentences about what the folder, or this machine, does not have
    pictured: bool  # the frames show something
    _pictures: dict[tuple[int, int], ShownPicture] = field(default_factory=dict)

    @property
    def world(self) -> World | None:
        """The world in which it was flown; None: not known here."""
        return self.filmed.world if self.filmed else None

    @property
    def drones(self) -> tuple[int, ...]:
        """The numbers of all that flew."""
        return tuple(sorted(self.tracks))

    @property
    def instruction(self) -> str:
        """What the pilot was told; empty: not known."""
        return str(self.episode.record.get("instruction") or self.run.flight.get("instruction") or "")

    @property
    def who(self) -> str:
        """Who flew it, in words; a built-in pilot is said to be one."""
        pilot = self.run.pilot if self.run.is_model else f"built-in pilot {self.run.pilot}, no model"
        agent = "" if self.run.agent == PAPER else f", agent {self.run.agent}"
        simulated = self.run.flight.get("simulated") or {}
        autopilot = f", on {simulated['autopilot']}" if simulated.get("autopilot") not in (None, "ours") else ""
        seed = f", seed {self.run.seed}" if self.run.seed else ""
        return f"{pilot}{agent}{autopilot}{seed}"

    @property
    def true(self) -> bool:
        """Whether the places are the truth, and not what an autopilot thought."""
        return self.episode.logs.true

    def of(self, kind: OccurrenceKind) -> tuple[Occurrence, ...]:
        """Return what happened of one sort, in the order of time."""
        return tuple(one for one in self.happened if one.kind is kind)

    def pose(self, drone: int, t_s: float) -> DronePose:
        """Return where a drone of `drones` was; before the first sample and after the last it stays there."""
        return self.tracks[drone].at(t_s)

    def way(self, drone: int, t_s: float, every_s: float) -> list[Vec3]:
        """Return the places of a drone from the beginning to a time, so many seconds apart."""
        places = self.tracks[drone].positions(np.append(np.arange(0.0, t_s, every_s), t_s))
        return [(float(north), float(east), float(down)) for north, east, down in places]

    def moment(self, t_s: float) -> Moment:
        """Return all that is shown of a time; before the beginning and after the end, of these."""
        t_s = min(max(t_s, 0.0), self.end_s)
        drones = tuple(self._drone(drone, t_s) for drone in self.drones)
        newest = max((each.decision for each in drones if each.decision), key=lambda d: d.t_decided, default=None)
        end = self.episode.logs.end
        over = end is not None and t_s >= self.end_s - SOON_S
        return Moment(
            t_s=t_s,
            drones=drones,
            judge=self._judge(t_s),
            moved=self.world.moved(t_s) if self.world is not None else {},
            state=f"over: {end.reason}" if end is not None and over else "in the air",
            rate_hz=newest.rate_hz if newest else None,
            instruction=self.instruction,
        )

    def _drone(self, drone: int, t_s: float) -> DroneMoment:
        pose, heard = self.pose(drone, t_s), self.vehicles.get(drone, VehicleLog(drone))
        asked, decided = self._newest(drone, t_s, "t_frame"), self._newest(drone, t_s, "t_decided")
        state = heard.states.at(t_s)
        ray = self._sight(decided)
        return DroneMoment(
            drone=drone,
            position_ned=pose.position_ned,
            attitude=pose.attitude,
            velocity_ned=(heard.true_velocity if self.true else heard.own_velocity).at(t_s),
            true=self.true,
            height_m=self._height(pose.position_ned),
            setpoint_ned=heard.setpoints.at(t_s) if state is None or state.mode == OFFBOARD else None,
            mode=state.mode if state else "",
            armed=state.armed if state else None,
            battery=state.battery if state else None,
            said=self._said(drone, t_s),
            prompt=self._prompts.get((drone, decided.step), "") if decided else "",
            picture=self._picture(asked),
            decision=decided,
            decided_on=self._picture(decided),
            chosen_ned=ray.place_ned if ray else None,
            lens_ned=ray.lens_ned if ray else None,
        )

    def _said(self, drone: int, t_s: float) -> tuple[str, ...]:
        told = [(one.t_s, one.words) for one in self.of(OccurrenceKind.FAULT) if one.drone in (drone, None)]
        told += [(t, f"commander: {order.goal}") for t, order in self._orders if order.drone == drone]
        return tuple(f"{t:.1f} s  {words}" for t, words in sorted(told) if t <= t_s + SOON_S)[-SAID:]

    @cached_property
    def _orders(self) -> list[tuple[float, Order]]:
        """What a commander has had drones do, and when that came, s."""
        answered = (one for one in exchanges(self.episode.folder) if one.t_answered is not None)
        return [(one.t_answered or 0.0, order) for one in answered for order in one.orders]

    @cached_property
    def _decisions(self) -> dict[tuple[int, str], Timeline[Decision]]:
        found: dict[tuple[int, str], Timeline[Decision]] = {}
        for drone in self.drones:
            own = [each for each in self.episode.logs.decisions if each.drone == drone]
            for when in ("t_frame", "t_decided"):
                ordered = sorted(own, key=attrgetter(when, "step"))
                found[drone, when] = Timeline(tuple(getattr(each, when) for each in ordered), tuple(ordered))
        return found

    @cached_property
    def _prompts(self) -> dict[tuple[int, int], str]:
        """What each decision was asked, by drone and step; a commander's orders are in them from when they came."""
        asked = AskedQuestions(spec_in(self.run.configuration), self.instruction, len(self.drones))
        found: dict[tuple[int, int], str] = {}
        waiting = list(self._orders)
        for _, of_step in groupby(self.episode.logs.decisions, key=attrgetter("step")):
            together = list(of_step)
            while waiting and waiting[0][0] <= together[0].t_frame + SOON_S:
                _, order = waiting.pop(0)
                asked.goal(order.drone, order.goal)
            text = asked.asked(together)
            found |= {(one.drone, one.step): text for one in together}
        return found

    def _newest(self, drone: int, t_s: float, when: str) -> Decision | None:
        return self._decisions[drone, when].at(t_s)

    def _picture(self, decision: Decision | None) -> ShownPicture | None:
        if decision is None or not self.pictured:
            return None
        jpeg = _jpeg(self.episode.folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone))
        if jpeg is None:
            return None
        fresh = ShownPicture(decision.frame_id, jpeg, decision.t_frame)
        return self._pictures.setdefault((decision.drone, decision.frame_id), fresh)

    def _sight(self, decision: Decision | None) -> ChosenSight | None:
        """Return the ray of a go, from where its picture was taken; None of any other decision."""
        go = chosen_go(decision) if decision else None
        if decision is None or go is None:
            return None
        pose = self.pose(decision.drone, decision.t_frame)
        return sight(go, pose.position_ned, pose.attitude, self.camera)

    def _height(self, place: Vec3) -> float:
        return (self.world.ground_down(place[0], place[1]) if self.world else 0.0) - place[2]

    # ---- what only the judge knows

    def _judge(self, t_s: float) -> JudgeMoment:
        if not self.true:
            return JudgeMoment()
        target = self._target(t_s)
        away = tuple(math.dist(self.pose(d, t_s).position_ned, target) if target else None for d in self.drones)
        said = tuple(text for t, text in self._declarations if t <= t_s + SOON_S)
        verdict = self.episode.verdict
        deciding = verdict.deciding
        over = self.episode.logs.end is not None and t_s >= self.end_s - SOON_S
        if over or (deciding is not None and t_s >= deciding.t - SOON_S):
            near = f", {verdict.ne_m:.2f} m from the target" if verdict.ne_m is not None else ""
            said = (*said, f"verdict: {verdict.outcome}{near}")
        return JudgeMoment(target_ned=target, distance_m=away, said=said[-SAID:])

    @cached_property
    def _declarations(self) -> tuple[tuple[float, str], ...]:
        """When arrival was declared (s), and what the judge says of it."""
        flown = self.episode
        each = [
            (d.t_decided, _declared(measured(d, flown.logs), qualifies(d, flown.logs, flown.delta_m, flown.cap_s)))
            for d in flown.logs.decisions
            if d.declares
        ]
        return tuple(sorted(each, key=lambda one: one[0]))

    def _target(self, t_s: float) -> Vec3 | None:
        if self.world is not None:
            return self.world.target_centre(t_s)
        times, places = self._target_rows
        if not len(times):
            return None
        north, east, down = (float(np.interp(t_s, times, places[:, k])) for k in range(3))
        return (north, east, down)

    @cached_property
    def _target_rows(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        logs = self.episode.logs
        rows: list[Pose | FrameTruth] = [*logs.poses, *logs.frames.values()]
        told = {row.t: row.target_ned for row in rows if row.target_ned is not None}
        return np.array(sorted(told)), np.array([told[t] for t in sorted(told)], np.float64).reshape(-1, 3)


def playable_flight(path: Path) -> PlayableFlight:
    """Return the flight of an episode's folder, or of a run's only one.

    One that was killed, or is still in the air, is there as far as its logs go. Raises UsageError where that is none,
    is damaged, never began, or tells no place of any drone.
    """
    if not path.is_dir():
        raise UsageError(f"there is no folder {path}")
    folder = episode_folder(path)
    episode, run = judged_flight(folder), flown_run(folder)
    logs = episode.logs
    if logs.begin is None:
        raise UsageError(f"{folder} never began: its {layout.TRUTH} has no beginning")
    t0_us, end_s = logs.begin.t0_us, _last_heard_s(logs) if logs.end is None else logs.end.t
    vehicles = with_onboard_logs(vehicle_logs(folder / layout.TLOG, t0_us), folder, t0_us)
    missing = [] if logs.end is not None else [NO_END]
    missing += [] if vehicles else [NO_TLOG]
    filmed, unknown = _filmed(episode)
    missing += unknown
    tracks = filmed.tracks if filmed else traced((*logs.poses, *logs.frames.values())) if logs.true else {}
    tracks = tracks or {drone: one.own_track for drone, one in vehicles.items() if one.own_track is not None}
    tracks = tracks or traced(_estimated(logs))
    if not tracks:
        raise UsageError(f"{folder} tells no place of any drone: there is nothing to show")
    simulated = run.flight.get("simulated") or {}
    pictured = simulated.get("rendered") is not False
    kept = any((folder / layout.FRAMES).glob("*.jpg"))
    missing += [NOT_DRAWN] if not pictured else [] if kept else [NO_PICTURES]
    happened = occurrences(logs, vehicles, envelope_rows(folder / layout.SAFETY, t0_us), end_s)
    return PlayableFlight(
        episode, run, tracks, vehicles, filmed, lens_in(folder), end_s, happened, tuple(missing), pictured
    )  # fmt: skip


def of_one_episode(flights: Sequence[PlayableFlight]) -> None:
    """Raise UsageError naming two of these flights that are not of one episode."""
    first, others = flights[0], flights[1:]
    for other in others:
        if other.true != first.true:
            raise UsageError(f"of {first.episode.folder} and {other.episode.folder} only one tells the truth: places "
                             "of the other are its autopilot's own, and lie in no common frame")  # fmt: skip
        if other.episode.id != first.episode.id:
            raise UsageError(f"{first.episode.folder} is of {first.episode.id} and {other.episode.folder} of "
                             f"{other.episode.id}: only flights of one episode are laid over one another")  # fmt: skip
        if other.episode.record != first.episode.record:
            raise UsageError(f"{first.episode.folder} and {other.episode.folder} are of two records both named "
                             f"{first.episode.id}: only flights of one episode are laid over one another")  # fmt: skip


def _filmed(episode: JudgedFlight) -> tuple[FilmedFlight | None, list[str]]:
    """Return the flight in its world, or why there is none."""
    if not episode.logs.true:
        return None, [NO_TRUTH]
    if not (episode.folder / layout.EPISODE).is_file():
        return None, [NO_RECORD]
    try:
        return filmed_flight(episode), []
    except UsageError as error:
        return None, [f"a plain grid in place of the world: {error}"]


def _last_heard_s(logs: Logs) -> float:
    """Return when a flight without an end was last heard of, s since it began."""
    decided = [decision.t_decided for decision in logs.decisions]
    return max((*(pose.t for pose in (*logs.poses, *_estimated(logs))), *decided), default=0.0)


def _estimated(logs: Logs) -> list[Pose]:
    told: Sequence[EstimatedPose] = logs.estimate.poses if logs.estimate else ()
    return [Pose(t=row.t, drone=row.drone, position_ned=row.position_ned, yaw_deg=row.yaw_deg,
                 distance_m=row.distance_m, visible=None) for row in told]  # fmt: skip


def _declared(one: Measured, good: bool | None) -> str:
    away = "at a distance that was not measured" if one.distance_m is None else f"at {one.distance_m:.2f} m"
    seen = {True: ", in view", False: ", out of view", None: ""}[one.visible]
    counts = {True: "counts", False: "does not count", None: "not known"}[good]
    return f"{one.t:.1f} s  {drone_label(one.drone)} declared {away}{seen}: {counts}"


@lru_cache(32)
def _jpeg(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
