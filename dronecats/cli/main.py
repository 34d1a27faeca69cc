"""The command `dronecats`: parses the command line and runs the verb. It imports only the module of that verb."""

import argparse
import importlib
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from dronecats import __version__
from dronecats.cli.exit_status import exit_status
from dronecats.cli.output import Output
from foundation import machine
from foundation.wording import did_you_mean, nearest

VERBS = {
    "fly": "fly one episode, in simulation or on a vehicle that you connect",
    "sitl": "run the simulator for any MAVLink client",
    "impair": "put a lossy, slow link between an agent and an autopilot",
    "preflight": "check whether a connected vehicle is fit to fly",
    "bench": "fly a suite with models and pilots, or resume one that stopped",
    "study": "measure what a slow model, a bad link or the wind costs",
    "judge": "derive the verdicts of runs again from their logs",
    "audit": "count what other rules would change, and what think and repaired replies gained",
    "query": "query runs with SQL",
    "replay": "show recorded flights in the browser",
    "film": "make a video of a recorded flight",
    "export": "convert flights to MCAP, Rerun, LeRobot, ULog, KML, GeoJSON, CSV or Parquet",
    "report": "make the paper's tables and figures from runs, and a page to browse them",
    "submit": "pack runs into one archive that others can verify",
    "verify": "judge the runs of an archive again, and list what this cannot prove",
    "leaderboard": "make a page of verified entries",
    "compare": "measure how far apart the paths of two flights are",
    "flightlog": "list and fetch an autopilot's logs, and derive a flight's path from them",
    "tune": "print an airframe's gains and stability margins, and draw its loops",
    "episodes": "list, show, check and make episodes",
    "edit": "make or change an episode in the browser",
    "models": "list the known models, show the requests that one gets, check its answers",
    "prompt": "copy the prompt of a paper's LaTeX source to a file for --prompt",
    "maps": "list, show and export maps, and import your own",
    "camera": "check a camera, or calibrate it with a chessboard",
    "doctor": "check what works on this machine, what is missing and how to get it",
}
MODULES = {  # verb → module, for verbs whose module has another name
    "audit": "judge", "film": "replay", "export": "query", "verify": "submit", "leaderboard": "submit",
    "edit": "episode_authoring", "prompt": "models",
}  # fmt: skip
EXAMPLES = Path(__file__).with_name("examples.txt")  # examples in help texts, one command per line
HELP_COLUMNS = 100
# GB of address space, measured as VmPeak on two cores and rounded up
FLIGHT_GB = 2.0  # flying or rendering needs this for a flight core, a renderer, and their compilation
MEMORY_GB = {
    **dict.fromkeys(("fly", "sitl", "bench", "study", "film", "edit", "replay"), FLIGHT_GB),
    "episodes": 1.0, "compare": 0.4, "judge": 0.2,
    **dict.fromkeys(("models", "doctor", "impair", "prompt"), 0.0),
}  # fmt: skip
DEFAULT_GB = 1.2  # for the other verbs: a report with figures needs this
READER_LOST = {  # verb that runs for minutes → message when the reader of the output (such as `head`) has ended
    "fly": "dronecats fly: the reader of the output has gone; the flight continues, and its results are"
    " in the run folder"
}


class VerbHelp(argparse.HelpFormatter):
    """Formats help with at most HELP_COLUMNS columns. The list of examples is not wrapped."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=min(HELP_COLUMNS, shutil.get_terminal_size().columns - 2))

    def add_argument(self, action: argparse.Action) -> None:
        """Add an argument. The column of names is wide enough for the names of verbs and actions, too."""
        super().add_argument(action)
        if isinstance(action, Actions):
            longest = max(len(choice.dest) for choice in action._get_subactions())
            indent = self._current_indent + self._indent_increment
            self._action_max_length = max(self._action_max_length, indent + longest)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class Actions(argparse._SubParsersAction):  # type: ignore[type-arg]  # generic for type checkers only
    """The parsers of verbs or actions. Each description is the `help` text with a capital letter and a full stop."""

    def add_parser(self, name: str, **kwargs: Any) -> Any:
        """Return a new parser for `name`."""
        text = kwargs["help"]
        return super().add_parser(name, **{"description": f"{text[0].upper()}{text[1:]}.", **kwargs})


class VerbParser(argparse.ArgumentParser):
    """A parser whose help ends with examples, and whose errors suggest similar words for a mistyped word."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(formatter_class=VerbHelp, **kwargs)
        self.register("action", "parsers", Actions)

    def format_help(self) -> str:
        """Return the help, with the examples that begin with this parser's command."""
        self.epilog = self.epilog or "\n  ".join(["examples:", *self.examples()[:3]])
        return super().format_help()

    def examples(self) -> list[str]:
        """Return all example commands that begin with this parser's command."""
        lines = EXAMPLES.read_text(encoding="utf-8").splitlines()
        return [line for line in lines if f"{line} ".startswith(f"{self.prog} ")]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments. An unknown option ends the program with a suggestion."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if option := next((word for word in unknown if word.startswith("--")), None):
            near = nearest(option.partition("=")[0], self._option_string_actions)
            self.error(f"unknown option {option}{f': {did_you_mean(near)}' if near else '.'}")
        return parsed, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with a one-sentence error, without the long usage text."""
        end = "" if message.endswith(("?", ".")) else "."
        self.exit(2, f"{self.prog}: {message}{end} See: {self.prog} --help\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        near = nearest(str(value), map(str, action.choices or ()))
        if near and action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"{value!r} is not known: {did_you_mean(near)}")
        super()._check_value(action, value)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the parsed command line; `run` in it is the verb's function. Raises SystemExit as argparse does."""
    return command_parser(_verb(arguments)).parse_args(arguments)


def command_parser(named: str | None) -> VerbParser:
    """Return the parser of the command line. Only the verb `named` gets its options."""
    parser = VerbParser(
        prog="dronecats",
        description="A multimodal model as the pilot of a drone, and the benchmark that measures it.",
        epilog="`dronecats VERB --help` lists the options of a verb, with examples.",
    )
    parser.add_argument("--version", action="version", version=f"dronecats {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb, text in VERBS.items():
        added = verbs.add_parser(verb, help=text)
        if verb == named:
            module = importlib.import_module(f"dronecats.cli.{MODULES.get(verb, verb)}")
            getattr(module, f"add_{verb}_options")(added)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done. 1: a negative result, for example a vehicle that is not fit to fly. 2: wrong usage. 3: an error, or a spent
    budget. 4: logs contradict a stored verdict, the claims of an archive, or themselves. 130: interrupted.
    If the reader of the output ends early, as `head` does, the verb continues and the status is the same.
    """
    arguments = sys.argv[1:] if argv is None else argv
    with Output(READER_LOST.get(_verb(arguments) or "")) as output:
        args = parse(arguments)
        status = exit_status(f"dronecats {args.verb}", lambda: _run(args))
        fault = output.fault()
        if fault and status == 0:
            print(f"dronecats {args.verb}: the output cannot be written: {fault}", file=sys.stderr)
            return 3
    return status


def _run(args: argparse.Namespace) -> int:
    """Run the verb and return its status. Raises UsageError if there is too little memory for it."""
    machine.check(f"dronecats {args.verb}", MEMORY_GB.get(args.verb, DEFAULT_GB))
    return int(args.run(args))


def _verb(arguments: Sequence[str]) -> str | None:
    return next((a for a in arguments if not a.startswith("-")), None)


if __name__ == "__main__":
    sys.exit(main())
