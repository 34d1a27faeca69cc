"""A flight of our own simulation, from its spec to a judged folder."""

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.agent.pictures import PicturePath
from dronecats.flight.run.accounts import check_budget
from dronecats.flight.run.ascent import start_of
from dronecats.flight.run.episode import Flown, fly
from dronecats.flight.run.first_question import asked_folder
from dronecats.flight.run.outcome import Say, fly_and_judge, served_rate_hz
from dronecats.flight.run.settings import settings
from dronecats.flight.run.step_lines import StepLines
from dronecats.flight.spec.disturbances import FrameFaults
from dronecats.flight.spec.flight import Flight, look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from episodes.records.record import EpisodeRecord
from foundation.camera import Frame
from foundation.errors import DronecatsError, InfrastructureError, UsageError
from foundation.run_folder import folder as folders
from foundation.run_folder import layout
from foundation.run_folder.rows import drone_label
from vehicles import airframe as airframes


def fly_simulated(spec: FlightSpec, out: Path | None, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with the exit `status` and the `reason` the flight ended. Raises UsageError."""
    flight = look_up(spec)
    record = _record(flight)
    found = settings(flight, flight.camera)
    with asked_folder(spec, out, record.id, found, say) as folder:
        disclaimer = " (built in, not a model)" if spec.pilot and not spec.replay else ""
        say(f'episode {record.id}: "{record.instruction}", pilot {spec.pilot_name}{disclaimer}')

        def afterwards(flown: Flown) -> None:
            folders.write_run(folder.parent, {**found, "served_rate_hz": served_rate_hz(folder)})
            if flown.steps:
                draw(folder)
            for drone in range(len(record.starts) if spec.keep_ulog else 0):
                if not (folder / layout.onboard_log_name(drone)).exists():
                    say(f"PX4's log of {drone_label(drone)} is not kept: it wrote none, as before its first arming")

        return fly_in(folder, flight, say, found, afterwards)


def fly_in(
    folder: Path,
    flight: Flight,
    say: Say,
    found: dict[str, Any],
    afterwards: Callable[[Flown], None] = lambda flown: None,
) -> dict[str, Any]:
    """Fly in an episode folder that stands, judge it, and return what `fly --json` prints.

    `found` takes how well a flight in real time held it.
    """
    record = _record(flight)
    try:
        (folder / layout.EPISODE).write_text(record.to_json(), encoding="utf-8")
    except OSError as full:
        raise InfrastructureError(f"{folder} cannot be written: {full.strerror}") from None
    return fly_and_judge(
        lambda: _fly(flight, record, folder, say, found), folder, record.id, flight.spec.pilot_name, afterwards,
        pace=lambda: found.get("pace"),
    )  # fmt: skip


def _record(flight: Flight) -> EpisodeRecord:
    if flight.record is None:
        raise UsageError("a simulated flight wants an episode: name one with --episode")
    return flight.record


def _fly(flight: Flight, record: EpisodeRecord, folder: Path, say: Say, found: dict[str, Any]) -> Flown:
    from dronecats.flight.run.oracle import opened_in
    from dronecats.flight.run.true_start import TrueStart
    from dronecats.flight.sitl.scenario import world_of
    from dronecats.flight.stages.stage import TruthfulStage
    from episodes.world.world import World

    spec, simulated = flight.spec, flight.spec.simulated or Simulated()
    check_budget(spec.accounts, folder.parent)
    pace: Callable[[], dict[str, float]] | None = None
    recall: Callable[[int, int], Frame]
    if simulated.speed is None:
        from dronecats.flight.sitl import compile_ahead

        say(f"lockstep: loading the flight core and the camera{compile_ahead.duration()} …")
        from dronecats.flight.stages.lockstep import LockstepStage

        world = world_of(record, simulated.airframe)
        stage: TruthfulStage
        stage = lockstep = LockstepStage(flight, simulated, folder, world)
        recall = lockstep.camera.at
    else:
        from dronecats.flight.stages.realtime import RealtimeStage

        world = World(record)
        stage = realtime = RealtimeStage(flight, simulated, folder, say)
        pace, recall = realtime.pace, realtime.camera.at
    try:
        standing_m = airframes.load(simulated.airframe).standing_m
        starts = [start_of(s, world.ground_down(*s.position_ned[:2]), standing_m) for s in record.starts]
        # a PX4 only: our own autopilot is calibrated to its start
        checked = TrueStart(stage, world) if simulated.autopilot == "px4" else nullcontext()
        with checked as true_start, opened_in(world, flight, stage, folder) as pilot:
            return fly(
                stage, starts, pilot.agent(flight), folder,
                seed=flight.seed, full=spec.full, cap_s=spec.seconds,
                pictures=_pictures(spec.disturbances.frame, recall),
                check=pilot.check, say=say, true_start=true_start,
                on_step=StepLines(say, len(starts), pilot.spent, spec.stop_unreadable),
            )  # fmt: skip
    finally:
        try:
            if pace is not None:
                with suppress(DronecatsError):  # a simulator that has died has said so already
                    found["pace"] = pace()
        finally:
            stage.close()


def _pictures(faults: FrameFaults, recall: Callable[[int, int], Frame]) -> PicturePath | None:
    """Return what is done to a flight's pictures on purpose, None where that is nothing."""
    return None if faults == FrameFaults() else PicturePath(**asdict(faults), recall=recall)


def draw(folder: Path) -> None:
    """Draw flight.png of an episode folder; a picture that fails must not cost the flight."""
    from dronecats.flight.picture.flight_picture import draw as draw_flight
    from dronecats.flight.picture.map_picture import aerial
    from dronecats.flight.sitl.scenario import load_world

    try:
        picture, extent = aerial(load_world(str(folder / layout.EPISODE)), folder)
        draw_flight(folder, picture, extent)
    except (DronecatsError, OSError, ValueError) as error:
        (folder / "flight.png.error").write_text(f"{error}\n", encoding="utf-8")
