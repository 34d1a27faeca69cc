"""`dronecats fly`: one episode, in simulation (`--sitl`) or on a vehicle you connect (`--connect`)."""

import argparse
import contextlib
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.agent.models.providers import PROVIDERS
from dronecats.cli import signals
from dronecats.cli.disturbance_options import add_disturbance_options
from dronecats.cli.model_options import add_accounts, add_manners, add_options, told
from dronecats.cli.sign_option import add_sign
from dronecats.cli.view_options import add_view, view_of
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import FlightSpec

ARM = "ARM"  # what has to be typed


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("fly")
    vehicle = parser.add_argument_group("vehicle")
    vehicle.add_argument("--sitl", action="store_true", help="simulate the vehicle, its autopilot and its camera")
    vehicle.add_argument(
        "--connect", metavar="URL", help="a vehicle that is running: udpin://0.0.0.0:14540, serial://…"
    )
    add_sign(vehicle, "with --connect: ")
    vehicle.add_argument(
        "--camera", metavar="URL", help="with --connect: http://, rtsp://, v4l2:0, a video file or a folder"
    )
    vehicle.add_argument(
        "--calibration", type=Path, metavar="FILE", help="with --connect: the lens, see docs/cameras.md"
    )
    vehicle.add_argument(
        "--world", metavar="EPISODE", help="with --connect: the vehicle simulates itself, and flies this episode or map"
    )
    vehicle.add_argument(
        "--truth", metavar="URL", help="with --world: its true poses, of a PX4 udpin://127.0.0.1:19410"
    )
    vehicle.add_argument(
        "--arm", action="store_true", help="with --connect: arm and take off after a typed yes; without it, you do"
    )
    vehicle.add_argument("--dry-run", action="store_true", help="with --connect: decide and draw, but move nothing")
    vehicle.add_argument("--then", choices=("land", "return", "hold"), help="with --connect: how the flight ends")
    vehicle.add_argument(
        "--envelope", type=Path, metavar="FILE", help="limits of the safety envelope: docs/envelope.md"
    )
    vehicle.add_argument("--no-envelope", action="store_true", help="with --sitl: no limits at all")
    vehicle.add_argument("--instruction", metavar="TEXT", help="with --connect: what the pilot is told")
    vehicle.add_argument(
        "--target", metavar="LAT,LON[,ALT]", help="with --connect: as surveyed, for the distances: docs/after-flight.md"
    )
    vehicle.add_argument("--target-std", type=float, metavar="M", help="with --target: how well, per axis (3)")
    vehicle.add_argument("--airframe", metavar="NAME", help="with --sitl (default x500)")
    vehicle.add_argument("--optics", type=Path, metavar="FILE", help="with --sitl: lens, noise, weather")
    vehicle.add_argument("--autopilot", choices=("ours", "px4"), help="with --sitl: who flies the simulated vehicle")
    vehicle.add_argument("--px4", metavar="COMMAND", help="with --autopilot px4: starts your PX4; without it, waits")
    vehicle.add_argument(
        "--keep-ulog", action="store_true", help="with --connect or --px4: keep the log that PX4 writes on board"
    )
    pilot = parser.add_argument_group("pilot")
    add_pilot(pilot)
    pilot.add_argument(
        "--command", choices=("flat", "hierarchical", "solo"), help="who decides for a fleet: docs/commanding.md"
    )
    pilot.add_argument(
        "--latency",
        metavar="POLICY",
        help="what a reply takes: real (default), fixed:SECONDS (with --speed max: fixed:0.5) …: docs/latency.md",
    )
    add_disturbance_options(parser)
    run_group = parser.add_argument_group("run")
    run_group.add_argument("--episode", metavar="ID", help="id or file (default: go to the cyan SUV)")
    run_group.add_argument("--drones", type=int, metavar="N", help="1 to 8 of a commanding episode (default: its four)")
    run_group.add_argument("--speed", metavar="N|max", help="factor on real time (default 1); max is lockstep")
    run_group.add_argument("--seed", type=int, help="tells flights of one episode apart (default 0)")
    run_group.add_argument("--seconds", type=float, help="with --connect: length of the flight (300)")
    run_group.add_argument(
        "--patience", type=float, metavar="S", help="with --connect: end the flight after S without a reply (60)"
    )
    run_group.add_argument(
        "--spec", type=Path, metavar="FILE", help="fly what a run.json says, or the flight in it, once more"
    )
    run_group.add_argument("--full", action="store_true", help="fly to the cap even when the verdict is decided")
    run_group.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/TIME-PILOT)")
    run_group.add_argument("--json", action="store_true", help="end with one JSON object on standard output")
    add_view(run_group)
    parser.set_defaults(run=run)


def add_pilot(group: "argparse._ActionsContainer") -> None:
    """Declare who flies, as every verb has it that flies one flight."""
    group.add_argument(
        "--pilot",
        metavar="NAME",
        help="vision (default), oracle, noisy, blind:NAME, failing:NAME, recorded:FILE; no models",
    )
    group.add_argument(
        "--model",
        metavar="NAME",
        help=f"a row of `dronecats models list`; replay:RUN; or PROVIDER/NAME, of {', '.join(PROVIDERS)}",
    )
    add_options(group)
    add_accounts(group)
    group.add_argument("--ledger", type=Path, metavar="FILE", help="with --model: of several runs (in the folder)")
    add_manners(group)
    group.add_argument("--agent", metavar="NAME", help="paper (default), steady, or MODULE:NAME: docs/extending.md")


