"""Computes the state of a recorded flight at any time, and the events that the replay page can jump to."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache
from operator import attrgetter, itemgetter
from pathlib import Path

import numpy as np

from dronecats.judge.verdict import Measured, measured, qualifies
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.telemetry import DroneTelemetry
from dronecats.view.live.moment import ChosenSight, DroneMoment, JudgeMoment, Moment, ShownPicture, chosen_go, sight
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3, vec3
from foundation.run_folder import layout
from foundation.run_folder.prompts import SentPrompt, prompts_of, read_prompts
from foundation.run_folder.reading import Logs, episode_folder, rows
from foundation.run_folder.rows import ActiveLimits, Decision, EnvelopeRow, Order, drone_label

SAME_S = 1e-6  # times this close count as equal
NORMAL_END_REASONS = ("cap", "decided")  # an end for any other reason is a fault
OFFBOARD = "OFFBOARD"
# s; a change from OFFBOARD this shortly before a flight's end is no fault, because the run may cause it
END_TOLERANCE_S = 1.0


class OccurrenceKind(Enum):
    DECISION = "decision"
    DECLARATION = "declaration"
    FAULT = "problem"


@dataclass(frozen=True, slots=True)
class Occurrence:
    """An event of a flight."""

    t_s: float  # s since the episode began
    kind: OccurrenceKind
    drone: int | None  # None: all drones
    words: str


def occurrences(flight: RecordedFlight) -> tuple[Occurrence, ...]:
    """Return the occurrences of a flight from 0 to its end, in the order of time.

    Raises UsageError if safety.jsonl is damaged.
    """
    every = (*_decisions(flight.logs), *_faults(flight))
    return tuple(sorted((o for o in every if 0.0 <= o.t_s <= flight.end_s + SAME_S), key=attrgetter("t_s")))


def neighbour(sequence: Sequence[Occurrence], t_s: float, ahead: bool) -> Occurrence | None:
    """Return the first occurrence after a time (`ahead`), or the last one before it; None if there is none."""
    if ahead:
        return next((occurrence for occurrence in sequence if occurrence.t_s > t_s + SAME_S), None)
    return next((occurrence for occurrence in reversed(sequence) if occurrence.t_s < t_s - SAME_S), None)


def _decisions(logs: Logs) -> Iterator[Occurrence]:
    for decision in logs.decisions:
        t_s, drone, words = decision.t_decided, decision.drone, f"step {decision.step}: {decision.action_or_reason()}"
        yield Occurrence(t_s, OccurrenceKind.DECISION, drone, words)
        if decision.declares:
            yield Occurrence(t_s, OccurrenceKind.DECLARATION, drone, f"step {decision.step}: declared")
        if decision.action is None:
            yield Occurrence(t_s, OccurrenceKind.FAULT, drone, words)


def _faults(flight: RecordedFlight) -> Iterator[Occurrence]:
    """Yield the faults other than decisions without an action.

    These are limits of the envelope that begin to act, an early end, warnings, and each change from OFFBOARD to another
    mode during the episode: a failsafe, or an operator's command.
    """
    path, active = flight.folder / layout.SAFETY, ActiveLimits()
    for row in rows(path, EnvelopeRow) if path.is_file() else ():
        if begun := active.begun(row):
            words = f"envelope: limited by {', '.join(begun)}"
            yield Occurrence((row.time_us - flight.t0_us) / 1e6, OccurrenceKind.FAULT, row.drone, words)
    end = flight.logs.end
    if end is not None and end.reason not in NORMAL_END_REASONS:
        words = f"the flight ended: {end.reason}{f': {end.error}' if end.error else ''}"
        yield Occurrence(flight.end_s, OccurrenceKind.FAULT, None, words)
    for vehicle in flight.telemetry.values():
        for t_s, text in zip(vehicle.warnings.t_s, vehicle.warnings.values, strict=True):
            yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, text)
        before = ""
        for t_s, state in zip(vehicle.states.t_s, vehicle.states.values, strict=True):
            if before == OFFBOARD and state.mode != OFFBOARD and t_s < flight.end_s - END_TOLERANCE_S:
                yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, f"mode {state.mode}")
            before = state.mode


MESSAGES = 8  # at most this many messages in a moment
NO_END = "the log has no end, because the flight was killed or is still in the air"
NO_TLOG = f"no {layout.TLOG}: no attitude, modes, battery and setpoints are shown"
NO_PICTURES = "no pictures were recorded"
NOT_DRAWN = "flown without rendering, so there are no pictures"
NO_TRUTH = "no truth: positions are the autopilot's estimates, and there is no verdict"
NO_RECORD = f"no {layout.EPISODE}: a grid is shown instead of the world"


@dataclass(frozen=True)
class FlightMoments:
    """The moments of a recorded flight, from the files that its folder still has."""

    recorded: RecordedFlight
    world: World | None  # None: unknown
    happened: tuple[Occurrence, ...]  # in the order of time
    missing: tuple[str, ...]  # notes on missing files or maps

    @property
    def drones(self) -> tuple[int, ...]:
        return self.recorded.drones

    @property
    def end_s(self) -> float:
        """The end of the flight, s since the episode began."""
        return self.recorded.end_s

    def of(self, kind: OccurrenceKind) -> tuple[Occurrence, ...]:
        """Return the occurrences of one kind, in the order of time."""
        return tuple(o for o in self.happened if o.kind is kind)

    def pose(self, drone: int, t_s: float) -> DronePose:
        """Return the pose of a drone at a time (s). Outside the recorded times, this is the first or last pose."""
        return self.recorded.tracks[drone].at(t_s)

    def way(self, drone: int, t_s: float, every_s: float) -> list[Vec3]:
        """Return the positions of a drone (m, NED) from 0 to `t_s`, in time steps of `every_s` (s)."""
        places = self.recorded.tracks[drone].positions(np.append(np.arange(0.0, t_s, every_s), t_s))
        return [vec3(place) for place in places]

    def moment(self, t_s: float) -> Moment:
        """Return the moment at a time. A time outside of the flight counts as its start or end."""
        t_s = min(max(t_s, 0.0), self.end_s)
        drones = tuple(self._drone(drone, t_s) for drone in self.drones)
        newest = max((d.decision for d in drones if d.decision), key=attrgetter("t_decided"), default=None)
        end = self.recorded.logs.end
        over = end is not None and t_s >= self.end_s - SAME_S
        return Moment(
            t_s=t_s,
            drones=drones,
            judge=self._judge(t_s),
            moved=self.world.moved(t_s) if self.world is not None else {},
            state=f"over: {end.reason}" if end is not None and over else "in the air",
            rate_hz=newest.rate_hz if newest else None,
            instruction=self.recorded.instruction,
        )

    def _drone(self, drone: int, t_s: float) -> DroneMoment:
        pose, telemetry = self.pose(drone, t_s), self.recorded.telemetry.get(drone, DroneTelemetry(drone))
        pending = self.recorded.latest_decision(drone, t_s, "t_frame")
        decided = self.recorded.latest_decision(drone, t_s, "t_decided")
        state = telemetry.states.at(t_s)
        ray = self._sight(decided)
        return DroneMoment(
            drone=drone,
            position_ned=pose.position_ned,
            attitude=pose.attitude,
            velocity_ned=telemetry.true_velocity.at(t_s) if self.recorded.logs.true else self._own_velocity(drone, t_s),
            true=self.recorded.logs.true,
            height_m=self._height(pose.position_ned),
            setpoint_ned=telemetry.setpoint_velocity.at(t_s) if state is None or state.mode == OFFBOARD else None,
            mode=state.mode if state else "",
            armed=state.armed if state else None,
            battery=state.battery if state else None,
            messages=self._messages(drone, t_s),
            prompt=sent.text if decided and (sent := self._prompts.get((drone, decided.step))) else "",
            picture=self._picture(pending),
            decision=decided,
            decided_on=self._picture(decided),
            chosen_ned=ray.place_ned if ray else None,
            lens_ned=ray.lens_ned if ray else None,
        )

    def _messages(self, drone: int, t_s: float) -> tuple[str, ...]:
        messages = [(o.t_s, o.words) for o in self.of(OccurrenceKind.FAULT) if o.drone in (drone, None)]
        messages += [(t, f"commander: {order.goal}") for t, order in self._orders if order.drone == drone]
        return tuple(f"{t:.1f} s  {words}" for t, words in sorted(messages) if t <= t_s + SAME_S)[-MESSAGES:]

    @cached_property
    def _orders(self) -> list[tuple[float, Order]]:
        """The commander's orders, as (time in s, order)."""
        exchanges = self.recorded.exchanges
        return [(e.t_answered, order) for e in exchanges if e.t_answered is not None for order in e.orders]

    @cached_property
    def _prompts(self) -> dict[tuple[int, int], SentPrompt]:
        """The prompt of each decision, by drone and step."""
        return prompts_of(self.recorded.logs.decisions, read_prompts(self.recorded.folder))

    def _own_velocity(self, drone: int, t_s: float) -> Vec3 | None:
        track = self.recorded.estimated_tracks.get(drone)
        return None if track is None else vec3(track.velocity_ned[track.newest(t_s)])

    def _picture(self, decision: Decision | None) -> ShownPicture | None:
        if decision is None or not self.recorded.run.is_rendered:
            return None
        path = self.recorded.picture_path(decision)
        jpeg = _jpeg(path) if path else None
        return None if jpeg is None else ShownPicture(decision.frame_id, jpeg, decision.t_frame)

    def _sight(self, decision: Decision | None) -> ChosenSight | None:
        """Return the ray to the point of a `go` action; None for other decisions."""
        go = chosen_go(decision) if decision else None
        if decision is None or go is None:
            return None
        pose = self.pose(decision.drone, decision.t_frame)
        camera = self.recorded.camera_at(decision.drone, decision.t_frame)
        return sight(go, pose.position_ned, pose.attitude, camera)

    def _height(self, place: Vec3) -> float:
        return (self.world.ground_down(place[0], place[1]) if self.world else 0.0) - place[2]

    # ---- data of the judge

    def _judge(self, t_s: float) -> JudgeMoment:
        if not self.recorded.logs.true:
            return JudgeMoment()
        target = self._target(t_s)
        away = tuple(math.dist(self.pose(d, t_s).position_ned, target) if target else None for d in self.drones)
        messages = tuple(text for t, text in self._declarations if t <= t_s + SAME_S)
        verdict = self.recorded.verdict
        deciding = verdict.deciding
        over = self.recorded.logs.end is not None and t_s >= self.end_s - SAME_S
        if over or (deciding is not None and t_s >= deciding.t - SAME_S):
            near = f", {verdict.ne_m:.2f} m from the target" if verdict.ne_m is not None else ""
            messages = (*messages, f"verdict: {verdict.outcome}{near}")
        return JudgeMoment(target_ned=target, distance_m=away, messages=messages[-MESSAGES:])

    @cached_property
    def _declarations(self) -> tuple[tuple[float, str], ...]:
        """The times of declarations (s), and the judge's notes on them."""
        flight = self.recorded
        declarations = []
        for d in flight.logs.decisions:
            if d.declares:
                counts = qualifies(d, flight.logs, flight.delta_m, flight.cap_s)
                declarations.append((d.t_decided, _declaration(measured(d, flight.logs), counts)))
        return tuple(sorted(declarations, key=itemgetter(0)))

    def _target(self, t_s: float) -> Vec3 | None:
        if self.world is not None:
            return self.world.target_centre(t_s)
        track = self.recorded.target_track
        return None if track is None else track.at(t_s).position_ned


