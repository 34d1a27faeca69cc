"""A flight of a vehicle that we did not start: the same episode code. Without truth there is no verdict."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.flight.picture.intent import draw as draw_intent
from dronecats.flight.run.ascent import StartOffset
from dronecats.flight.run.episode import Flown, fly
from dronecats.flight.run.first_question import asked_folder
from dronecats.flight.run.instruments import UNWATCHED, Instruments
from dronecats.flight.run.onboard_log import fetch_onboard_log
from dronecats.flight.run.outcome import Say, fly_and_judge, served_rate_hz
from dronecats.flight.run.pilot import opened
from dronecats.flight.run.settings import settings
from dronecats.flight.run.step_lines import StepLines
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Connected, FlightSpec
from dronecats.flight.stages.connected import ConnectedStage
from dronecats.pilots import roster
from foundation.errors import CameraError, UsageError
from foundation.run_folder import folder as folders
from foundation.run_folder import layout
from foundation.signing import load_key
from hil.cameras.address import shown
from hil.cameras.open import open_camera
from hil.cameras.patient import FRAMES_S, PatientCamera
from hil.link.envelope import Limits
from hil.link.link import Link
from hil.link.reopening import Reopening
from hil.link.transport import connect

EPISODE = "connected"
HEIGHT_M = 2.5  # where the episode begins: straight above the place of take-off, PX4's MIS_TAKEOFF_ALT
# wall seconds for which a vehicle may be silent or a cable out. It has left Offboard by its own failsafe long before
SILENCE_S = 6.0


def fly_connected(
    spec: FlightSpec, vehicle: Connected, out: Path | None, say: Say, instruments: Instruments = UNWATCHED
) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`. `instruments` look on.

    Everything that can be refused is refused before the run folder is made: UsageError.
    """
    if roster.knows(spec.pilot):
        raise UsageError(
            f"the pilot {spec.pilot} needs the truth, which --sitl knows, or --world with --truth;"
            " choose --pilot vision or --model"
        )
    flight = look_up(spec)
    link = open_link(vehicle, spec.envelope)
    camera = _camera(vehicle, link, say)
    dry = vehicle.authority.dry
    found = settings(
        flight,
        {
            "width": camera.model.width,
            "height": camera.model.height,
            "hfov_deg": round(camera.model.hfov_deg, 3),
            "url": shown(vehicle.camera or ""),
        },
    )
    with asked_folder(spec, out, EPISODE, found, say) as folder:
        folders.write_json(folder / layout.EPISODE, {"id": EPISODE, "instruction": flight.instruction})

        def fly_it() -> Flown:
            stage = ConnectedStage(link, camera, folder)
            try:
                instruments.watch(link, camera, folder.parent)
                with opened(flight, stage, folder) as opened_pilot:
                    pilot = replace(opened_pilot, model=instruments.model(opened_pilot.model))
                    make_agent = instruments.agent(pilot.agent(flight))
                    return fly(
                        stage, [StartOffset((0.0, 0.0, -HEIGHT_M), None)], make_agent, folder,
                        seed=flight.seed, cap_s=spec.seconds, authority=vehicle.authority,
                        check=pilot.check, say=say,
                        on_step=StepLines(say, spent=pilot.spent, stop_unreadable=spec.stop_unreadable),
                    )  # fmt: skip
            finally:
                stage.close()

        def afterwards(flown: Flown) -> None:
            folders.write_run(folder.parent, {**found, **told_by(link), "served_rate_hz": served_rate_hz(folder)})
            if spec.keep_ulog:
                fetch_onboard_log(vehicle.url, link, folder, say)
            if dry:
                say(f"drew {draw_intent(folder, camera.model)} decisions into {folder / layout.INTENT}")

        return fly_and_judge(fly_it, folder, EPISODE, spec.pilot_name, afterwards)


def open_link(vehicle: Connected, limits: Limits | None) -> Link:
    """Return the link to somebody else's vehicle, whose cable may come and go. Raises UsageError, LinkError."""
    key = load_key(Path(vehicle.sign)) if vehicle.sign else b""
    wire = Reopening(lambda: connect(vehicle.url))
    return Link(wire, silence_s=SILENCE_S, key=key, limits=limits, mute=vehicle.authority.dry)


def told_by(link: Link) -> dict[str, Any]:
    """Return what run.json says of the autopilot."""
    return {"firmware": str(link.firmware) if link.firmware else None}


def _camera(vehicle: Connected, link: Link, say: Say) -> PatientCamera:
    """Return the camera, from which a frame has come: no picture, no flight, said before anything moves. UsageError."""
    max_age_s = link.limits.frame_s if link.limits else Limits().frame_s
    try:
        camera = open_camera(vehicle.camera or "", lambda: link.time_us, vehicle.calibration, max_age_s=max_age_s)
    except CameraError as error:
        link.close()
        raise UsageError(str(error)) from None
    try:
        camera.newest()
    except CameraError as error:
        camera.close()
        link.close()
        raise UsageError(str(error)) from None
    return PatientCamera(camera, FRAMES_S, lambda fault: say(f"      holding: {fault}"))
