"""Verb `fly`: flies one episode, in simulation (`--sitl`) or on a connected vehicle (`--connect`)."""

import argparse
import contextlib
import json
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import print_next
from dronecats.cli.options import (
    COMMAND,
    LATENCY,
    PILOT,
    RUN,
    VEHICLE,
    Option,
    add,
    add_disturbances,
    add_view,
    describe_model,
    view_of,
)
from dronecats.cli.output import print_line
from dronecats.judge.diagnostics import contacts, estimator_resets, hits_of, resets_of
from dronecats.view.live.opening import opened
from foundation.errors import UsageError
from foundation.run_folder.folder import fresh_run
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import FlightSpec

ARM = "ARM"  # the user types it to confirm


def add_fly_options(parser: argparse.ArgumentParser) -> None:
    _add(parser.add_argument_group("vehicle"), VEHICLE)
    _add(parser.add_argument_group("pilot"), (*PILOT, COMMAND, LATENCY))
    add_disturbances(parser)
    run_group = parser.add_argument_group("run")
    _add(run_group, RUN)
    add_view(run_group)
    parser.set_defaults(run=run)


def _add(group: "argparse._ActionsContainer", options: Iterable[Option]) -> None:
    """Declare options. If an option is only for one kind of vehicle, its help names --sitl or --connect."""
    for option in options:
        if option.vehicle:
            condition = " and " if option.help.startswith("with ") else ": "
            text = f"with {option.vehicle}{condition}{option.help.removeprefix('with ')}"
            option = replace(option, help=text)
        add(group, [option])


def no_options() -> argparse.Namespace:
    """Return the parsed command line of `dronecats fly` without options."""
    parser = argparse.ArgumentParser()
    add_fly_options(parser)
    return parser.parse_args([])


def run(args: argparse.Namespace) -> int:
    """Fly one episode. Return 0 if it was flown to its end, 130 if interrupted, 2 or 3 after an error."""
    interrupt_on_signals()
    from dronecats.cli.fly_spec import replay_line, spec_of

    spec, view = spec_of(args), view_of(args)
    if spec.connected and spec.connected.authority.arm:
        _confirm(spec.connected.url)
    if spec.replay:
        print_line(replay_line(args, spec.replay.flight))
    if spec.model:
        print_line(f"Model {describe_model(spec.model)}")
    if view is None:
        return _fly(args, spec, args.out)
    out = args.out or fresh_run(spec.pilot_name)
    try:
        with opened(view, out, spec.pilot_name, print_line):
            return _fly(args, spec, out)
    finally:
        if args.out is None:
            with contextlib.suppress(OSError):
                out.rmdir()  # fails if a flight has written into the folder


def _fly(args: argparse.Namespace, spec: "FlightSpec", out: Path | None) -> int:
    from dronecats.flight.run.fly import fly

    if spec.connected and not spec.connected.truth:
        from dronecats.report.afterflight import rejudge, target_from

        target = target_from(args.target, args.target_std) if args.target else None
        return _report(rejudge(fly(spec, out, print_line), target, report=print_line), args.json)
    return _report(fly(spec, out, print_line), args.json)


def _confirm(url: str) -> None:
    """Ask the user to confirm that the propellers may turn. Raises UsageError for any answer but ARM."""
    print(f"--arm: the vehicle on {url} will arm and take off. Keep clear of it. Have a pilot at the sticks.")
    print(f"Type {ARM} to continue: ", end="", flush=True)
    if sys.stdin.readline().strip() != ARM:
        raise UsageError(f"not armed, because {ARM} was not typed. Without --arm, you arm and take off yourself")


def _verdict(result: dict[str, Any]) -> str:
    if result["outcome"] == "error":
        return "ERROR: the flight is not scored"
    if result["success"] is None:
        return "NOT JUDGED: there is no truth of this flight"
    if result["success"]:
        return f"SUCCESS: {result['ne_m']:.2f} m from the target at the deciding declaration"
    if result["ne_m"] is None:
        return "FAILURE: the distance at the last action was not measured"
    return f"FAILURE: {result['ne_m']:.2f} m from the target at the last action"


def _incidents(run: Path) -> list[str]:
    """Return a line about collisions if there were any, and a line about estimator resets if there were any."""
    from dronecats.judge.judged_flight import JudgedFlight

    flight = JudgedFlight.read(run)
    lines, speeds = [], dict[str, float]()  # speeds: the highest closing speed (m/s) by obstacle
    for hit in hits_of(flight.logs, flight.cap_s) or []:
        speeds[hit.what] = max(speeds.get(hit.what, 0.0), hit.closing_speed or 0.0)
    contact = contacts(flight.logs, flight.cap_s)
    if contact and contact.hits:
        obstacles = ", ".join(f"{name} at {speed:.1f} m/s" if speed else name for name, speed in speeds.items())
        lines.append(f"{counted(contact.hits, 'hit')} ({obstacles}), {contact.contact_s:.1f} s in contact")
    if count := estimator_resets(flight.logs, flight.cap_s):
        resets = resets_of(flight.logs, flight.cap_s) or []
        which = ", ".join(f"{' and '.join(reset.quantities) or 'small'} at {reset.t:.1f} s" for reset in resets)
        lines.append(f"{counted(count, 'estimator reset')} ({which})")
    return lines


def _report(result: dict[str, Any], as_json: bool) -> int:
    reason, status = result.pop("reason"), result.pop("status")
    if result.get("error"):
        print(f"dronecats fly: {result['error']}", file=sys.stderr)
    if reason == "interrupted":
        print("dronecats fly: interrupted; the run folder has the flight until then", file=sys.stderr)
    if reason in ("cap", "decided"):
        print(
            f"\n{_verdict(result)}\n{counted(result['steps'], 'step')},"
            f" {counted(result['declarations'], 'declaration')},"
            f" {result['sim_seconds']:.1f} s of flight at {result['real_time_factor']:.1f} × real time"
        )
        for line in _incidents(Path(result["run_dir"])):
            print(line)
    print(f"run folder: {result['run_dir']}", flush=True)
    if as_json:
        print(json.dumps(result), flush=True)
    elif reason in ("cap", "decided"):
        print_next("fly --connect" if result["success"] is None else "fly", run=result["run_dir"])
    return int(status)
