"""From the words of `dronecats bench`, and a file of the same words, to the runs of a benchmark."""

import argparse
import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.disturbance_options import disturbances_of
from dronecats.cli.model_options import OPTIONS, model_of
from dronecats.flight import disturbances

if TYPE_CHECKING:
    from dronecats.agent.latency import LatencyPolicy
    from dronecats.bench.matrix import BenchEntry, ChosenSuite
    from dronecats.flight.spec.flight_spec import FlightSpec

# what a file may say, and of which kind it is there; each is the option of that name
LISTS = ("suite", "episodes", "model", "pilot", "agent", "command", "latency", "rate")
DISTURBED = {each.name: each.kind for each in disturbances.OPTIONS}
NUMBERS = ("cost_limit", *(name for name, kind in DISTURBED.items() if kind is float))
COUNTS = ("flights", "jobs", "limit", "seed", "token_limit", "stop_unreadable")
WORDS = ("address", "parser", "commander", "commander_url", "engine", "speed", "shard", *OPTIONS,
         *(name for name, kind in DISTURBED.items() if kind is str))  # fmt: skip
CHOICES = {
    "axis": ("xy", "yx"),
    "schema": ("object", "array", "none"),
    "parser": ("strict", "lenient"),
    "engine": ("local", "ray"),
}
PATHS = ("out", "cache", "prompt")
SWITCHES = ("full", "rendered", "no_retry", "drop_stalled", "json")
KNOWN = (*LISTS, *NUMBERS, *COUNTS, *WORDS, *PATHS, *SWITCHES)
ROW = ("name", "called", "reasoning", *OPTIONS)  # of a model that is a table; reasoning is reasoning_effort, shorter
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
        given = getattr(args, name)
        if given is None or given is False or given == []:  # a nought is a word like any other
            setattr(args, name, Path(value) if name in PATHS else value)
    for name, most in MOST.items():
        value = getattr(args, name)
        if value is not None and not 1 <= value <= most:
            raise UsageError(f"--{name} wants 1 to {most}, got {value}")
    return args


def read(path: Path) -> dict[str, Any]:
    """Return what a file says, by option. Raises UsageError naming the file, the word and what it should be."""
    return checked(path, toml(path), KNOWN)


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

    def wants(what: str) -> UsageError:
        return UsageError(f"{path}: {name} wants {what}, got {value!r:.60}")

    if name in LISTS:
        each = value if isinstance(value, list) else [value]
        good: tuple[type, ...] = (int, float) if name == "rate" else (str, dict) if name == "model" else (str,)
        if not each or not all(isinstance(one, good) and not isinstance(one, bool) for one in each):
            raise wants("a list of numbers" if name == "rate" else "a list of words")
        if name == "latency":
            return [from_folder(one, path.parent) for one in each]
        return [str(one) for one in each] if name == "rate" else each
    if name in SWITCHES and not isinstance(value, bool):
        raise wants("true or false")
    if name in COUNTS and (not isinstance(value, int) or isinstance(value, bool)):
        raise wants("a whole number")
    if name in NUMBERS and (not isinstance(value, int | float) or isinstance(value, bool)):
        raise wants("a number")
    if name in (*WORDS, *PATHS) and not isinstance(value, str | int | float):
        raise wants("a word")
    if name in CHOICES and value not in CHOICES[name]:
        raise wants(f"one of {', '.join(CHOICES[name])}")
    return str(value) if name in (*WORDS, *PATHS) else value


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
    from dronecats.flight.spec.flight_spec import LATENCY
    from dronecats.flight.spec.latency_trace import latency_policy
    from foundation.errors import UsageError

    if args.rate and args.latency:
        raise UsageError("--rate pins what a reply takes, and --latency says it otherwise; leave one of them out")
    if args.rate:
        return [latency_policy(f"rate:{rate}") for rate in args.rate]
    return [latency_policy(text) for text in args.latency or [LATENCY if args.speed == "max" else "real"]]


def pilots(args: argparse.Namespace, out: Path) -> "list[tuple[str, FlightSpec]]":
    """Return each pilot's name and flight by each agent, but for episode, command and latency."""
    from dronecats.agent.models.budget import cost_limit, token_limit
    from dronecats.agent.names import PAPER
    from dronecats.cli.fly_spec import commanded_by, template_of
    from dronecats.cli.speed import speed
    from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
    from dronecats.pilots import roster
    from foundation.errors import UsageError
    from foundation.run_folder.layout import LEDGER

    asked: list[tuple[str, dict[str, Any]]] = []
    for word in args.model or ():
        asked.append(_model(word, args))
    asked += [(name, {"pilot": roster.check(name)}) for name in args.pilot or ()]
    if not args.model and (alone := next((name for name in OPTIONS if getattr(args, name) is not None), None)):
        raise UsageError(f"--{alone.replace('_', '-')} goes with --model PROVIDER/NAME")
    commanders = argparse.Namespace(command="hierarchical", commander=args.commander, commander_url=args.commander_url)
    commanded = commanded_by(commanders) if args.commander else {}
    if args.commander and "hierarchical" not in (args.command or ()):
        raise UsageError("--commander goes with --command hierarchical; add it or leave --commander out")
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
    given = {name: getattr(args, name) for name in OPTIONS}
    own = {name: str(word[name]) for name in OPTIONS if name in word}
    if "reasoning" in word:
        own["reasoning_effort"] = str(word["reasoning"])
    if wrong := next((name for name, value in own.items() if value not in CHOICES.get(name, (value,))), None):
        raise UsageError(f"{wrong} of {word['name']} wants one of {', '.join(CHOICES[wrong])}, got '{own[wrong]}'")
    model = model_of(word["name"], argparse.Namespace(**{**given, **own}))
    return str(word.get("called", model.title)), {"model": model}
