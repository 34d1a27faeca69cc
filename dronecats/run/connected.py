"""`fly --connect`: the same episode code on a vehicle that we did not start. Without truth there is no verdict."""

import argparse
from typing import Any

from dronecats.agent.loop import Pilot
from dronecats.agent.prompt import Prompt
from dronecats.border.errors import UsageError
from dronecats.judge.episode import write_verdict
from dronecats.pilots import roster
from dronecats.run import folder as folders
from dronecats.run.connected_stage import ConnectedStage
from dronecats.run.episode import Start, fly
from dronecats.run.plan import latency_for
from dronecats.run.simulated import Say, progress, result_of

EPISODE = "connected"
HEIGHT_M = 2.5  # where the episode begins: straight above the place of take-off, PX4's MIS_TAKEOFF_ALT


def fly_connected(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`. Raises UsageError, LinkError, CameraError."""
    if args.pilot == "oracle":
        raise UsageError("the oracle needs the truth, which only --sitl knows; choose --pilot vision or a --model")
    pilot_name = None if args.model else roster.check(args.pilot or "vision")
    policy = latency_for(args.latency, 1.0)
    prompt = Prompt.load(args.prompt)
    folder = folders.create(args.out, pilot_name or args.model, EPISODE)
    folders.write_json(folder / "episode.json", {"id": EPISODE, "instruction": args.instruction})
    folders.write_run(
        folder.parent,
        {
            "pilot": pilot_name,
            "model": args.model,
            "base_url": args.base_url,
            "prompt_sha256": prompt.digest,
            "clock": "the vehicle's",
            "latency": policy.name,
            "connect": args.connect,
            "camera": args.camera,
        },
    )
    stage = ConnectedStage(args.connect, args.camera, pilot_name, args.model, args.base_url, folder)
    try:
        pilot = Pilot(stage.model, prompt, args.instruction, policy)
        flown = fly(
            stage,
            [Start((0.0, 0.0, -HEIGHT_M), None)],
            pilot,
            folder,
            cap_s=args.seconds,
            on_step=progress(say),
            say=say,
        )
    finally:
        stage.close()
    return result_of(EPISODE, pilot_name or args.model, folder, flown, write_verdict(folder))
