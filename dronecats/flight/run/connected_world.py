"""Flies a vehicle that an external simulator moves, in an episode (with a verdict) or on a map (without one)."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from dronecats.flight.run.ascent import start_of
from dronecats.flight.run.connected import VehicleFlight, open_link
from dronecats.flight.run.episode import EpisodeEnd, Ready
from dronecats.flight.run.setup import Notify
from dronecats.flight.run.simulated import draw
from dronecats.flight.run.truth import TrueStart, opened_in
from dronecats.flight.sitl.truth_bridge import TruthSource
from dronecats.flight.spec.flight import CAMERA, Flight
from dronecats.flight.spec.flight_spec import Connected
from dronecats.flight.stages.realtime import WorldStage
from dronecats.pilots import roster
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import wrap_pi
from foundation.run_folder import layout
from foundation.run_folder.folder import write_json
from hil.link.envelope import Limits


class ConnectedWorldFlight(VehicleFlight):
    """A flight in an episode's world: camera, logger and oracle use the true poses from the vehicle's simulator."""

    def __init__(self, flight: Flight, vehicle: Connected, truth: str) -> None:
        """Open the vehicle's link; `truth` is the URL of the true poses. Raises UsageError, LinkError."""
        spec, record = flight.spec, flight.record
        if record is None:
            raise UsageError("a vehicle that simulates itself needs a world. Name an episode or a map with --world")
        if spec.map is not None and roster.needs_truth(spec.pilot):
            raise UsageError(
                f"the pilot {spec.pilot} needs an episode's target, and a map has none. Choose --pilot vision"
            )
        self._judged = spec.map is None and not vehicle.authority.dry  # a map has no target; a dry run cannot succeed
        self._record, self._truth, self._world = record, truth, World(record)
        if len(record.starts) > 1:
            raise UsageError(
                f"{record.id} is for {len(record.starts)} drones, but --truth gives the pose of one drone only."
                " Choose an episode for one drone"
            )
        # a first pose is read here, so that a wrong URL fails before the run folder is created; in flight a child
        # process reads the poses
        source = TruthSource(truth)
        try:
            source.first()
        finally:
            source.close()
        super().__init__(flight, vehicle, open_link(vehicle, spec.envelope), record.id, CAMERA)
        self.headline = (
            f'episode {record.id}: "{record.instruction}", pilot {spec.pilot_name}, on a vehicle that simulates itself'
        )

    def write_record(self, folder: Path) -> None:
        self._world_record_path(folder).write_text(self._record.to_json(), encoding="utf-8")
        if not self._judged:
            write_json(folder / layout.EPISODE, {"id": self._record.id, "instruction": self._record.instruction})

    @contextmanager
    def ready(self, folder: Path, notify: Notify) -> Iterator[Ready]:
        record, world, frame_s = self._record, self._world, (self.flight.spec.envelope or Limits()).frame_s
        stage = WorldStage(
            self.link,
            self._world_record_path(folder),
            self._truth,
            folder,
            notify,
            frame_s=frame_s,
            judged=self._judged,
        )
        try:
            start = start_of(record.starts[0], world.ground_down(*record.starts[0].position_ned[:2]))
            # the record's heading is on the map; `placement.turn` rotates the vehicle's own world onto the map
            start = replace(start, yaw=wrap_pi(math.radians(record.starts[0].yaw_deg) - stage.placement.turn))
            true_start = TrueStart(stage, world, stage.placement) if self._judged else None
            with opened_in(world, self.flight, stage, folder) as pilot:
                yield Ready(stage=stage, starts=[start], pilot=pilot, true_start=true_start)
        finally:
            stage.close()

    def finish(self, folder: Path, ending: EpisodeEnd, notify: Notify) -> None:
        super().finish(folder, ending, notify)
        if ending.steps and self._judged:
            draw(folder)

    def _world_record_path(self, folder: Path) -> Path:
        """Return the path of the record whose world the camera renders."""
        return folder / (layout.EPISODE if self._judged else layout.WORLD)
