"""`fly --sitl`: from the command line's words to a judged run folder."""

import argparse
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.agent.loop import Pilot
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import split
from dronecats.agent.prompt import Prompt
from dronecats.run.ascent import start_of
from dronecats.run.episode import Flown, fly
from dronecats.run.outcome import Say, conclude, progress, served_rate_hz
from dronecats.run.plan import SAMPLING, Plan, resolve
from dronecats.rundir import folder as folders
from dronecats.stages.stage import Stage
from episodes import maps
from foundation.errors import DronecatsError, InfrastructureError
from foundation.redaction import redacted_url
from vehicles import airframe as airframes


def fly_simulated(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with the exit `status` and the `reason` the flight ended. Raises UsageError."""
    plan = resolve(
        episode=args.episode,
        pilot=args.pilot,
        model=args.model,
        base_url=args.base_url,
        factor=args.speed,
        latency=args.latency,
        seed=args.seed,
        airframe=args.airframe,
        prompt_file=args.prompt,
        full=args.full,
        optics_file=args.optics,
        envelope_file=args.envelope,
        unlimited=args.no_envelope,
        autopilot=args.autopilot,
        px4=args.px4,
    )
    prompt = Prompt.load(plan.prompt_file)
    check_model(plan)
    settings = configuration(plan, prompt)
    folder = folders.create(args.out, plan.pilot_name, plan.record.id, settings)
    disclaimer = " (built in, not a model)" if plan.pilot else ""
    say(f'episode {plan.record.id}: "{plan.record.instruction}", pilot {plan.pilot_name}{disclaimer}')

    def afterwards(flown: Flown) -> None:
        folders.write_run(folder.parent, {**settings, "served_rate_hz": served_rate_hz(folder)})
        if flown.steps:
            draw(plan.episode, folder)

    return fly_plan(plan, prompt, folder, say, settings, afterwards)


def check_model(plan: Plan) -> None:
    """Raise UsageError for a model that cannot fly, before anything is started."""
    if plan.model:
        model = ChatModel(*split(plan.model), plan.base_url)
        model.check()
        model.close()


def fly_plan(
    plan: Plan,
    prompt: Prompt,
    folder: Path,
    say: Say,
    settings: dict[str, Any],
    afterwards: Callable[[Flown], None] = lambda flown: None,
) -> dict[str, Any]:
    """Fly a plan in an episode folder that stands, judge it, and return what `fly --json` prints."""
    try:
        (folder / "episode.json").write_text(plan.record.to_json(), encoding="utf-8")
    except OSError as full:
        raise InfrastructureError(f"{folder} cannot be written: {full.strerror}") from None
    return conclude(
        lambda: _fly(plan, prompt, folder, say, settings), folder, plan.record.id, plan.pilot_name, afterwards
    )


def configuration(plan: Plan, prompt: Prompt) -> dict[str, Any]:
    """Return what run.json holds."""
    of_map = maps.digest(plan.record.map)
    return {
        **({"map_sha256": of_map} if of_map else {}),
        "pilot": plan.pilot,
        "model": plan.model,
        "base_url": redacted_url(plan.base_url) if plan.base_url else None,
        "prompt_sha256": prompt.digest,
        "sampling": SAMPLING,
        "seed": plan.seed,
        "clock": _clock(plan),
        "speed": plan.speed,
        "latency": plan.latency.name,
        "airframe": plan.airframe,
        "autopilot": plan.autopilot,
        "camera": plan.camera,
        "envelope": asdict(plan.limits) if plan.limits else None,
    }


def _fly(plan: Plan, prompt: Prompt, folder: Path, say: Say, settings: dict[str, Any]) -> Flown:
    """Fly, and add to `settings` how well a flight in real time held it."""
    from dronecats.sitl.scenario import world_of
    from episodes.world import World

    pace: Callable[[], dict[str, float]] | None = None
    world: World | None = None
    if plan.speed is None:
        say("lockstep: loading the flight core and the camera; the first run compiles them, about a minute …")
        from dronecats.stages.lockstep import LockstepStage

        world = world_of(plan.record, plan.airframe)
        stage: Stage = LockstepStage(plan, folder, world)
    else:
        from dronecats.stages.realtime import RealtimeStage

        stage = realtime = RealtimeStage(plan, folder, say)
        pace = realtime.pace
    try:
        world = world or World(plan.record)
        standing_m = airframes.load(plan.airframe).standing_m
        starts = [start_of(s, world.ground_down(*s.position_ned[:2]), standing_m) for s in plan.record.starts]
        pilot = Pilot(stage.model, prompt, plan.record.instruction, plan.latency)
        return fly(stage, starts, pilot, folder, full=plan.full, on_step=progress(say), say=say)
    finally:
        try:
            if pace is not None:
                with suppress(DronecatsError):  # a simulator that has died has said so already
                    settings["pace"] = pace()
        finally:
            stage.close()


def draw(episode: str, folder: Path) -> None:
    """Draw flight.png; a picture that fails must not cost the flight."""
    from dronecats.report.flight_picture import draw as draw_flight
    from dronecats.report.map_picture import aerial
    from dronecats.sitl.scenario import load_world

    try:
        picture, extent = aerial(load_world(episode), folder)
        draw_flight(folder, picture, extent)
    except (DronecatsError, OSError, ValueError) as error:
        (folder / "flight.png.error").write_text(f"{error}\n", encoding="utf-8")


def _clock(plan: Plan) -> str:
    if plan.speed is not None:
        return "real time"
    return "lockstep but for PX4's telemetry" if plan.autopilot == "px4" else "lockstep"
