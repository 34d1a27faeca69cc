"""Reads a flight from its folder: its logs, telemetry, tracks and world.

A slow part of a flight, such as its telemetry, is read when it is first used.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from msgspec import UNSET

from dronecats.agent.action import Action, ActionError, action_from
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.report.recorded.run import RecordedRun, recorded_run
from dronecats.report.recorded.telemetry import DroneTelemetry, Timeline, telemetry
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.reading import exchanges
from foundation.run_folder.rows import Decision, EstimatedPose, Exchange, FrameTruth, Pose

if TYPE_CHECKING:  # slow to import, rarely needed
    from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
    from episodes.maps.assets.multirotor import Outline
    from episodes.world.world import World

DecisionTime = Literal["t_frame", "t_decided"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenFrame:
    """One picture that the pilot received."""

    drone: int
    frame_id: int
    t_s: float  # s, time of the picture
    jpeg: Path


def action_of(decision: Decision) -> Action | None:
    """Return the action of a decision; None: no valid action."""
    try:
        return action_from(decision.action)
    except ActionError:
        return None


class RecordedFlight(JudgedFlight):
    """One flight of one episode. Times are in s since the episode began, positions in m in the map's NED frame."""

    @cached_property
    def run(self) -> RecordedRun:
        """The flight's run, with only this episode. Raises UsageError if a newer version wrote run.json."""
        return recorded_run(self.folder)

    @property
    def instruction(self) -> str:
        """The instruction to the pilot; empty: unknown."""
        return str(self.record.get("instruction") or self.run.flight.get("instruction") or "")

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """The exchanges with the commander, if any. Raises UsageError for a damaged log."""
        return exchanges(self.folder)

    @property
    def camera(self) -> CameraModel:
        """The camera that took the frames."""
        return self.run.camera

    def camera_at(self, drone: int, t_s: float) -> CameraModel:
        """Return the camera at a time.

        A camera on a gimbal has the pitch of the drone's newest frame; before the first frame, the first frame's pitch.
        """
        pitches = {
            frame.t: frame.camera_pitch_deg
            for frame in self.logs.frames.values()
            if frame.drone == drone and frame.camera_pitch_deg is not UNSET
        }
        before = [t for t in pitches if t <= t_s] or [*pitches][:1]
        return replace(self.camera, pitch_deg=pitches[max(before)]) if before else self.camera

    def camera_changes(self, drone: int) -> list[tuple[float, CameraModel]]:
        """Return (time in s, camera) at 0 s and at each frame for which a gimbal has changed the pitch."""
        changes = [(0.0, self.camera_at(drone, 0.0))]
        for t_s in sorted(frame.t for frame in self.logs.frames.values() if frame.drone == drone):
            if (camera := self.camera_at(drone, t_s)) != changes[-1][1]:
                changes.append((t_s, camera))
        return changes

    @property
    def t0_us(self) -> int:
        """The vehicle's time (µs) at the beginning of the episode; 0 if the episode did not begin."""
        return self.logs.begin.t0_us if self.logs.begin else 0

    @cached_property
    def end_s(self) -> float:
        """The end of the flight (s); without a logged end, the last time in the logs."""
        if self.logs.end:
            return self.logs.end.t
        times = [pose.t for pose in self.logs.poses] + [pose.t for pose in self.estimated_poses]
        return max([*times, *(decision.t_decided for decision in self.logs.decisions)], default=0.0)

    @property
    def estimated_poses(self) -> tuple[EstimatedPose, ...]:
        """The smoothed estimated poses of a flight without logged true poses."""
        return self.logs.estimate.poses if self.logs.estimate else ()

    def latest_decision(self, drone: int, t_s: float, when: DecisionTime) -> Decision | None:
        """Return a drone's newest decision at a time; None: none yet.

        `when`: a decision is valid from its picture's time (`t_frame`), or from its own time (`t_decided`).
        """
        timeline = self._decisions.get((drone, when))
        return timeline.at(t_s) if timeline else None

    @cached_property
    def _decisions(self) -> dict[tuple[int, DecisionTime], Timeline[Decision]]:
        timelines: dict[tuple[int, DecisionTime], Timeline[Decision]] = {}
        whens: tuple[DecisionTime, ...] = ("t_frame", "t_decided")
        for when in whens:
            for drone in {decision.drone for decision in self.logs.decisions}:
                own = [decision for decision in self.logs.decisions if decision.drone == drone]
                ordered = sorted(own, key=lambda decision: (getattr(decision, when), decision.step))
                timelines[drone, when] = Timeline(
                    tuple(getattr(decision, when) for decision in ordered), tuple(ordered)
                )
        return timelines

    @cached_property
    def frames(self) -> tuple[SeenFrame, ...]:
        """The pictures of all decisions, by time; (): no pictures. Raises UsageError if a picture is missing."""
        if not any((self.folder / layout.FRAMES).glob("*.jpg")):
            return ()
        seen: dict[tuple[int, int], SeenFrame] = {}
        for decision in self.logs.decisions:
            if (decision.drone, decision.frame_id) in seen:
                continue
            path = self.picture_path(decision)
            if path is None:
                name = layout.frame_name(decision.frame_id, decision.drone)
                raise UsageError(f"{self.folder} is damaged: the picture {name} of step {decision.step} is missing")
            frame = SeenFrame(drone=decision.drone, frame_id=decision.frame_id, t_s=decision.t_frame, jpeg=path)
            seen[decision.drone, decision.frame_id] = frame
        return tuple(sorted(seen.values(), key=lambda frame: (frame.t_s, frame.drone)))

    # ---- the world

    @cached_property
    def world(self) -> "World":
        """The world of the episode. Raises UsageError if the record or the map is missing."""
        from episodes.records import record
        from episodes.world.world import World

        return World(record.load(self.folder / layout.EPISODE), self.outline, conditions=self.run.conditions)

    @cached_property
    def outline(self) -> "Outline":
        """The shape of the drones. Raises UsageError for an unknown airframe."""
        from episodes.maps.assets.multirotor import outline
        from vehicles import airframe

        return outline(airframe.load(self.run.airframe))

    @cached_property
    def map_origin(self) -> Vec3 | None:
        """The origin of the map's frame: lat °, lon °, alt m above mean sea level; None: no map.

        Raises UsageError for an unknown map.
        """
        if not self.map:
            return None
        from episodes import maps

        scene = maps.build(self.map, int(self.record.get("map_seed") or 1))
        return (scene.latitude_deg, scene.longitude_deg, scene.altitude_m)

    @cached_property
    def origin(self) -> Vec3 | None:
        """The map's origin; without a map, the first origin from an autopilot; None: unknown.

        Raises UsageError for an unknown map, or if flight.tlog cannot be read.
        """
        origins = (drone.origin for drone in self.telemetry.values() if drone.origin)
        return self.map_origin or next(origins, None)

    # ---- telemetry and tracks

    @cached_property
    def telemetry(self) -> Mapping[int, DroneTelemetry]:
        """The messages of flight.tlog, by drone; {}: no flight.tlog. Raises UsageError if it cannot be read."""
        return telemetry(self.folder / layout.TLOG, self.t0_us)

    @cached_property
    def truth_rows(self) -> tuple[Pose | FrameTruth, ...]:
        """The poses and frames of truth.jsonl; (): no true poses were logged."""
        return (*self.logs.poses, *self.logs.frames.values()) if self.logs.true else ()

    @cached_property
    def true_tracks(self) -> Mapping[int, "FlightTrack"]:
        """The true track of each drone: from the truth bus, else from the onboard log, else from truth.jsonl.

        The truth bus is the simulator's messages with true poses, in flight.tlog. Empty if no true poses were logged.
        Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded.tracks import track_of_rows

        drones = {row.drone for row in self.truth_rows}
        rows = {drone: [row for row in self.truth_rows if row.drone == drone] for drone in drones}
        tracks = {drone: self._measured_track(drone) or track_of_rows(rows[drone]) for drone in sorted(drones)}
        return {drone: track for drone, track in tracks.items() if track is not None}

    def _measured_track(self, drone: int) -> "FlightTrack | None":
        """Return the true track with attitudes; None: no log has such a track, or the map is missing."""
        from dronecats.report.recorded import tracks

        map_origin: Vec3 | None = None
        with suppress(UsageError):
            map_origin = self.map_origin
        if map_origin is None:
            return None
        samples = self.telemetry[drone].truth(map_origin) if drone in self.telemetry else []
        if track := tracks.true_track(samples, self.t0_us):
            return track
        kept = tracks.onboard_log_path(self.folder, drone)
        with suppress(UsageError):  # for a damaged onboard log, the caller uses truth.jsonl
            return tracks.onboard_true_track(kept, self.t0_us, map_origin) if kept else None
        return None

    @cached_property
    def estimated_tracks(self) -> Mapping[int, "FlightTrack"]:
        """The estimated track of each autopilot, in its local frame: from its onboard log, else from telemetry.

        Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded import tracks

        estimated: dict[int, FlightTrack] = {}
        for drone in range(max(self.telemetry, default=0) + 1):
            track = tracks.estimated_track(self.telemetry[drone]) if drone in self.telemetry else None
            kept = tracks.onboard_log_path(self.folder, drone)
            with suppress(UsageError):  # for a damaged onboard log, use the telemetry
                track = (tracks.onboard_estimated_track(kept, self.t0_us) if kept else None) or track
            if track is not None:
                estimated[drone] = track
        return estimated

    @cached_property
    def tracks(self) -> Mapping[int, "FlightTrack"]:
        """The tracks for drawing, by drone: the true tracks; if no true poses were logged, the estimated tracks.

        Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded.tracks import track_of_rows

        true = {  # a track from the onboard log needs no smoothing
            drone: track.drawn() if track.level or drone in self.telemetry else track
            for drone, track in self.true_tracks.items()
        }
        if true or self.estimated_tracks:
            return true or self.estimated_tracks
        smoothed = {drone: [pose for pose in self.estimated_poses if pose.drone == drone]
                    for drone in {pose.drone for pose in self.estimated_poses}}  # fmt: skip
        tracks = {drone: track_of_rows(rows) for drone, rows in sorted(smoothed.items())}
        return {drone: track.drawn() for drone, track in tracks.items() if track is not None}

    @property
    def drones(self) -> tuple[int, ...]:
        """The numbers of the drones with a track."""
        return tuple(sorted(self.tracks))

    @cached_property
    def drone_tracks(self) -> "tuple[DroneTracks, ...]":
        """The estimated and true tracks of each drone during the episode, by drone number.

        Raises UsageError if flight.tlog cannot be read.
        """
        from dronecats.report.recorded.tracks import drone_tracks

        numbers = {row.drone for row in self.logs.decisions} | {row.drone for row in self.logs.poses}
        return tuple(
            drone_tracks(
                number,
                self.true_tracks.get(number),
                self.telemetry.get(number, DroneTelemetry(number)),
                self.end_s,
                self.origin,
            )
            for number in range(max(numbers, default=0) + 1)
        )

    @cached_property
    def target_track(self) -> "FlightTrack | None":
        """The track of the target's centre in truth.jsonl; None without one."""
        from dronecats.report.recorded.tracks import target_track

        return target_track(self.truth_rows)
