"""A recorded flight at any moment: what a page shows, and the occurrences that one can jump to."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from dronecats.judge.verdict import Measured, measured, qualifies
from dronecats.report.kit.shell import action_or_reason
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.telemetry import DroneTelemetry
from dronecats.view.live.moment import ChosenSight, DroneMoment, JudgeMoment, Moment, ShownPicture, chosen_go, sight
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.prompts import SentPrompt, prompts_of, read_prompts
from foundation.run_folder.reading import Logs, episode_folder, rows
from foundation.run_folder.rows import Decision, DroneNumber, Order, drone_label

SAME_S = 1e-6  # s within which one is there already
CALM = ("cap", "decided")  # ends of flights in which nothing went wrong
OFFBOARD = "OFFBOARD"
ENDING_S = 1.0  # s before a flight's end in which its own run takes it out of that mode


class OccurrenceKind(Enum):
    """Of what sort it is."""

    DECISION = "decision"
    DECLARATION = "declaration"
    FAULT = "what went wrong"


@dataclass(frozen=True, slots=True)
class Occurrence:
    """Something that happened at one time."""

    t_s: float  # s since the episode began
    kind: OccurrenceKind
    drone: int | None  # None: of all
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvelopeRow:
    """A line of safety.jsonl: which limits of the envelope act from then on; none: none does any more."""

    time_us: int  # µs, vehicle clock
    drone: DroneNumber
    limits: tuple[str, ...]


def envelope_rows(path: Path, t0_us: int) -> tuple[Occurrence, ...]:
    """Return what a safety.jsonl tells, nothing where there is none. Raises UsageError where it is damaged."""
    told = rows(path, EnvelopeRow) if path.is_file() else ()
    return tuple(
        Occurrence((row.time_us - t0_us) / 1e6, OccurrenceKind.FAULT, row.drone,
                   f"envelope: limited by {', '.join(row.limits)}")
        for row in told if row.limits
    )  # fmt: skip


def occurrences(
    logs: Logs, vehicles: Mapping[int, DroneTelemetry], limited: Iterable[Occurrence], end_s: float
) -> tuple[Occurrence, ...]:
    """Return everything that happened from the beginning to `end_s`, in the order of time."""
    every = [*_decided(logs), *limited, *_end(logs, end_s)]
    for vehicle in vehicles.values():
        every += [*_warned(vehicle), *_left_alone(vehicle, end_s)]
    return tuple(sorted((one for one in every if 0.0 <= one.t_s <= end_s + SAME_S), key=lambda one: one.t_s))


def following(found: Sequence[Occurrence], t_s: float) -> Occurrence | None:
    """Return the first that is later than a time, None after the last."""
    index = bisect_right(found, t_s + SAME_S, key=lambda one: one.t_s)
    return found[index] if index < len(found) else None


def preceding(found: Sequence[Occurrence], t_s: float) -> Occurrence | None:
    """Return the last that is earlier than a time, None before the first."""
    index = bisect_left(found, t_s - SAME_S, key=lambda one: one.t_s)
    return found[index - 1] if index else None


def _decided(logs: Logs) -> Iterator[Occurrence]:
    for one in logs.decisions:
        words = f"step {one.step}: {action_or_reason(one)}"
        yield Occurrence(one.t_decided, OccurrenceKind.DECISION, one.drone, words)
        if one.declares:
            yield Occurrence(one.t_decided, OccurrenceKind.DECLARATION, one.drone, f"step {one.step}: declared")
        if one.action is None:
            yield Occurrence(one.t_decided, OccurrenceKind.FAULT, one.drone, words)


def _warned(vehicle: DroneTelemetry) -> Iterator[Occurrence]:
    for t_s, text in zip(vehicle.warnings.t_s, vehicle.warnings.values, strict=True):
        yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, text)


def _left_alone(vehicle: DroneTelemetry, end_s: float) -> Iterator[Occurrence]:
    """Yield when the mode was no longer ours although the episode went on: a failsafe, or somebody's hand."""
    before = ""
    for t_s, state in zip(vehicle.states.t_s, vehicle.states.values, strict=True):
        if before == OFFBOARD and state.mode != OFFBOARD and t_s < end_s - ENDING_S:
            yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, f"mode {state.mode}")
        before = state.mode


