"""`fly --connect`: the same episode code on a vehicle that we did not start. Without truth there is no verdict."""

import argparse
from typing import Any

from dronecats.agent.loop import Pilot
from dronecats.report.intent import draw as draw_intent
from dronecats.run.ascent import Start
from dronecats.run.episode import fly
from dronecats.run.outcome import Say, conclude, progress, served_rate_hz
from dronecats.run.terms import FRAMES_S, SILENCE_S, terms
from dronecats.rundir import folder as folders
from dronecats.stages.connected import ConnectedStage
from foundation.errors import CameraError, UsageError
from hil.cameras.address import shown
from hil.cameras.calibration import Calibration
from hil.cameras.calibration import load as load_calibration
from hil.cameras.open import open_camera
from hil.cameras.patient import PatientCamera
from hil.link.link import Link
from hil.link.reopening import Reopening
from hil.link.transport import connect

EPISODE = "connected"
HEIGHT_M = 2.5  # where the episode begins: straight above the place of take-off, PX4's MIS_TAKEOFF_ALT


def fly_connected(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`.

    Everything that can be refused is refused before the run folder is made: UsageError.
    """
    if args.pilot == "oracle":
        raise UsageError(
            "the oracle needs the truth, which --sitl knows, or --world with --truth; choose --pilot vision or --model"
        )
    agreed = terms(args)
    calibration = load_calibration(args.calibration) if args.calibration else None
    link = Link(Reopening(lambda: connect(args.connect)), silence_s=SILENCE_S, limits=agreed.limits, mute=args.dry_run)
    camera = _camera(args.camera, link, calibration, agreed.limits.frame_s, say)
    configuration = agreed.configuration(
        args.connect,
        {
            "width": camera.model.width,
            "height": camera.model.height,
            "hfov_deg": round(camera.model.hfov_deg, 3),
            "url": shown(args.camera),
        },
    )
    folder = folders.create(args.out, agreed.pilot_name, EPISODE, configuration)
    folders.write_json(folder / "episode.json", {"id": EPISODE, "instruction": args.instruction})

    def flight() -> Any:
        stage = ConnectedStage(link, camera, agreed.pilot, agreed.model, agreed.base_url, folder)
        try:
            return fly(
                stage,
                [Start((0.0, 0.0, -HEIGHT_M), None)],
                Pilot(
                    stage.model,
                    agreed.prompt,
                    args.instruction,
                    agreed.latency,
                    patience_s=agreed.patience_s,
                    last_reply=False,  # nothing is scored here, so nothing is worth staying up for
                ),
                folder,
                cap_s=agreed.seconds,
                authority=agreed.authority,
                on_step=progress(say, camera.model),
                say=say,
            )
        finally:
            stage.close()

    def afterwards(flown: Any) -> None:
        firmware = str(link.firmware) if link.firmware else None
        folders.write_run(
            folder.parent, {**configuration, "firmware": firmware, "served_rate_hz": served_rate_hz(folder)}
        )
        if args.dry_run:
            say(f"drew {draw_intent(folder, camera.model)} decisions into {folder / 'intent'}")

    return conclude(flight, folder, EPISODE, agreed.pilot_name, afterwards)


def _camera(url: str, link: Link, calibration: Calibration | None, max_age_s: float, say: Say) -> PatientCamera:
    """Return the camera, from which a frame has come: no picture, no flight, said before anything moves. UsageError."""
    try:
        camera = open_camera(url, lambda: link.time_us, calibration, max_age_s=max_age_s)
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
