"""`fly --sitl`: from the command line's words to a judged run folder."""

import argparse
import signal
import statistics
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
from dronecats.border.redaction import redacted
from dronecats.judge.episode import write_verdict
from dronecats.judge.files import lines
from dronecats.pilots import roster
from dronecats.run import folder as folders
from dronecats.run.episode import Flown, fly, start_of, unexpected
from dronecats.run.plan import CAMERA, SAMPLING, Plan, latency_for, speed
from dronecats.run.stage import Stage
from episodes import catalogue
from vehicles import airframe as airframes

Say = Callable[[str], None]
SEED_MAX = 2**31 - 1


def fly_simulated(args: argparse.Namespace, say: Say) -> dict[str, Any]:
    """Return what `fly --json` prints, with the exit `status` and the `reason` the flight ended. Raises UsageError."""
    plan = resolve(args)
    prompt = Prompt.load(plan.prompt_file)
    if plan.model:  # refuse what cannot fly before anything is started
        model = ChatModel(*split(plan.model), plan.base_url)
        model.check()
        model.close()
    settings = configuration(plan, prompt)
    folder = folders.create(args.out, plan.pilot_name, plan.record.id, settings)
    (folder / "episode.json").write_text(plan.record.to_json(), encoding="utf-8")
    disclaimer = " (built in, not a model)" if plan.pilot else ""
    say(f'episode {plan.record.id}: "{plan.record.instruction}", pilot {plan.pilot_name}{disclaimer}')
    return conclude(
        lambda: _fly(plan, prompt, folder, say, settings),
        folder,
        plan.record.id,
        plan.pilot_name,
        settings,
        lambda: draw(plan, folder),
    )


def resolve(args: argparse.Namespace) -> Plan:
    """Return the plan that the command line asks for. Raises UsageError."""
    factor = speed(args.speed or "1")
    episode = args.episode or catalogue.DEFAULT
    seed = 0 if args.seed is None else args.seed
    if not 0 <= seed <= SEED_MAX:
        raise UsageError(f"--seed wants a whole number from 0 to {SEED_MAX}, got {seed}")
    airframe = args.airframe or "x500"
    airframes.load(airframe)
    return Plan(
        episode=episode,
        record=catalogue.load(episode),
        pilot=None if args.model else roster.check(args.pilot or "vision"),
        model=args.model,
        base_url=args.base_url,
        speed=factor,
        latency=latency_for(args.latency, factor),
        seed=seed,
        airframe=airframe,
        prompt_file=args.prompt,
        full=args.full,
    )


def configuration(plan: Plan, prompt: Prompt) -> dict[str, Any]:
    """Return what run.json holds."""
    return {
        "pilot": plan.pilot,
        "model": plan.model,
        "base_url": redacted(plan.base_url) if plan.base_url else None,
        "prompt_sha256": prompt.digest,
        "sampling": SAMPLING,
        "seed": plan.seed,
        "clock": "lockstep" if plan.speed is None else "real time",
        "speed": plan.speed,
        "latency": plan.latency.name,
        "airframe": plan.airframe,
        "camera": CAMERA,
    }


def _fly(plan: Plan, prompt: Prompt, folder: Path, say: Say, settings: dict[str, Any]) -> Flown:
    """Fly, and add to `settings` how well a flight in real time held it."""
    pace: Callable[[], dict[str, float]] | None = None
    if plan.speed is None:
        say("lockstep: loading the flight core and the camera; the first run compiles them, about a minute …")
        from dronecats.run.lockstep_stage import LockstepStage

        stage: Stage = LockstepStage(plan, folder)
    else:
        from dronecats.run.realtime_stage import RealtimeStage

        stage = realtime = RealtimeStage(plan, folder, say)
        pace = realtime.pace
    try:
        from dronecats.sitl.scenario import load_world

        world = load_world(plan.episode)
        starts = [start_of(start, world.ground_down(*start.position_ned[:2])) for start in plan.record.starts]
        pilot = Pilot(stage.model, prompt, plan.record.instruction, plan.latency)
        return fly(stage, starts, pilot, folder, full=plan.full, on_step=progress(say), say=say)
    finally:
        try:
            if pace is not None:
                with suppress(DronecatsError):  # a simulator that has died has said so already
                    settings["pace"] = pace()
        finally:
            stage.close()


def conclude(
    flight: Callable[[], Flown],
    folder: Path,
    episode: str,
    pilot_name: str,
    settings: dict[str, Any],
    draw_picture: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Fly, and whatever comes of it leave a judged run folder; return the JSON object of `fly`."""
    try:
        flown = flight()
    except KeyboardInterrupt:
        flown = Flown("interrupted", None, 0.0, 0.0, 0)
    except DronecatsError as error:
        flown = Flown("error", error, 0.0, 0.0, 0)
    except ImportError as missing:
        flown = Flown("error", UsageError(folders.missing_package(missing)), 0.0, 0.0, 0)
    except Exception as bug:
        flown = Flown("error", unexpected(bug, folder), 0.0, 0.0, 0)
    with undisturbed():
        verdict = write_verdict(folder)
        folders.write_run(folder.parent, {**settings, "served_rate_hz": served_rate_hz(folder)})
        if flown.steps:
            draw_picture()
    status = {"cap": 0, "decided": 0, "interrupted": 130}.get(flown.reason, 3)
    if flown.error:
        status = flown.error.exit_status
    elif status == 0 and verdict["outcome"] == "error":
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
        "error": str(flown.error) if flown.error else verdict["error"] if flown.reason != "interrupted" else None,
        "reason": flown.reason,
        "status": status,
    }


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore Ctrl-C and its like for the moment that it takes to write the verdict."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, signal.SIG_IGN) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


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