def _end(logs: Logs, end_s: float) -> Iterator[Occurrence]:
    if logs.end is not None and logs.end.reason not in CALM:
        said = f": {logs.end.error}" if logs.end.error else ""
        yield Occurrence(end_s, OccurrenceKind.FAULT, None, f"the flight ended: {logs.end.reason}{said}")


SAID = 8  # texts that a moment remembers
SOON_S = 1e-6
NO_END = "without an end: it was killed, or is still in the air"
NO_TLOG = f"no {layout.TLOG}: drawn level between its places, without modes, battery and setpoints"
NO_PICTURES = "no pictures were kept"
NOT_DRAWN = "flown without drawing pictures"
NO_TRUTH = "nobody knew the truth: places are the autopilot's own, and nothing is judged"
NO_RECORD = f"no {layout.EPISODE}: a plain grid in place of the world"


@dataclass(frozen=True)
class FlightMoments:
    """One recorded flight at any time of it, whatever was kept of it."""

    recorded: RecordedFlight
    world: World | None  # in which it was flown; None: not known here
    happened: tuple[Occurrence, ...]  # in the order of time
    missing: tuple[str, ...]  # sentences about what the folder, or this machine, does not have
    _pictures: dict[tuple[int, int], ShownPicture] = field(default_factory=dict)

    @property
    def drones(self) -> tuple[int, ...]:
        """The numbers of all that flew."""
        return self.recorded.drones

    @property
    def end_s(self) -> float:
        """When the flight ended."""
        return self.recorded.end_s

    @property
    def true(self) -> bool:
        """Whether the places are the truth, and not an autopilot's estimate."""
        return self.recorded.logs.true

    def of(self, kind: OccurrenceKind) -> tuple[Occurrence, ...]:
        """Return what happened of one sort, in the order of time."""
        return tuple(one for one in self.happened if one.kind is kind)

    def pose(self, drone: int, t_s: float) -> DronePose:
        """Return where a drone of `drones` was; before the first sample and after the last it stays there."""
        return self.recorded.tracks[drone].at(t_s)

    def way(self, drone: int, t_s: float, every_s: float) -> list[Vec3]:
        """Return the places of a drone from the beginning to a time, so many seconds apart."""
        places = self.recorded.tracks[drone].positions(np.append(np.arange(0.0, t_s, every_s), t_s))
        return [(float(north), float(east), float(down)) for north, east, down in places]

    def moment(self, t_s: float) -> Moment:
        """Return all that is shown of a time; before the beginning and after the end, of these."""
        t_s = min(max(t_s, 0.0), self.end_s)
        drones = tuple(self._drone(drone, t_s) for drone in self.drones)
        newest = max((each.decision for each in drones if each.decision), key=lambda d: d.t_decided, default=None)
        end = self.recorded.logs.end
        over = end is not None and t_s >= self.end_s - SOON_S
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
        asked = self.recorded.latest_decision(drone, t_s, "t_frame")
        decided = self.recorded.latest_decision(drone, t_s, "t_decided")
        state = telemetry.states.at(t_s)
        ray = self._sight(decided)
        return DroneMoment(
            drone=drone,
            position_ned=pose.position_ned,
            attitude=pose.attitude,
            velocity_ned=telemetry.true_velocity.at(t_s) if self.true else self._own_velocity(drone, t_s),
            true=self.true,
            height_m=self._height(pose.position_ned),
            setpoint_ned=telemetry.setpoint_velocity.at(t_s) if state is None or state.mode == OFFBOARD else None,
            mode=state.mode if state else "",
            armed=state.armed if state else None,
            battery=state.battery if state else None,
            said=self._said(drone, t_s),
            prompt=sent.text if decided and (sent := self._prompts.get((drone, decided.step))) else "",
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
        answered = (one for one in self.recorded.exchanges if one.t_answered is not None)
        return [(one.t_answered or 0.0, order) for one in answered for order in one.orders]

    @cached_property
    def _prompts(self) -> dict[tuple[int, int], SentPrompt]:
        """The question that each decision answers, by drone and step."""
        return prompts_of(self.recorded.logs.decisions, read_prompts(self.recorded.folder))

    def _own_velocity(self, drone: int, t_s: float) -> Vec3 | None:
        track = self.recorded.estimated_tracks.get(drone)
        if track is None:
            return None
        north, east, down = map(float, track.velocity_ned[track.newest(t_s)])
        return (north, east, down)

    def _picture(self, decision: Decision | None) -> ShownPicture | None:
        if decision is None or not self.recorded.run.is_rendered:
            return None
        path = self.recorded.picture_path(decision)
        jpeg = _jpeg(path) if path else None
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
        return sight(go, pose.position_ned, pose.attitude, self.recorded.camera)

    def _height(self, place: Vec3) -> float:
        return (self.world.ground_down(place[0], place[1]) if self.world else 0.0) - place[2]

    # ---- what only the judge knows

    def _judge(self, t_s: float) -> JudgeMoment:
        if not self.true:
            return JudgeMoment()
        target = self._target(t_s)
        away = tuple(math.dist(self.pose(d, t_s).position_ned, target) if target else None for d in self.drones)
        said = tuple(text for t, text in self._declarations if t <= t_s + SOON_S)
        verdict = self.recorded.verdict
        deciding = verdict.deciding
        over = self.recorded.logs.end is not None and t_s >= self.end_s - SOON_S
        if over or (deciding is not None and t_s >= deciding.t - SOON_S):
            near = f", {verdict.ne_m:.2f} m from the target" if verdict.ne_m is not None else ""
            said = (*said, f"verdict: {verdict.outcome}{near}")
        return JudgeMoment(target_ned=target, distance_m=away, said=said[-SAID:])

    @cached_property
    def _declarations(self) -> tuple[tuple[float, str], ...]:
        """When arrival was declared (s), and what the judge says of it."""
        flight = self.recorded
        each = [
            (d.t_decided, _declared(measured(d, flight.logs), qualifies(d, flight.logs, flight.delta_m, flight.cap_s)))
            for d in flight.logs.decisions
            if d.declares
        ]
        return tuple(sorted(each, key=lambda one: one[0]))

    def _target(self, t_s: float) -> Vec3 | None:
        if self.world is not None:
            return self.world.target_centre(t_s)
        track = self.recorded.target_track
        return None if track is None else track.at(t_s).position_ned


def flight_moments(path: Path) -> FlightMoments:
    """Return the flight of an episode's folder, or of a run's only one.

    One that was killed, or is still in the air, is there as far as its logs go. Raises UsageError where that is none,
    is damaged, never began, or tells no place of any drone.
    """
    if not path.is_dir():
        raise UsageError(f"there is no folder {path}")
    flight = RecordedFlight.read(episode_folder(path))
    folder, logs = flight.folder, flight.logs
    if logs.begin is None:
        raise UsageError(f"{folder} never began: its {layout.TRUTH} has no beginning")
    missing = [] if logs.end is not None else [NO_END]
    missing += [] if flight.telemetry or flight.estimated_tracks else [NO_TLOG]
    world, unknown = _world(flight)
    missing += unknown
    if not flight.tracks:
        raise UsageError(f"{folder} tells no place of any drone: there is nothing to show")
    kept = any((folder / layout.FRAMES).glob("*.jpg"))
    missing += [NOT_DRAWN] if not flight.run.is_rendered else [] if kept else [NO_PICTURES]
    limited = envelope_rows(folder / layout.SAFETY, flight.t0_us)
    return FlightMoments(
        flight, world, occurrences(logs, flight.telemetry, limited, flight.end_s), tuple(missing)
    )  # fmt: skip


def of_one_episode(flights: Sequence[FlightMoments]) -> None:
    """Raise UsageError naming two of these flights that are not of one episode."""
    first, others = flights[0], flights[1:]
    for other in others:
        if other.true != first.true:
            raise UsageError(f"of {first.recorded.folder} and {other.recorded.folder} only one tells the truth: places "
                             "of the other are its autopilot's own, and lie in no common frame")  # fmt: skip
        if other.recorded.id != first.recorded.id:
            raise UsageError(f"{first.recorded.folder} is of {first.recorded.id} and {other.recorded.folder} of "
                             f"{other.recorded.id}: only flights of one episode are laid over one another")  # fmt: skip
        if other.recorded.record != first.recorded.record:
            raise UsageError(f"{first.recorded.folder} and {other.recorded.folder} are of two records both named "
                             f"{first.recorded.id}: only flights of one episode are laid over one another")  # fmt: skip


def _world(flight: RecordedFlight) -> tuple[World | None, list[str]]:
    """Return the world of a flight, or why there is none."""
    if not flight.logs.true:
        return None, [NO_TRUTH]
    if not (flight.folder / layout.EPISODE).is_file():
        return None, [NO_RECORD]
    try:
        return flight.world, []
    except UsageError as error:
        return None, [f"a plain grid in place of the world: {error}"]


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
