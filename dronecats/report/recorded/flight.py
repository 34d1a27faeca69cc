"""A flight read back from its folder: everything that the logs, MAVLink and the world tell of it.

Film, replay, export, report and study all read a flight here. What costs time is read when it is first needed.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.report.recorded.run import RecordedRun, recorded_run
from dronecats.report.recorded.telemetry import DroneTelemetry, Timeline, telemetry
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.reading import exchanges
from foundation.run_folder.rows import Decision, EstimatedPose, Exchange, FrameTruth, Pose

if TYPE_CHECKING:  # each takes a while to import, and most readers of a flight need none of them
    from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
    from episodes.maps.assets.multirotor import Outline
    from episodes.world.world import World

DecisionTime = Literal["t_frame", "t_decided"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenFrame:
    """One picture that the pilot was shown."""

    drone: int
    frame_id: int
    t_s: float  # s, when it was taken
    jpeg: Path


class RecordedFlight(JudgedFlight):
    """One flight of one episode. Times are s since it began, places m in the map's NED frame."""

    @cached_property
    def run(self) -> RecordedRun:
        """Its run, with this episode alone. Raises UsageError when a newer version wrote its run.json."""
        return recorded_run(self.folder)

    @property
    def instruction(self) -> str:
        """What the pilot was told; empty: not known."""
        return str(self.record.get("instruction") or self.run.flight.get("instruction") or "")

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """The questions to its commander; none where nobody commanded. Raises UsageError for a damaged log."""
        return exchanges(self.folder)

    @property
    def camera(self) -> CameraModel:
        """The camera that its frames were taken with."""
        return self.run.camera

    @property
    def t0_us(self) -> int:
        """µs, the vehicle's clock when it began."""
        return self.logs.begin.t0_us if self.logs.begin else 0

    @cached_property
    def end_s(self) -> float:
        """When it ended; of one without an end, when its logs were written last."""
        if self.logs.end:
            return self.logs.end.t
        times = [pose.t for pose in self.logs.poses] + [pose.t for pose in self.estimated_poses]
        return max([*times, *(decision.t_decided for decision in self.logs.decisions)], default=0.0)

    @property
    def estimated_poses(self) -> tuple[EstimatedPose, ...]:
        """The smoothed estimate of a flight whose truth nobody measured."""
        return self.logs.estimate.poses if self.logs.estimate else ()

    def latest_decision(self, drone: int, t_s: float, when: DecisionTime) -> Decision | None:
        """Return a drone's newest decision at a time, by when its picture was taken or when it was made."""
        timeline = self._decisions.get((drone, when))
        return timeline.at(t_s) if timeline else None

    @cached_property
    def _decisions(self) -> dict[tuple[int, DecisionTime], Timeline[Decision]]:
        found: dict[tuple[int, DecisionTime], Timeline[Decision]] = {}
        whens: tuple[DecisionTime, ...] = ("t_frame", "t_decided")
        for when in whens:
            for drone in {decision.drone for decision in self.logs.decisions}:
                own = [decision for decision in self.logs.decisions if decision.drone == drone]
                ordered = sorted(own, key=lambda decision: (getattr(decision, when), decision.step))
                found[drone, when] = Timeline(tuple(getattr(each, when) for each in ordered), tuple(ordered))
        return found

    @cached_property
    def frames(self) -> tuple[SeenFrame, ...]:
        """The pictures on which something was decided, in the order of time; none where no pictures were kept.

        Raises UsageError where one is missing.
        """
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
        """The world that it was flown in. Raises UsageError where its record or map is not here."""
        from episodes.records import record
        from episodes.world.world import World

        return World(record.load(self.folder / layout.EPISODE), self.outline)

    @cached_property
    def outline(self) -> "Outline":
        """The shape of its drones. Raises UsageError for an unknown airframe."""
        from episodes.maps.assets.multirotor import outline
        from vehicles import airframe

        return outline(airframe.load(self.run.airframe))

    @cached_property
    def map_origin(self) -> Vec3 | None:
        """lat °, lon °, alt m above mean sea level of the map's frame; None without a map.

        Raises UsageError for a map that is not here.
        """
        if not self.map:
            return None
        from episodes import maps

        scene = maps.build(self.map, int(self.record.get("map_seed") or 1))
        return (scene.latitude_deg, scene.longitude_deg, scene.altitude_m)

    @cached_property
    def origin(self) -> Vec3 | None:
        """The same, without a map that of the first autopilot that told; None: nobody tells. Raises UsageError."""
        told = (drone.origin for drone in self.telemetry.values() if drone.origin)
        return self.map_origin or next(told, None)

    # ---- where everybody was

    @cached_property
    def telemetry(self) -> Mapping[int, DroneTelemetry]:
        """What flight.tlog tells, by drone; {}: there is none. Raises UsageError when it cannot be read."""
        return telemetry(self.folder / layout.TLOG, self.t0_us)

    @cached_property
    def truth_rows(self) -> tuple[Pose | FrameTruth, ...]:
        """The poses and frames of truth.jsonl; none where nobody measured the truth."""
        return (*self.logs.poses, *self.logs.frames.values()) if self.logs.true else ()

    @cached_property
    def true_tracks(self) -> Mapping[int, "FlightTrack"]:
        """Where each drone truly was: by the truth bus, else by the log on board, else by truth.jsonl.

        {}: nobody measured it. Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded.tracks import track_of_rows

        drones = {row.drone for row in self.truth_rows}
        rows = {drone: [row for row in self.truth_rows if row.drone == drone] for drone in drones}
        tracks = {drone: self._measured_track(drone) or track_of_rows(rows[drone]) for drone in sorted(drones)}
        return {drone: track for drone, track in tracks.items() if track is not None}

    def _measured_track(self, drone: int) -> "FlightTrack | None":
        """Return the true track with attitudes, None where none was kept or the map is not here."""
        from dronecats.report.recorded import onboard_log, tracks

        map_origin: Vec3 | None = None
        with suppress(UsageError):
            map_origin = self.map_origin
        if map_origin is None:
            return None
        samples = self.telemetry[drone].truth(map_origin) if drone in self.telemetry else []
        if track := tracks.true_track(samples, self.t0_us):
            return track
        kept = onboard_log.kept_ulog(self.folder, drone)
        with suppress(UsageError):  # a torn log: truth.jsonl stands
            return onboard_log.true_track(kept, self.t0_us, map_origin) if kept else None
        return None

    @cached_property
    def estimated_tracks(self) -> Mapping[int, "FlightTrack"]:
        """Where each autopilot estimated that it was, in its own local frame: by its log on board, else by telemetry.

        Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded import onboard_log, tracks

        found: dict[int, FlightTrack] = {}
        for drone in range(max(self.telemetry, default=0) + 1):
            track = tracks.estimated_track(self.telemetry[drone]) if drone in self.telemetry else None
            kept = onboard_log.kept_ulog(self.folder, drone)
            with suppress(UsageError):  # a torn log: telemetry stands
                track = (onboard_log.estimated_track(kept, self.t0_us) if kept else None) or track
            if track is not None:
                found[drone] = track
        return found

    @cached_property
    def tracks(self) -> Mapping[int, "FlightTrack"]:
        """The tracks that are drawn, by drone: the true ones, of a flight without truth those of its autopilots.

        Raises UsageError when flight.tlog cannot be read.
        """
        from dronecats.report.recorded.tracks import track_of_rows

        true = {  # the log on board knows no steps of 1.1 cm
            drone: track.drawn() if track.level or drone in self.telemetry else track
            for drone, track in self.true_tracks.items()
        }
        if true or self.estimated_tracks:
            return true or self.estimated_tracks
        smoothed = {row.drone: [each for each in self.estimated_poses if each.drone == row.drone]
                    for row in self.estimated_poses}  # fmt: skip
        tracks = {drone: track_of_rows(rows) for drone, rows in sorted(smoothed.items())}
        return {drone: track.drawn() for drone, track in tracks.items() if track is not None}

    @property
    def drones(self) -> tuple[int, ...]:
        """The numbers of all that have a track."""
        return tuple(sorted(self.tracks))

    @cached_property
    def drone_tracks(self) -> "tuple[DroneTracks, ...]":
        """Where each drone was during the episode, estimated and true, by its number. Raises UsageError."""
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
        """Where the target's centre was, as far as truth.jsonl tells it."""
        from dronecats.report.recorded.tracks import target_track

        return target_track(self.truth_rows)
