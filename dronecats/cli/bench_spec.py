"""From the words of `dronecats bench`, and a file of the same words, to the runs of a benchmark."""

import argparse
import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.options import (
    AGENT,
    COMMAND,
    DISTURBANCES,
    LATENCY,
    MODEL,
    PART,
    PILOTS,
    PLACE,
    Option,
    disturbances_of,
    first_set,
    is_set,
    model_of,
    speed,
)

if TYPE_CHECKING:
    from dronecats.agent.latency import LatencyPolicy
    from dronecats.bench.matrix import BenchEntry, ChosenSuite
    from dronecats.flight.spec.flight_spec import FlightSpec

NO_RETRY = Option(name="no_retry", kind=bool, help="leave what did not move as it is: docs/bench.md")
MATRIX = (
    replace(AGENT, many=True),
    replace(COMMAND, many=True, choices=(), metavar="HOW", help="of fleets: flat (default), hierarchical, solo"),
    replace(LATENCY, many=True),
    Option(
        name="rate", many=True, file="a number", metavar="HZ", help="pin the control rate: 1/HZ s for a reply"
    ),
)  # fmt: skip
DROP_STALLED = Option(name="drop_stalled", kind=bool, help="leave unscored what the host has delayed")
EPISODES = Option(name="episodes", many=True, help="by id or file")
# what a file may say, each the option of that name
FILE_OPTIONS = {
    option.name: option for option in (EPISODES, *PART, *PILOTS, *MATRIX, NO_RETRY, *DISTURBANCES, *PLACE, DROP_STALLED)
}
ROW = (
    "name",
    "called",
    "reasoning",
    *(option.name for option in MODEL),
)  # of a model that is a table; reasoning is reasoning_effort, shorter
DEFAULTS: dict[str, Any] = {"flights": 1, "seed": 0, "parser": "strict", "speed": "max"}
MOST = {"flights": 1000, "jobs": 1024, "limit": 1_000_000}


def with_file(args: argparse.Namespace) -> argparse.Namespace:
    """Return the arguments with what a .toml file among them says, where the command line does not say otherwise.

    Raises UsageError for a file that cannot be read, and a word in it that is none.
    """
    from foundation.errors import UsageError

    files = [each for each in args.episodes if each.endswith(".toml")]
    told: dict[str, Any] = {}
    if files:
        if len(args.episodes) > 1:
            raise UsageError("a .toml file says what is flown: leave the other episodes out, or name them in it")
        told = read(Path(files[0]))
        args.episodes = []
        told.setdefault("out", str(Path("runs") / Path(files[0]).stem))
    return filled(args, {**DEFAULTS, **told})


def filled(args: argparse.Namespace, told: dict[str, Any]) -> argparse.Namespace:
    """Return the arguments with what is `told`, where the command line does not say otherwise.

    Raises UsageError for a count that is none.
    """
    from foundation.errors import UsageError

    for name, value in told.items():
        if not is_set(getattr(args, name)):
            is_path = name in FILE_OPTIONS and FILE_OPTIONS[name].kind is Path
            setattr(args, name, Path(value) if is_path else value)
    for name, most in MOST.items():
        value = getattr(args, name)
        if value is not None and not 1 <= value <= most:
            raise UsageError(f"--{name} wants 1 to {most}, got {value}")
    return args


def read(path: Path) -> dict[str, Any]:
    """Return what a file says, by option. Raises UsageError naming the file, the word and what it should be."""
    return checked(path, toml(path), tuple(FILE_OPTIONS))


def toml(path: Path) -> dict[str, Any]:
    """Return a file's words and tables. Raises UsageError where it cannot be read."""
    import tomllib

    from foundation.errors import UsageError

    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None


def checked(path: Path, told: dict[str, Any], known: Sequence[str], others: Sequence[str] = ()) -> dict[str, Any]:
    """Return a file's words by option, of those that are `known`; `others` may be meant by a word that is none.

    Raises UsageError naming the file, the word and what it should be.
    """
    from foundation.errors import UsageError

    found: dict[str, Any] = {}
    for word, value in told.items():
        name = word.replace("-", "_")
        if name not in known:
            near = difflib.get_close_matches(name, (*known, *others), 1)
            raise UsageError(f"{path}: '{word}' is not known{f'; did you mean {near[0]}?' if near else ''}")
        found[name] = _checked(path, name, value)
    return found


def _checked(path: Path, name: str, value: Any) -> Any:
    from dronecats.flight.spec.latency_trace import from_folder
    from foundation.errors import UsageError

    try:
        checked = FILE_OPTIONS[name].read(value)
    except ValueError as wanted:
        raise UsageError(f"{path}: {name} wants {wanted}, got {value!r:.60}") from None
    return [from_folder(each, path.parent) for each in checked] if name == "latency" else checked


def suite(args: argparse.Namespace) -> "ChosenSuite":
    """Return the episodes that are asked for. Raises UsageError."""
    from dronecats.bench.matrix import suite_of

    return suite_of(args.episodes or (), args.suite or ())


