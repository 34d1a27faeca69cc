"""Flies an episode in the project's simulation."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from dronecats.agent.pictures import PicturePath
from dronecats.flight.run.accounts import check_budget
from dronecats.flight.run.ascent import start_of
from dronecats.flight.run.episode import EpisodeEnd, Ready
from dronecats.flight.run.setup import FlightSetup, Notify
from dronecats.flight.spec.disturbances import FrameFaults
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Simulated
from foundation.camera import Frame
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.errors import DronecatsError, UsageError
from foundation.run_folder import layout
from foundation.run_folder.rows import drone_label
from vehicles import airframe as airframes


class SimulatedFlight(FlightSetup):
    """A flight of simulated vehicles, in lockstep or in real time."""

    def __init__(self, flight: Flight) -> None:
        """Raises UsageError for a flight without an episode."""
        if flight.record is None:
            raise UsageError("a simulated flight needs an episode. Name one with --episode")
        self._record, spec = flight.record, flight.spec
        super().__init__(flight, self._record.id, flight.camera)
        disclaimer = " (built-in, not a model)" if spec.pilot and not spec.replay else ""
        self.headline = f'episode {self.episode}: "{self._record.instruction}", pilot {spec.pilot_name}{disclaimer}'

    def write_record(self, folder: Path) -> None:
        (folder / layout.EPISODE).write_text(self._record.to_json(), encoding="utf-8")

    @contextmanager
    def ready(self, folder: Path, notify: Notify) -> Iterator[Ready]:
        from dronecats.flight.run.truth import TrueStart, opened_in
        from dronecats.flight.sitl.episode_world import world_of
        from dronecats.flight.stages.stage import Stage
        from episodes.world.world import World

        flight, record = self.flight, self._record
        spec, simulated = flight.spec, flight.spec.simulated or Simulated()
        check_budget(spec.accounts, folder.parent)
        pace: Callable[[], dict[str, float]] | None = None
        recall: Callable[[int, int], Frame]
        stage: Stage
        if simulated.speed is None:
            from dronecats.flight.sitl import compile_ahead

            notify(f"lockstep: loading core and camera{compile_ahead.compile_notice()} …")
            from dronecats.flight.stages.lockstep import LockstepStage

            world = world_of(record, simulated.airframe, conditions=spec.disturbances.conditions.of_map)
            stage = lockstep = LockstepStage(flight, simulated, folder, world)
            recall = lockstep.camera.at
        else:
            from dronecats.flight.stages.realtime import RealtimeStage

            world = World(record)
            stage = realtime = RealtimeStage(flight, simulated, folder, notify)
            pace, recall = realtime.pace, realtime.camera.at
        try:
            clearance_m = airframes.load(simulated.airframe).standing_m
            starts = [start_of(s, world.ground_down(*s.position_ned[:2]), clearance_m) for s in record.starts]
            # only a flight with PX4 is checked; the project's autopilot is known to reach its start pose
            true_start = TrueStart(stage, world) if simulated.autopilot == "px4" else None
            faults = spec.disturbances.frame
            pictures = None if faults == FrameFaults() else PicturePath(**asdict(faults), recall=recall)
            with opened_in(world, flight, stage, folder) as pilot:
                yield Ready(stage=stage, starts=starts, pilot=pilot, true_start=true_start, pictures=pictures)
        finally:
            try:
                if pace is not None:
                    with suppress(DronecatsError):  # the flight has already reported a dead simulator
                        self.pace = pace()
            finally:
                stage.close()

    def finish(self, folder: Path, ending: EpisodeEnd, notify: Notify) -> None:
        if ending.steps:
            draw(folder, self.flight.spec.disturbances.conditions.of_map)
        for drone in range(len(self._record.starts) if self.flight.spec.keep_ulog else 0):
            if not (folder / layout.onboard_log_name(drone)).exists():
                notify(
                    f"PX4's log of {drone_label(drone)} was not kept: PX4 wrote none. It writes a log only after arming"
                )


def draw(folder: Path, conditions: SceneConditions = AS_BUILT) -> None:
    """Draw flight.png of an episode folder in this light and season. Write errors to flight.png.error; raise none."""
    from dronecats.flight.picture import aerial
    from dronecats.flight.picture import draw as draw_flight
    from dronecats.flight.sitl.episode_world import load_world

    try:
        world = load_world(str(folder / layout.EPISODE), conditions=conditions)
        picture, extent = aerial(world, folder)
        draw_flight(folder, picture, extent)
    except (DronecatsError, OSError, ValueError) as error:
        (folder / "flight.png.error").write_text(f"{error}\n", encoding="utf-8")
