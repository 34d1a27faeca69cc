"""`fly --connect`: the same episode code on a vehicle that we did not start. Without truth there is no verdict."""

import argparse
import math
from dataclasses import asdict
from typing import Any

from dronecats.agent.chat import ChatModel
from dronecats.agent.loop import CAP_S, Pilot
from dronecats.agent.prompt import Prompt
from dronecats.agent.providers import split
from dronecats.border.errors import CameraError, UsageError
from dronecats.border.redaction import redacted
from dronecats.pilots import roster
from dronecats.report.intent import draw as draw_intent
from dronecats.run import folder as folders
from dronecats.run.conclude import Say, conclude, progress, served_rate_hz
from dronecats.run.connected_stage import ConnectedStage
from dronecats.run.episode import Authority, Start, fly
from dronecats.run.plan import SAMPLING, latency_for
from hil.cameras.calibration import Calibration
from hil.cameras.calibration import load as load_calibration
from hil.cameras.open import open_camera
from hil.cameras.patient import PatientCamera
from hil.envelope import Limits
from hil.envelope_file import load as load_envelope
from hil.link import Link
from hil.reopening import Reopening
from hil.transport import connect

EPISODE = "connected"
SILENCE_S = 30.0  # wall seconds that a cable may be out; what the vehicle does meanwhile is its own failsafe's matter
FRAMES_S = 10.0  # wall seconds without a fresh frame after which the flight ends
PATIENCE_S = 60.0  # s without a reply of the model after which the vehicle is brought to an end of its flight
HEIGHT_M = 2.5  # where the episode begins: straight above the place of take-off, PX4's MIS_TAKEOFF_ALT


def fly_connected(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`.

    Everything that can be refused is refused before the run folder is made: UsageError.
    """
    if args.pilot == "oracle":
        raise UsageError("the oracle needs the truth, which only --sitl knows; choose --pilot vision or a --model")
    pilot_name = None if args.model else roster.check(args.pilot or "vision")
    seconds = CAP_S if args.seconds is None else args.seconds
    if not (math.isfinite(seconds) and 0.0 < seconds <= CAP_S):
        raise UsageError(f"--seconds wants more than 0 and at most {CAP_S:g}, got {seconds:g}")
    if not 1.0 <= (args.patience or PATIENCE_S) <= CAP_S:
        raise UsageError(f"--patience wants 1 to {CAP_S:g} seconds, got {args.patience:g}")
    authority = Authority(arm=args.arm, then=args.then or ("land" if args.arm else "hold"), dry=args.dry_run)
    limits = load_envelope(args.envelope, Limits()) if args.envelope else Limits()
    calibration = load_calibration(args.calibration) if args.calibration else None
    policy = latency_for(args.latency, 1.0)
    prompt = Prompt.load(args.prompt)
    if args.model:
        model = ChatModel(*split(args.model), args.base_url)
        model.check()
        model.close()
    link = Link(Reopening(lambda: connect(args.connect)), silence_s=SILENCE_S, limits=limits, mute=args.dry_run)
    camera = _camera(args.camera, link, calibration, limits.frame_s, say)
    configuration = {
        "pilot": pilot_name,
        "model": args.model,
        "base_url": redacted(args.base_url) if args.base_url else None,
        "prompt_sha256": prompt.digest,
        "sampling": SAMPLING,
        "clock": "the vehicle's",
        "latency": policy.name,
        "connect": args.connect,
        "camera": {
            "width": camera.model.width,
            "height": camera.model.height,
            "hfov_deg": round(camera.model.hfov_deg, 3),
            "url": redacted(args.camera),
        },
        "envelope": asdict(limits),
        "authority": asdict(authority),
    }
    folder = folders.create(args.out, pilot_name or args.model, EPISODE, configuration)
    folders.write_json(folder / "episode.json", {"id": EPISODE, "instruction": args.instruction})

    def flight() -> Any:
        stage = ConnectedStage(link, camera, pilot_name, args.model, args.base_url, folder)
        try:
            return fly(
                stage,
                [Start((0.0, 0.0, -HEIGHT_M), None)],
                Pilot(stage.model, prompt, args.instruction, policy, patience_s=args.patience or PATIENCE_S),
                folder,
                cap_s=seconds,
                authority=authority,
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

    return conclude(flight, folder, EPISODE, pilot_name or args.model, afterwards)


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