def runs(args: argparse.Namespace, chosen: "ChosenSuite", out: Path) -> "list[BenchEntry]":
    """Return every run of the benchmark in a folder. Raises UsageError."""
    from dronecats.bench.matrix import entries

    return entries(
        pilots(args, out), chosen, commands=args.command or ("flat",), latencies=_latencies(args), flights=args.flights
    )


def shard(args: argparse.Namespace) -> tuple[int, int] | None:
    """Return (i, n) of --shard i/n. Raises UsageError."""
    from foundation.errors import UsageError

    if args.shard is None:
        return None
    part, _, parts = args.shard.partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts) <= 10_000):
        raise UsageError(f"--shard wants i/n with i from 1 to n, got '{args.shard}'")
    return int(part), int(parts)


def _latencies(args: argparse.Namespace) -> "list[LatencyPolicy]":
    """Return the latency policies; one for every rate that is pinned."""
    from dronecats.flight.spec.flight_spec import LATENCY as DEFAULT
    from dronecats.flight.spec.latency_trace import latency_policy
    from foundation.errors import UsageError

    if args.rate and args.latency:
        raise UsageError("--rate pins what a reply takes, and --latency says it otherwise; leave one of them out")
    if args.rate:
        return [latency_policy(f"rate:{rate}") for rate in args.rate]
    return [latency_policy(text) for text in args.latency or [DEFAULT if args.speed == "max" else "real"]]


def pilots(args: argparse.Namespace, out: Path) -> "list[tuple[str, FlightSpec]]":
    """Return each pilot's name and flight by each agent, but for episode, command and latency."""
    from dronecats.agent.models.ledger import cost_limit, token_limit
    from dronecats.agent.names import PAPER
    from dronecats.cli.fly_spec import commanded_by, template_of
    from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
    from dronecats.pilots import roster
    from foundation.errors import UsageError
    from foundation.run_folder.layout import LEDGER

    asked: list[tuple[str, dict[str, Any]]] = []
    for word in args.model or ():
        asked.append(_model(word, args))
    asked += [(name, {"pilot": roster.check(name)}) for name in args.pilot or ()]
    if not args.model and (alone := first_set(args, MODEL)):
        raise UsageError(f"{alone.flag} goes with --model PROVIDER/NAME")
    commanders = argparse.Namespace(command="hierarchical", commander=args.commander, commander_url=args.commander_url)
    commanded = commanded_by(commanders) if args.commander else {}
    if args.commander and "hierarchical" not in (args.command or ()):
        raise UsageError(
            "--commander goes with --command hierarchical (in a study --hold command=hierarchical); add it or leave"
            " --commander out"
        )
    accounts = Accounts(
        cost_limit_usd=None if args.cost_limit is None else cost_limit(args.cost_limit),
        token_limit=None if args.token_limit is None else token_limit(args.token_limit),
        ledger=str(out / LEDGER),
        cache=str(args.cache) if args.cache else None,
    )
    factor = speed(args.speed)
    found = []
    for name, who in asked:
        pays = "model" in who or "commander" in commanded
        looks = "model" in who or roster.looks(who["pilot"]) or "commander" in commanded
        flight = FlightSpec(
            **who,
            **commanded,
            simulated=Simulated(speed=factor, rendered=args.rendered or looks or factor is not None),
            accounts=accounts if pays else replace(accounts, ledger=None),
            prompt=template_of(args.prompt) if args.prompt else None,
            parser=args.parser,
            stop_unreadable=args.stop_unreadable,
            disturbances=disturbances_of(args),
            seed=args.seed,
            full=args.full,
        )
        found += [(name, replace(flight, agent=agent)) for agent in dict.fromkeys(args.agent or (PAPER,))]
    return found


def _model(word: Any, args: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """Return a model's name for folders, and its field of a flight; a table says what the options say otherwise."""
    from foundation.errors import UsageError

    if isinstance(word, str):
        model = model_of(word, args)
        return model.title, {"model": model}
    if stray := next((key for key in word if key not in ROW), None):
        raise UsageError(f"a model of the file has '{stray}', which is none of {', '.join(ROW)}")
    if not isinstance(word.get("name"), str):
        raise UsageError('a model of the file that is a table wants a name = "PROVIDER/NAME"')
    given = {option.name: getattr(args, option.name) for option in MODEL}
    own = {name: str(word[name]) for name in given if name in word}
    if "reasoning" in word:
        own["reasoning_effort"] = str(word["reasoning"])
    for option in MODEL:
        if option.choices and own.get(option.name, option.choices[0]) not in option.choices:
            wanted = f"wants one of {', '.join(option.choices)}, got '{own[option.name]}'"
            raise UsageError(f"{option.name} of {word['name']} {wanted}")
    model = model_of(word["name"], argparse.Namespace(**{**given, **own}))
    return str(word.get("called", model.title)), {"model": model}
