"""`fly --sitl`: from the command line's words to a judged run folder."""

import argparse
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronecats.agent.action import action_from
from dronecats.agent.chat import ChatModel
from dronecats.agent.decisions import Decision
from dronecats.agent.history import compact
from dronecats.agent.loop import Pilot
from dronecats.agent.prompt import Prompt
from dronecats.agent.providers import split
from dronecats.border.camera import CameraModel
from dronecats.border.errors import DronecatsError, UsageError
from dronecats.judge.episode import write_verdict
from dronecats.judge.files import lines
from dronecats.pilots import roster
from dronecats.run import folder as folders
from dronecats.run.episode import Flown, fly, start_of
from dronecats.run.plan import Plan, latency_for, speed
from dronecats.run.stage import Stage
from episodes import catalogue
from vehicles import airframe as airframes

DEFAULT_EPISODE = "residential-approaching-01"
Say = Callable[[str], None]


def fly_simulated(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with the exit `status` and the `reason` the flight ended. Raises UsageError."""
    plan = resolve(args)
    prompt = Prompt.load(plan.prompt_file)
    if plan.model:  # refuse what cannot fly before anything is started
        model = ChatModel(*split(plan.model), plan.base_url)
        model.check()
        model.close()
    folder = folders.create(args.out, plan.pilot_name, plan.record.id)
    (folder / "episode.json").write_text(plan.record.to_json(), encoding="utf-8")
    folders.write_run(folder.parent, configuration(plan, prompt))
    say(f'episode {plan.record.id}: "{plan.record.instruction}", pilot {plan.pilot_name}{_disclaimer(plan)}')
    flown = _fly(plan, prompt, folder, say)
    verdict = write_verdict(folder)
    folders.write_run(folder.parent, {**configuration(plan, prompt), "served_rate_hz": served_rate_hz(folder)})
    draw(plan, folder)
    return result_of(plan.record.id, plan.pilot_name, folder, flown, verdict)


def resolve(args: argparse.Namespace) -> Plan:
    """Return the plan that the command line asks for. Raises UsageError."""
    factor = speed(args.speed)
    episode = args.episode or DEFAULT_EPISODE
    airframes.load(args.airframe)
    if args.base_url and not args.model:
        raise UsageError("--base-url goes with --model PROVIDER/NAME, for example --model local/my-model")
    return Plan(
        episode=episode,
        record=catalogue.load(episode),
        pilot=None if args.model else roster.check(args.pilot or "vision"),
        model=args.model,
        base_url=args.base_url,
        speed=factor,
        latency=latency_for(args.latency, factor),
        seed=args.seed,
        airframe=args.airframe,
        prompt_file=args.prompt,
        full=args.full,
    )


def configuration(plan: Plan, prompt: Prompt) -> dict[str, Any]:
    """Return what run.json holds."""
    return {
        "pilot": plan.pilot,
        "model": plan.model,
        "base_url": plan.base_url,
        "prompt_sha256": prompt.digest,
        "sampling": {"temperature": 0.4, "max_tokens": 8192},
        "seed": plan.seed,
        "clock": "lockstep" if plan.speed is None else "real time",
        "speed": plan.speed,
        "latency": plan.latency.name,
        "airframe": plan.airframe,
        "camera": {"width": CameraModel().width, "height": CameraModel().height, "hfov_deg": CameraModel().hfov_deg},
    }


def _fly(plan: Plan, prompt: Prompt, folder: Path, say: Say) -> Flown:
    if plan.speed is None:
        say("lockstep: loading the flight core and the camera (compiled on the first run, about a minute) …")
        from dronecats.run.lockstep_stage import LockstepStage

        stage: Stage = LockstepStage(plan, folder)
    else:
        from dronecats.run.realtime_stage import RealtimeStage

        stage = RealtimeStage(plan, folder, say)
    from dronecats.sitl.scenario import load_world

    world = load_world(plan.episode)
    starts = [start_of(start, world.ground_down(*start.position_ned[:2])) for start in plan.record.starts]
    pilot = Pilot(stage.model, prompt, plan.record.instruction, plan.latency)
    try:
        return fly(stage, starts, pilot, folder, full=plan.full, on_step=progress(say), say=say)
    finally:
        stage.close()


def progress(say: Say) -> Callable[[Decision], None]:
    """Return the function that prints one line per step and drone."""

    def line(decision: Decision) -> None:
        what = compact(action_from(decision.action), CameraModel()) if decision.action else f"! {decision.error}"
        drone = f" drone {decision.drone}" if decision.drone else ""
        say(f"{decision.step:4d}  t={decision.t_decided:6.1f} s{drone}  {what:34} ({decision.latency_s:.2f} s)")

    return line


def served_rate_hz(folder: Path) -> float | None:
    """Return the decisions per second of vehicle time that the pilot was really served with, the median."""
    rates = [d["rate_hz"] for d in lines(folder / "decisions.jsonl") if d.get("rate_hz")]
    return statistics.median(rates) if rates else None


def draw(plan: Plan, folder: Path) -> None:
    """Draw flight.png; a picture that fails must not cost the flight."""
    from dronecats.report.flight_picture import draw as draw_flight
    from dronecats.report.map_picture import aerial
    from dronecats.sitl.scenario import load_world

    try:
        picture, extent = aerial(load_world(plan.episode), folder)
        draw_flight(folder, picture, extent)
    except (DronecatsError, OSError, ValueError) as error:
        (folder / "flight.png.error").write_text(f"{error}\n", encoding="utf-8")


def result_of(
    episode: str, pilot_name: str, folder: Path, flown: Flown, verdict: dict[str, Any]
) -> dict[str, Any]:
    """Return the JSON object of `fly`."""
    status = {"cap": 0, "decided": 0, "interrupted": 130}.get(flown.reason, 3)
    error = str(flown.error) if flown.error else verdict["error"] if flown.reason != "interrupted" else None
    if status == 0 and verdict["outcome"] == "error":
        status = 3
    return {
        "episode": episode,
        "pilot": pilot_name,
        "outcome": verdict["outcome"],
        "success": verdict["success"],
        "ne_m": verdict["ne_m"],
        "steps": flown.steps,
        "declarations": verdict["declarations"],
        "sim_seconds": round(flown.sim_seconds, 3),
        "wall_seconds": round(flown.wall_seconds, 3),
        "real_time_factor": round(flown.sim_seconds / flown.wall_seconds, 3) if flown.wall_seconds else 0.0,
        "run_dir": str(folder),
        "error": error,
        "reason": flown.reason,
        "status": status,
    }


def _disclaimer(plan: Plan) -> str:
    return " (built in, not a model)" if plan.pilot else ""