def flight_moments(path: Path) -> FlightMoments:
    """Return the flight of an episode's folder, or of a run with one episode.

    A flight that was killed, or is still in the air, ends at the last time in its logs. Raises UsageError for any
    other folder, a damaged flight, a flight that never began, and a flight without a pose.
    """
    flight = RecordedFlight.read(episode_folder(path))
    folder, logs = flight.folder, flight.logs
    if logs.begin is None:
        raise UsageError(f"{folder} cannot be shown: its {layout.TRUTH} has no row of the beginning")
    missing = [] if logs.end is not None else [NO_END]
    missing += [] if flight.telemetry or flight.estimated_tracks else [NO_TLOG]
    world, unknown = _world(flight)
    missing += unknown
    if not flight.tracks:
        raise UsageError(f"{folder} has no pose of a drone, so there is nothing to show")
    kept = any((folder / layout.FRAMES).glob("*.jpg"))
    missing += [NOT_DRAWN] if not flight.run.is_rendered else [] if kept else [NO_PICTURES]
    return FlightMoments(flight, world, occurrences(flight), tuple(missing))


def check_same_episode(flights: Sequence[FlightMoments]) -> None:
    """Raise UsageError if the flights are of different episodes, or if only some of the flights have true poses."""
    first = flights[0].recorded
    for flight in flights[1:]:
        recorded, folders = flight.recorded, f"{first.folder} and {flight.recorded.folder}"
        if recorded.logs.true != first.logs.true:
            raise UsageError(
                f"only one of {folders} has truth; the other has estimates, in another frame. Replay them separately"
            )
        if recorded.id != first.id:
            raise UsageError(
                f"{folders} have the episodes {first.id} and {recorded.id}, but only flights of one episode can be"
                " overlaid. Replay them separately"
            )
        if recorded.record != first.record:
            raise UsageError(
                f"{folders} have different records with the id {first.id}, but only flights of one episode can be"
                " overlaid. Replay them separately"
            )


def _world(flight: RecordedFlight) -> tuple[World | None, list[str]]:
    """Return the world of a flight and no notes, or None and the reasons."""
    if not flight.logs.true:
        return None, [NO_TRUTH]
    if not (flight.folder / layout.EPISODE).is_file():
        return None, [NO_RECORD]
    try:
        return flight.world, []
    except UsageError as error:
        return None, [f"a grid is shown instead of the world: {error}"]


def _declaration(measures: Measured, qualified: bool | None) -> str:
    away = "at an unknown distance" if measures.distance_m is None else f"at {measures.distance_m:.2f} m"
    seen = {True: ", in view", False: ", out of view", None: ""}[measures.visible]
    counts = {True: "counts", False: "does not count", None: "not known"}[qualified]
    return f"{measures.t:.1f} s  {drone_label(measures.drone)} declared {away}{seen}: {counts}"


@lru_cache(32)
def _jpeg(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