def unsaid() -> argparse.Namespace:
    """Return the words of the verb where none is said: what another verb that flies says beside them."""
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers(dest="verb"))
    return parser.parse_args(["fly"])


def run(args: argparse.Namespace) -> int:
    """Fly; status 0 when the episode was flown and judged, 3 when flying broke down, 130 when interrupted."""
    from dronecats.cli.fly_spec import said_of_replay, spec_of

    signals.as_interrupts()
    spec, view = spec_of(args), view_of(args)
    if spec.connected and spec.connected.authority.arm:
        _confirm(spec.connected.url)
    if spec.replay:
        _say(said_of_replay(args, spec.replay.flight))
    if spec.model:
        _say(f"Model {told(spec.model)}")
    if view is None:
        return _fly(args, spec, args.out)
    from dronecats.view.live.opening import opened
    from foundation.run_folder.folder import fresh_run

    out = args.out or fresh_run(spec.pilot_name)
    try:
        with opened(view, out, spec.pilot_name, _say):
            return _fly(args, spec, out)
    finally:
        if args.out is None:
            with contextlib.suppress(OSError):
                out.rmdir()  # nothing was flown into it


def _fly(args: argparse.Namespace, spec: "FlightSpec", out: Path | None) -> int:
    from dronecats.flight.run.fly import fly

    if spec.connected and not spec.connected.truth:
        from dronecats.report.afterflight.surveyed_target import target_from
        from dronecats.report.afterflight.trace import rejudge

        target = target_from(args.target, args.target_std) if args.target else None
        return _report(rejudge(fly(spec, out, _say), target, say=_say), args.json)
    return _report(fly(spec, out, _say), args.json)


def _confirm(url: str) -> None:
    """Have it typed that the propellers may turn. Raises UsageError for anything else."""
    from foundation.errors import UsageError

    print(f"--arm: the vehicle on {url} will arm and take off. Keep clear of it, a pilot at the sticks.")
    print(f"Type {ARM} to go on: ", end="", flush=True)
    if sys.stdin.readline().strip() != ARM:
        raise UsageError(f"not armed: {ARM} was not typed; without --arm, you arm and take off yourself")


def _say(line: str) -> None:
    print(line, flush=True)


def _verdict(result: dict[str, Any]) -> str:
    if result["outcome"] == "error":
        return "ERROR: nobody's score"
    if result["success"] is None:
        return "NOT JUDGED: nobody measured the truth"
    if result["success"]:
        return f"SUCCESS: {result['ne_m']:.2f} m from the target at the deciding declaration"
    if result["ne_m"] is None:
        return "FAILURE: its distance at the last action was not measured"
    return f"FAILURE: {result['ne_m']:.2f} m from the target at the last action"


def _incidents(run: Path) -> list[str]:
    """Return a line about what the drones flew into, and one about estimator resets; none for what did not happen."""
    from dronecats.judge.incidents import contacts, estimator_resets, hits_of, resets_of
    from dronecats.judge.judged_flight import JudgedFlight

    flown = JudgedFlight.read(run)
    lines, hardest = [], dict[str, float]()
    for hit in hits_of(flown.logs, flown.cap_s) or []:
        hardest[hit.what] = max(hardest.get(hit.what, 0.0), hit.closing_speed or 0.0)
    found = contacts(flown.logs, flown.cap_s)
    if found and found.hits:
        things = ", ".join(f"{what} at {speed:.1f} m/s" if speed else what for what, speed in hardest.items())
        lines.append(f"{counted(found.hits, 'hit')} ({things}), {found.contact_s:.1f} s in contact")
    if count := estimator_resets(flown.logs, flown.cap_s):
        each = resets_of(flown.logs, flown.cap_s) or []
        which = ", ".join(f"{' and '.join(reset.quantities) or 'small'} at {reset.t:.1f} s" for reset in each)
        lines.append(f"{counted(count, 'estimator reset')} ({which})")
    return lines


def _report(result: dict[str, Any], as_json: bool) -> int:
    reason, status = result.pop("reason"), result.pop("status")
    if result.get("error"):
        print(f"dronecats fly: {result['error']}", file=sys.stderr)
    if reason == "interrupted":
        print("dronecats fly: interrupted; the run folder holds what was flown", file=sys.stderr)
    if reason in ("cap", "decided"):
        print(
            f"\n{_verdict(result)}; {counted(result['steps'], 'step')},"
            f" {counted(result['declarations'], 'declaration')},"
            f" {result['sim_seconds']:.1f} s of flight at {result['real_time_factor']:.1f} × real time"
        )
        for line in _incidents(Path(result["run_dir"])):
            print(line)
    print(f"run folder: {result['run_dir']}", flush=True)
    if as_json:
        print(json.dumps(result), flush=True)
    return int(status)
