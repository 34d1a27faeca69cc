"""`dronecats fly`: one episode, in simulation (`--sitl`) or on a vehicle you connect (`--connect`)."""

import argparse
import contextlib
import json
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli import signals
from dronecats.cli.fly_spec import PILOT, RUN, VEHICLE, replay_line, spec_of
from dronecats.cli.options import COMMAND, LATENCY, Option, add, add_disturbances, describe_model
from dronecats.cli.page_options import add_view, view_of
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import FlightSpec

ARM = "ARM"  # what has to be typed


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("fly")
    _add(parser.add_argument_group("vehicle"), VEHICLE)
    _add(parser.add_argument_group("pilot"), (*PILOT, COMMAND, LATENCY))
    add_disturbances(parser)
    run_group = parser.add_argument_group("run")
    _add(run_group, RUN)
    add_view(run_group)
    parser.set_defaults(run=run)


def _add(group: "argparse._ActionsContainer", options: Iterable[Option]) -> None:
    """Declare options, which vehicle they go with before their help."""
    add(group, [replace(each, help=f"with {each.vehicle}: {each.help}") if each.vehicle else each for each in options])


def unsaid() -> argparse.Namespace:
    """Return the words of the verb where none is said: what another verb that flies says beside them."""
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers(dest="verb"))
    return parser.parse_args(["fly"])


def run(args: argparse.Namespace) -> int:
    """Fly; status 0 when the episode was flown and judged, 3 when flying broke down, 130 when interrupted."""
    signals.as_interrupts()
    spec, view = spec_of(args), view_of(args)
    if spec.connected and spec.connected.authority.arm:
        _confirm(spec.connected.url)
    if spec.replay:
        _say(replay_line(args, spec.replay.flight))
    if spec.model:
        _say(f"Model {describe_model(spec.model)}")
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
