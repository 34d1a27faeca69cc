"""`dronecats VERB …`: finds the verb's file and lets it work. Nothing heavy is imported before the verb is known."""

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Any

from dronecats import __version__
from dronecats.cli.exit_status import exit_status
from dronecats.cli.output import Output
from foundation import machine
from foundation.wording import did_you_mean, nearest

VERBS = {
    "fly": "fly an episode, in simulation or on a vehicle you connect",
    "sitl": "run the simulator for any MAVLink client",
    "impair": "put a bad wire between an agent and an autopilot",
    "preflight": "say whether a vehicle is fit to be flown, and what is not",
    "bench": "fly a suite with models and pilots, and go on where it stopped",
    "study": "fly what a slow model, a bad wire or the wind costs, by a design",
    "judge": "derive the verdicts of runs again from their logs",
    "audit": "say what other rules would make of the same flights, and what think and mending bought",
    "query": "ask runs in SQL",
    "replay": "show recorded flights in the browser again, several over one another",
    "film": "make a film of a flight, from its folder alone",
    "export": "write flights in other people's formats: MCAP, Rerun, LeRobot, ULog, KML, tables",
    "report": "make the paper's tables and figures, and a page to look through, from runs",
    "submit": "make one archive of runs, with everything that is needed to judge them again",
    "verify": "judge an archive of runs again, and say what that cannot tell",
    "leaderboard": "make a page of verified entries",
    "compare": "say how far the paths of two flights lie apart",
    "flightlog": "list and fetch the logs on board of an autopilot, and trace a flight without truth",
    "tune": "print an airframe's gains and margins, and draw its loops",
    "episodes": "list, show, check, make and fly episodes; the reading probe",
    "edit": "make or change an episode in the browser",
    "models": "list the models that are known by name, show what is sent to one, check what it answers",
    "prompt": "write the prompt of a paper's LaTeX source to a file for --prompt",
    "maps": "list the maps, export one, import your own",
    "camera": "check a camera, or calibrate it with a chessboard",
    "doctor": "say what works on this machine, what is missing and how to get it",
}
# GB of address space, measured as VmPeak on two cores and rounded up
FLIGHT_GB = 2.0  # whatever flies, or draws a world: a flight core, a renderer, and what compiles them
MEMORY_GB = {
    **dict.fromkeys(("fly", "sitl", "bench", "study", "film", "edit", "replay"), FLIGHT_GB),
    "episodes": 1.0, "compare": 0.4, "judge": 0.2,
    **dict.fromkeys(("models", "doctor", "impair", "prompt"), 0.0),
}  # fmt: skip
OTHERS_GB = 1.2  # the report, with its figures
UNHEARD = {  # what is said where the work goes on for minutes after the reader of the output has gone
    "fly": "dronecats fly: nobody reads the output any more; the flight goes on, its results are in the run folder",
}


class Verbs(argparse._SubParsersAction):  # type: ignore[type-arg]  # generic for type checkers only
    """The verbs' parsers. What a verb does stands in the table above, for its own help and for everybody's."""

    def add_parser(self, name: str, **kwargs: Any) -> Any:
        """Return a new parser for the verb `name`."""
        said = VERBS[name]
        words = {"help": said, "description": f"{said[0].upper()}{said[1:]}."}
        return super().add_parser(name, **{**words, **kwargs})


class VerbParser(argparse.ArgumentParser):
    """A parser that answers a mistyped verb or value with the nearest one."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        near = nearest(str(value), map(str, action.choices or ()))
        if near and action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"{value!r} is not known; {did_you_mean(near)}")
        super()._check_value(action, value)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return what a command line asks for, `run` in it to be called with it. Raises SystemExit as argparse does."""
    parser = VerbParser(
        prog="dronecats", description="A multimodal model as the pilot of a drone, and the benchmark that measures it."
    )
    parser.add_argument("--version", action="version", version=f"dronecats {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, action=Verbs)
    asked = _verb(arguments)
    for verb in VERBS:
        if verb == asked:
            importlib.import_module(f"dronecats.cli.{verb}").add_parser(verbs)
        else:
            verbs.add_parser(verb)
    return parser.parse_args(arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0 done, 2 wrong usage, 3 something broke, 130 interrupted; 1 and 4 are what a verb found: something that is not
    solved or not fit, a verdict that differs.
    A reader of the output that goes away, as `head` does, changes nothing of what is done and of its status.
    """
    arguments = sys.argv[1:] if argv is None else argv
    with Output(UNHEARD.get(_verb(arguments) or "")) as output:
        args = parse(arguments)
        status = exit_status(f"dronecats {args.verb}", lambda: _run(args))
        fault = output.fault()
        if fault and status == 0:
            print(f"dronecats {args.verb}: the output cannot be written: {fault}", file=sys.stderr)
            return 3
    return status


def _run(args: argparse.Namespace) -> int:
    """Do what a verb is for, and return its status. Raises UsageError where there is not the memory for it."""
    machine.check(f"dronecats {args.verb}", MEMORY_GB.get(args.verb, OTHERS_GB))
    return int(args.run(args))


def _verb(arguments: Sequence[str]) -> str | None:
    return next((a for a in arguments if not a.startswith("-")), None)


if __name__ == "__main__":
    sys.exit(main())
