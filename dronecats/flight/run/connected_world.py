"""A vehicle that simulates itself flies one of our episodes, and is judged, or on one of our maps."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.flight.picture.intent import draw as draw_intent
from dronecats.flight.run.ascent import start_of
from dronecats.flight.run.connected import open_link, told_by
from dronecats.flight.run.episode import Flown, fly
from dronecats.flight.run.first_question import asked_folder
from dronecats.flight.run.onboard_log import fetch_onboard_log
from dronecats.flight.run.oracle import opened_in
from dronecats.flight.run.outcome import Say, fly_and_judge, served_rate_hz
from dronecats.flight.run.settings import settings
from dronecats.flight.run.simulated import draw
from dronecats.flight.run.step_lines import StepLines
from dronecats.flight.run.true_start import TrueStart
from dronecats.flight.sitl.truth_bridge import TruthSource
from dronecats.flight.spec.flight import CAMERA, look_up
from dronecats.flight.spec.flight_spec import Connected, FlightSpec
from dronecats.flight.stages.world import WorldStage
from dronecats.pilots import roster
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import wrap_pi
from foundation.run_folder import folder as folders
from foundation.run_folder import layout
from hil.link.envelope import Limits


def fly_world(spec: FlightSpec, vehicle: Connected, truth: str, out: Path | None, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`. `truth`: URL of the vehicle's true poses.

    Everything that can be refused is refused before the run folder is made: UsageError.
    """
    flight, dry = look_up(spec), vehicle.authority.dry
    record = flight.record
    if record is None:
        raise UsageError("a vehicle that simulates itself wants a world: name an episode or a map with --world")
    if spec.map is not None and roster.knows(spec.pilot):
        raise UsageError(f"the pilot {spec.pilot} knows an episode's target, and a map has none; choose --pilot vision")
    judged = spec.map is None and not dry  # what was only meant to be flown succeeds nowhere
    world = World(record)
    if len(record.starts) > 1:
        raise UsageError(f"{record.id} is flown by {len(record.starts)} drones, and --truth tells of one")
    source = TruthSource(truth)  # asked once before anything is made; the flight's own process listens then
    try:
        source.first()
    finally:
        source.close()
    link = open_link(vehicle, spec.envelope)
    found = settings(flight, CAMERA)
    with asked_folder(spec, out, record.id, found, say) as folder:
        drawn = folder / (layout.EPISODE if judged else layout.WORLD)
        drawn.write_text(record.to_json(), encoding="utf-8")
        if not judged:
            folders.write_json(folder / layout.EPISODE, {"id": record.id, "instruction": record.instruction})
        say(f'episode {record.id}: "{record.instruction}", pilot {spec.pilot_name}, on a vehicle that simulates itself')

        def fly_it() -> Flown:
            frame_s = (spec.envelope or Limits()).frame_s
            stage = WorldStage(link, drawn, truth, folder, say, frame_s=frame_s, judged=judged)
            try:
                ground = world.ground_down(*record.starts[0].position_ned[:2])
                start = start_of(record.starts[0], ground)
                # the heading that the vehicle has where it flies, before it is turned onto the map
                start = replace(start, yaw=wrap_pi(math.radians(record.starts[0].yaw_deg) - stage.placement.turn))
                with (
                    TrueStart(stage, world, stage.placement) as true_start,
                    opened_in(world, flight, stage, folder) as pilot,
                ):
                    return fly(
                        stage, [start], pilot.agent(flight), folder,
                        seed=flight.seed, cap_s=spec.seconds, authority=vehicle.authority,
                        check=pilot.check, say=say,
                        on_step=StepLines(say, spent=pilot.spent, stop_unreadable=spec.stop_unreadable),
                        true_start=true_start if judged else None,
                    )  # fmt: skip
            finally:
                stage.close()

        def afterwards(flown: Flown) -> None:
            folders.write_run(folder.parent, {**found, **told_by(link), "served_rate_hz": served_rate_hz(folder)})
            if spec.keep_ulog:
                fetch_onboard_log(vehicle.url, link, folder, say)
            if flown.steps and judged:
                draw(folder)
            if dry:
                say(f"drew {draw_intent(folder, CameraModel())} decisions into {folder / layout.INTENT}")

        return fly_and_judge(fly_it, folder, record.id, spec.pilot_name, afterwards)
