"""`fly --connect`: the same episode code on a vehicle that we did not start. Without truth there is no verdict."""

import argparse
import math
from typing import Any

from dronecats.agent.chat import ChatModel
from dronecats.agent.loop import CAP_S, Pilot
from dronecats.agent.prompt import Prompt
from dronecats.agent.providers import split
from dronecats.border.errors import CameraError, UsageError
from dronecats.border.redaction import redacted
from dronecats.pilots import roster
from dronecats.run import folder as folders
from dronecats.run.conclude import Say, conclude, progress, served_rate_hz
from dronecats.run.connected_stage import ConnectedStage
from dronecats.run.episode import Start, fly
from dronecats.run.plan import CAMERA, SAMPLING, latency_for
from hil.cameras.snapshot import HttpCamera
from hil.transport import connect

EPISODE = "connected"
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
    policy = latency_for(args.latency, 1.0)
    prompt = Prompt.load(args.prompt)
    if args.model:
        model = ChatModel(*split(args.model), args.base_url)
        model.check()
        model.close()
    probe(args.camera)
    transport = connect(args.connect)
    configuration = {
        "pilot": pilot_name,
        "model": args.model,
        "base_url": redacted(args.base_url) if args.base_url else None,
        "prompt_sha256": prompt.digest,
        "sampling": SAMPLING,
        "clock": "the vehicle's",
        "latency": policy.name,
        "connect": args.connect,
        "camera": {**CAMERA, "url": redacted(args.camera)},
    }
    folder = folders.create(args.out, pilot_name or args.model, EPISODE, configuration)
    folders.write_json(folder / "episode.json", {"id": EPISODE, "instruction": args.instruction})

    def flight() -> Any:
        stage = ConnectedStage(transport, args.camera, pilot_name, args.model, args.base_url, folder)
        try:
            return fly(
                stage,
                [Start((0.0, 0.0, -HEIGHT_M), None)],
                Pilot(stage.model, prompt, args.instruction, policy),
                folder,
                cap_s=seconds,
                on_step=progress(say),
                say=say,
            )
        finally:
            stage.close()

    def afterwards(flown: Any) -> None:
        folders.write_run(folder.parent, {**configuration, "served_rate_hz": served_rate_hz(folder)})

    return conclude(flight, folder, EPISODE, pilot_name or args.model, afterwards)


def probe(url: str) -> None:
    """Raise UsageError when the camera gives no frame: no picture, no flight, and said before anything moves."""
    camera = HttpCamera(url, lambda: 0)
    try:
        camera.newest()
    except CameraError as error:
        raise UsageError(str(error)) from None
    finally:
        camera.close()
