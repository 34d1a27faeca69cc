"""Action `study rate`: measures how long the user's camera, encoding, model and setpoint take. No vehicle moves."""

import argparse
import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.exit_status import INTERRUPTED, interrupt_on_signals
from dronecats.cli.fly import no_options
from dronecats.cli.next_commands import next_commands, print_next
from dronecats.cli.options import PILOT, SIGN, add
from dronecats.cli.output import print_note, show
from foundation.errors import UsageError

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import FlightSpec
    from dronecats.study.rate.chain import ChainSummary

QUESTIONS = 30  # default of --questions
LEAST = 5  # fewer questions give no useful quantiles
MOST = 10_000  # largest number of questions, because a latency trace has at most so many values
INSTRUCTION = "Find the red van and fly up to it."


def add_rate_options(parser: argparse.ArgumentParser) -> None:
    rig = parser.add_argument_group("the rig")
    rig.add_argument("--connect", metavar="URL", required=True, help="the vehicle: udpin://0.0.0.0:14540, serial://…")
    add(rig, [SIGN])
    rig.add_argument(
        "--camera", metavar="URL", required=True, help="http://, rtsp://, v4l2:0, a video file or a folder"
    )
    rig.add_argument("--calibration", type=Path, metavar="FILE", help="lens of the camera: docs/cameras.md")
    rig.add_argument("--envelope", type=Path, metavar="FILE", help="limits of the safety envelope: docs/envelope.md")
    rig.add_argument("--dry-run", action="store_true", help="required, to confirm that nothing moves")
    add(parser.add_argument_group("pilot"), PILOT)
    run_group = parser.add_argument_group("run")
    run_group.add_argument("--instruction", metavar="TEXT", default=INSTRUCTION, help="the task of the pilot")
    run_group.add_argument(
        "--questions",
        type=int,
        metavar="N",
        help=f"number of questions (default {QUESTIONS}, or as many as --seconds allow)",
    )
    run_group.add_argument("--seconds", type=float, metavar="S", help="longest vehicle time (default 300)")
    run_group.add_argument(
        "--patience", type=float, metavar="S", help="longest wait for a frame or a reply (default 60)"
    )
    run_group.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/TIME-PILOT)")
    run_group.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure the times.

    Return 0 if all questions were answered, or at least LEAST of them within --seconds; 2 if fewer were; 3 after an
    error; 130 if interrupted before the last question.
    """
    wanted = _wanted(args)
    spec = rehearsal(args)
    interrupt_on_signals()

    from dronecats.flight.run.fly import fly
    from dronecats.flight.run.landing import signals_handled
    from dronecats.study.rate.chain import check_fresh, summarize, write_replay
    from dronecats.study.rate.instruments import RateInstruments

    if args.out is not None:
        check_fresh(args.out)
    instruments = RateInstruments(wanted)
    result = fly(spec, args.out, print_note, instruments)
    with signals_handled(signal.SIG_IGN):
        instruments.close()
        times, folder = instruments.times, instruments.run
        summary = summarize(times, spec.pilot_name, camera_stamps=instruments.camera_stamps) if times else None
        if summary and folder:
            write_replay(folder, times, summary.frame_delay_s)
        status, why = _ended(result, len(times), wanted, args.seconds)
        _report(summary, folder, {"wanted": wanted, "status": status, "error": why}, as_json=args.json)
    if why:
        print_note(f"dronecats study rate: {why}")
    return status


def _wanted(args: argparse.Namespace) -> int | None:
    """Return the requested number of questions; None: as many as the time allows. Raises UsageError."""
    if not args.dry_run:
        raise UsageError("`study rate` never moves a vehicle. Add --dry-run to confirm that you know this")
    if args.cache is not None:
        raise UsageError("a cached reply takes no time. Leave --cache out")
    wanted: int | None = QUESTIONS if args.questions is None and args.seconds is None else args.questions
    if wanted is not None and not LEAST <= wanted <= MOST:
        raise UsageError(f"--questions must be a whole number from {LEAST} to {MOST:,}, got {wanted}")
    return wanted


def rehearsal(args: argparse.Namespace) -> "FlightSpec":
    """Return the specification of `fly --connect … --dry-run` with these options. Raises UsageError."""
    from dronecats.cli.fly_spec import spec_of

    return spec_of(argparse.Namespace(**(vars(no_options()) | vars(args))))


def _ended(result: dict[str, Any], questions: int, wanted: int | None, seconds: float | None) -> tuple[int, str | None]:
    """Return the exit status, and the reason if it is not 0."""
    kept = f"; the measurements until then are in {Path(result['run_dir']).parent}"
    if result["error"]:
        return int(result["status"]), f"{result['error']}{kept if questions else ''}"
    if wanted is not None and questions >= wanted:
        return 0, None
    if result["reason"] == "interrupted":
        return INTERRUPTED, f"interrupted after {questions} questions{kept}"
    if questions < LEAST:
        of = "" if wanted is None else f" of {wanted}"
        within = f" in {seconds:g} s" if seconds is not None else ""
        return (
            2,
            f"only {questions}{of} questions were answered{within}, too few for quantiles. Raise --seconds{kept}",
        )
    return 0, None


def _report(summary: "ChainSummary | None", folder: Path | None, ending: dict[str, Any], *, as_json: bool) -> None:
    from dronecats.study.rate.chain import CHAIN, STUDY, TRACE, summary_table

    written = [str(folder / name) for name in (CHAIN, TRACE, STUDY)] if summary and folder else []
    made = next_command_values(folder, summary.frame_delay_s) if summary and folder else {}
    if as_json:
        commands = next_commands("study rate", **made) if made else []
        print(json.dumps({**(summary.as_json() if summary else {"questions": 0}), **ending,
                          "written": written, "next": commands}))  # fmt: skip
        return
    if summary:
        show(summary_table(summary, ending["wanted"]))
        print("\nwritten:", *(f"  {path}" for path in written), sep="\n")
        if made:
            print_next("study rate", **made)


def next_command_values(folder: Path, frame_delay_s: float) -> dict[str, str | Path | list[str]]:
    """Return the values of the suggested next commands: measured latency and frame delay, folder and study file."""
    from dronecats.study.rate.chain import STUDY, TRACE

    delay = ["--frame-delay", f"{frame_delay_s:g}"] if frame_delay_s else []
    return {"latency": [f"trace:{folder / TRACE}", *delay], "folder": folder, "study": folder / STUDY}
