"""`fly --connect … --world … --truth …`: a vehicle that simulates itself flies one of our episodes, and is judged."""

import argparse
from typing import Any

from dronecats.agent.loop import Pilot
from dronecats.report.intent import draw as draw_intent
from dronecats.run.ascent import Start, start_of
from dronecats.run.episode import Flown, fly
from dronecats.run.free_flight import free_flight
from dronecats.run.outcome import Say, conclude, progress, served_rate_hz
from dronecats.run.plan import CAMERA
from dronecats.run.simulated import draw
from dronecats.run.terms import SILENCE_S, terms
from dronecats.rundir import folder as folders
from dronecats.sitl.truth_bridge import TruthSource
from dronecats.stages.world import WorldStage
from episodes import catalogue, maps
from episodes.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from hil.link.link import Link
from hil.link.reopening import Reopening
from hil.link.transport import connect


def fly_world(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with `status` and `reason`.

    Everything that can be refused is refused before the run folder is made: UsageError.
    """
    agreed = terms(args)
    of_episode = args.world not in maps.names()
    judged = of_episode and not args.dry_run  # what was only meant to be flown succeeds nowhere
    if of_episode:
        if args.instruction:
            raise UsageError("an episode brings its instruction: leave --instruction out, or name a map with --world")
        record = catalogue.load(args.world)
    else:
        if not args.instruction:
            raise UsageError(f"'{args.world}' is a map: say with --instruction what to do there, or name an episode")
        if agreed.pilot == "oracle":
            raise UsageError("the oracle flies to an episode's target, and a map has none; choose --pilot vision")
        record = free_flight(args.world, args.instruction)
    world = World(record)
    if len(record.starts) > 1:
        raise UsageError(f"{record.id} is flown by {len(record.starts)} drones, and --truth tells of one")
    source = TruthSource(args.truth)  # asked once before anything is made; the flight's own process listens then
    try:
        source.first()
    finally:
        source.close()
    link = Link(Reopening(lambda: connect(args.connect)), silence_s=SILENCE_S, limits=agreed.limits, mute=args.dry_run)
    of_map = maps.digest(record.map)
    configuration = {
        **({"map_sha256": of_map} if of_map else {}),
        **agreed.configuration(args.connect, CAMERA),
        "truth": args.truth,
    }
    folder = folders.create(args.out, agreed.pilot_name, record.id, configuration)
    episode = folder / ("episode.json" if judged else "world.json")
    episode.write_text(record.to_json(), encoding="utf-8")
    if not judged:
        folders.write_json(folder / "episode.json", {"id": record.id, "instruction": record.instruction})
    say(f'episode {record.id}: "{record.instruction}", pilot {agreed.pilot_name}, on a vehicle that simulates itself')

    def flight() -> Flown:
        stage = WorldStage(link, str(episode), world, args.truth, agreed, folder, say, judged=judged)
        try:
            ground = world.ground_down(*record.starts[0].position_ned[:2])
            start = Start(start_of(record.starts[0], ground).offset_ned, stage.yaw)
            pilot = Pilot(stage.model, agreed.prompt, record.instruction, agreed.latency, patience_s=agreed.patience_s)
            return fly(
                stage, [start], pilot, folder,
                cap_s=agreed.seconds, authority=agreed.authority, on_step=progress(say), say=say,
            )  # fmt: skip
        finally:
            stage.close()

    def afterwards(flown: Flown) -> None:
        firmware = str(link.firmware) if link.firmware else None
        found = {**configuration, "firmware": firmware, "served_rate_hz": served_rate_hz(folder)}
        folders.write_run(folder.parent, found)
        if flown.steps and judged:
            draw(str(episode), folder)
        if args.dry_run:
            say(f"drew {draw_intent(folder, CameraModel())} decisions into {folder / 'intent'}")

    return conclude(flight, folder, record.id, agreed.pilot_name, afterwards)
