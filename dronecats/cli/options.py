"""Declares the options of flights, and the options of browser pages.

An `Option` defines the command-line option, the key of the same name in benchmark and study files, and whether it
applies to simulated or connected vehicles. `dronecats/flight/spec/disturbances.py` declares the disturbances. An option
that is not given has no value, so that a file or a recorded flight can set it.
"""

import argparse
import json
import re
import threading
import webbrowser
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dronecats.agent.models import rows
from dronecats.agent.models.spec import PROVIDERS, ModelSpec, with_effort
from dronecats.flight.spec.disturbances import DECLARED, Disturbance, DisturbanceOption
from dronecats.view.live.opening import WantedPage
from dronecats.view.scene import page_hosts
from foundation import extras
from foundation.errors import UsageError
from foundation.signing import load_key
from foundation.typed_file import fields_of, typed

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import Accounts

PAGE_PORT = 8090  # above the ports of simulated cameras, which begin at 8080
FileType = Literal["a word", "a number", "a whole number", "true or false", "a word or a table"]
FILE_TYPES: dict[FileType, tuple[type, ...]] = {
    "a word": (str, int, float),
    "a number": (int, float),
    "a whole number": (int,),
    "true or false": (bool,),
    "a word or a table": (str, dict),
}
OF_KIND: dict[type, FileType] = {bool: "true or false", int: "a whole number", float: "a number"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """A command-line option, and the key of the same name in a file."""

    name: str  # "frame_delay" for --frame-delay
    help: str
    metavar: str | None = None
    kind: type = str  # type of the value on the command line; bool: a switch
    file: FileType | None = None  # type of the value in a file; None: it follows from `kind`
    choices: tuple[str, ...] = ()
    many: bool = False  # takes several values
    repeated: bool = False  # may be given several times
    vehicle: Literal["--sitl", "--connect"] | None = None  # the only vehicle that the option applies to; None: both
    replay: Literal["may change", "as recorded"] | None = None  # whether a replay of a flight may change the value
    beside_spec: bool = False  # allowed together with --spec FILE

    @property
    def flag(self) -> str:
        """The option on the command line, for example --frame-delay."""
        return f"--{self.name.replace('_', '-')}"

    def read(self, value: Any) -> Any:
        """Return a value from a file as the option's value. Raises ValueError; its text names the wanted type."""
        wanted = self.file or OF_KIND.get(self.kind, "a word")
        types = FILE_TYPES[wanted]
        if self.many or self.repeated:
            values = value if isinstance(value, list) else [value]
            types = (str,) if wanted == "a word" else types
            if not values or not all(_is(item, types) for item in values):
                raise ValueError(f"a list of {'numbers' if wanted == 'a number' else 'words'}")
            return [str(item) for item in values] if wanted == "a number" else values
        if not _is(value, types):
            raise ValueError(wanted)
        if self.choices and value not in self.choices:
            raise ValueError(f"one of {', '.join(self.choices)}")
        return str(value) if wanted == "a word" else value


def _is(value: Any, types: tuple[type, ...]) -> bool:
    return isinstance(value, types) and isinstance(value, bool) == (types == (bool,))


def add(group: "argparse._ActionsContainer", options: Iterable[Option]) -> None:
    """Add options to an argparse group."""
    for option in options:
        keywords: dict[str, Any] = {"help": option.help}
        if option.kind is bool:
            keywords["action"] = "store_true"
        else:
            keywords |= {"metavar": option.metavar, "type": option.kind, "choices": option.choices or None}
        if option.many:
            keywords |= {"action": "extend", "nargs": "+"}
        if option.repeated:
            keywords["action"] = "append"
        group.add_argument(option.flag, **keywords)


def is_set(value: Any) -> bool:
    """Return whether an option was given; 0 is a valid value."""
    return value is not None and value is not False and value != []


def first_set(args: argparse.Namespace, options: Iterable[Option]) -> Option | None:
    """Return the first of these options that was given; None if none was."""
    return next((option for option in options if is_set(getattr(args, option.name))), None)


MODEL = (
    Option(
        name="base_url", metavar="URL", help="where the model is served, http://HOST:PORT/v1", beside_spec=True,
        replay="as recorded",
    ),
    Option(
        name="axis", choices=("xy", "yx"), help="order of the model's points (default: as in its row, or xy)",
        replay="as recorded",
    ),
    Option(
        name="schema", choices=("object", "array", "none"), help="root of the JSON schema of replies"
            " (default: as in its row)",
        replay="as recorded",
    ),
    Option(
        name="temperature", metavar="X", help="sampling temperature, or none (default: as in its row, or 0.4)",
        replay="as recorded",
    ),
    Option(
        name="top_p", metavar="X", help="sampling top-p (default: as in its row, or"
            " the provider's)", replay="as recorded"
    ),
    Option(
        name="max_tokens", metavar="N", help="limit of a reply, reasoning included (default: as in its row, or 8192)",
        replay="as recorded",
    ),
    Option(
        name="reasoning_effort", metavar="WORD", replay="as recorded",
        help="a word of the vendor, such as low; for every step except the one after a think",
    ),
)  # fmt: skip
ACCOUNTS = (
    Option(
        name="cost_limit", metavar="USD", file="a number", help="with --model: end when this much is spent",
        beside_spec=True,
    ),
    Option(
        name="token_limit", metavar="N", file="a whole number", help="with --model: end when this many tokens are used",
        beside_spec=True,
    ),
    Option(
        name="cache", kind=Path, metavar="FILE", help="with --model: store replies in this file, and reuse them",
        beside_spec=True,
    ),
)  # fmt: skip
REPLIES = (
    Option(name="prompt", kind=Path, metavar="FILE", help="another prompt template", replay="may change"),
    Option(
        name="parser", choices=("strict", "lenient"), help="how replies are read: docs/replies.md (default strict)",
        replay="may change",
    ),
    Option(
        name="stop_unreadable", kind=int, metavar="N", replay="may change",
        help="end the flight as an error after N unreadable replies in a row (default: never)",
    ),
    Option(
        name="commander", metavar="NAME", help="model that commands a fleet, or scripted:divide", replay="as recorded"
    ),
    Option(name="commander_url", metavar="URL", help="where the commander is served", beside_spec=True),
)  # fmt: skip
SIGN = Option(
    name="sign", kind=Path, metavar="KEYFILE", vehicle="--connect",
    help="sign MAVLink messages, and ignore unsigned ones: docs/signing.md",
)  # fmt: skip
AGENT = Option(
    name="agent", metavar="NAME", help="paper (default), steady, or MODULE:NAME: docs/extending.md",
    replay="as recorded",
)  # fmt: skip
COMMAND = Option(
    name="command", choices=("flat", "hierarchical", "solo"), help="how a fleet is commanded: docs/commanding.md",
    vehicle="--sitl", replay="as recorded",
)  # fmt: skip
LATENCY = Option(
    name="latency", metavar="POLICY", replay="may change",
    help="time of a reply: real, fixed:SECONDS … (default real, in lockstep fixed:0.5): docs/latency.md",
)  # fmt: skip


def _help(option: DisturbanceOption, field: Disturbance) -> str:
    if option.choices:
        return f"{option.help}: {', '.join(option.choices)} (default {option.choices[0]})"
    return option.help if option.read or not field.quantity else f"{option.help}; {field.quantity.wanted}"


DISTURBANCES = tuple(
    Option(
        name=option.name, metavar=option.metavar, kind=option.kind, choices=option.choices, vehicle="--sitl",
        replay="may change",
        help=_help(option, field),
    )
    for _, _, field in DECLARED
    if (option := field.option)
)  # fmt: skip
SELECTION = (
    Option(name="suite", repeated=True, metavar="NAME", help="quick, one-drone, commanding, all or v1"),
    Option(name="flights", kind=int, metavar="N", help="flights of each episode, each with its own seed (default 1)"),
    Option(name="seed", kind=int, metavar="S", help="seed of the first flight; the next flights count up (default 0)"),
    Option(name="limit", kind=int, metavar="N", help="fly only the first N episodes"),
    Option(name="shard", metavar="i/n", help="fly the i-th of n parts of the episodes, for one machine of n"),
    Option(name="full", kind=bool, help="fly to the time limit even when the verdict is decided"),
)
PILOTS = (
    Option(
        name="model", many=True, file="a word or a table", metavar="NAME",
        help=f"rows of `dronecats models list`, or PROVIDER/NAME; providers: {', '.join(PROVIDERS)}",
    ),
    Option(name="pilot", many=True, metavar="NAME", help="built-in pilots (not models)"),
    *MODEL,
    *ACCOUNTS,
    *REPLIES,
)  # fmt: skip
PLACE = (
    Option(name="speed", metavar="N|max", help="factor on real time; max (default) is lockstep"),
    Option(name="rendered", kind=bool, help="also render frames for pilots that do not use them"),
    Option(name="jobs", kind=int, metavar="J", help="flights at a time (default: one per core)"),
    Option(name="engine", choices=("local", "ray"), help="this machine (default), or a Ray cluster"),
    Option(name="address", metavar="HOST:PORT", help="with --engine ray: the cluster (default: a new one here)"),
    Option(name="out", kind=Path, metavar="DIR", help="folder; an unfinished one is resumed"),
    Option(name="json", kind=bool, help="end with one JSON object on standard output"),
)
# options of `bench` only
NO_RETRY = Option(name="no_retry", kind=bool, help="do not retry flights that did not move: docs/bench.md")
MATRIX = (
    replace(AGENT, many=True),
    replace(COMMAND, many=True, choices=(), metavar="HOW", help="for fleets: flat (default), hierarchical, solo"),
    replace(LATENCY, many=True),
    Option(
        name="rate", many=True, file="a number", metavar="HZ", help="control rate: a reply takes 1/HZ seconds"
    ),
)  # fmt: skip
DROP_STALLED = Option(name="drop_stalled", kind=bool, help="leave flights unscored that the host delayed")
# options of `fly`
VEHICLE = (
    Option(name="sitl", kind=bool, help="simulate the vehicle, its autopilot and its camera"),
    Option(name="connect", metavar="URL", help="a vehicle that is running: udpin://0.0.0.0:14540, serial://…"),
    SIGN,
    Option(
        name="camera", metavar="URL", vehicle="--connect", beside_spec=True,
        help="http://, rtsp://, v4l2:0, a video file or a folder",
    ),
    Option(
        name="calibration", kind=Path, metavar="FILE", vehicle="--connect", help="lens of the camera: docs/cameras.md"
    ),
    Option(
        name="world", metavar="EPISODE", vehicle="--connect",
        help="draw this episode or map for a vehicle in a simulator of its own, such as PX4 SITL",
    ),
    Option(
        name="truth", metavar="URL", vehicle="--connect",
        help="with --world: source of the true poses; for PX4 SITL udpin://127.0.0.1:19410",
    ),
    Option(name="arm", kind=bool, vehicle="--connect", help="arm and take off after you confirm"),
    Option(name="dry_run", kind=bool, vehicle="--connect", help="ask the pilot and draw its actions, but move nothing"),
    Option(name="then", choices=("land", "return", "hold"), vehicle="--connect", help="how the flight ends"),
    Option(
        name="envelope", kind=Path, metavar="FILE", replay="may change",
        help="limits of the safety envelope: docs/envelope.md",
    ),
    Option(name="no_envelope", kind=bool, vehicle="--sitl", replay="may change", help="no limits at all"),
    Option(name="instruction", metavar="TEXT", vehicle="--connect", help="the task of the pilot"),
    Option(
        name="target", metavar="LAT,LON[,ALT]", vehicle="--connect", beside_spec=True,
        help="surveyed position of the target: docs/after-flight.md",
    ),
    Option(
        name="target_std", kind=float, metavar="M", vehicle="--connect", beside_spec=True,
        help="with --target: standard deviation per axis (default 3)",
    ),
    Option(name="airframe", metavar="NAME", vehicle="--sitl", replay="may change", help="name or file (default x500)"),
    Option(
        name="optics", kind=Path, metavar="FILE", vehicle="--sitl", replay="may change", help="lens, noise, weather"
    ),
    Option(
        name="depth", kind=bool, vehicle="--sitl", replay="may change",
        help="also give a depth image, to an agent of your own: docs/cameras.md",
    ),
    Option(
        name="autopilot", choices=("ours", "px4"), vehicle="--sitl", replay="may change",
        help="autopilot of the simulated vehicle (default ours)",
    ),
    Option(
        name="px4", metavar="COMMAND", vehicle="--sitl", replay="may change",
        help="with --autopilot px4: command that starts your PX4 (default: wait for one)",
    ),
    Option(
        name="keep_ulog", kind=bool, replay="as recorded",
        help="with --connect or --px4: fetch PX4's log after the flight",
    ),
)  # fmt: skip
PILOT = (
    Option(
        name="pilot", metavar="NAME", replay="as recorded",
        help="built in: vision (default), oracle, noisy, blind:NAME, failing:NAME, recorded:FILE",
    ),
    Option(
        name="model", metavar="NAME",
        help=f"a row of `dronecats models list`, replay:RUN, or PROVIDER/NAME; providers: {', '.join(PROVIDERS)}",
    ),
    *MODEL,
    *ACCOUNTS,  # limits of cost and tokens, and the cache of replies
    Option(
        name="ledger", kind=Path, metavar="FILE", help="with --model: add the cost of this run to this file",
        beside_spec=True,
    ),
    *REPLIES,
    AGENT,
)  # fmt: skip
RUN = (
    Option(
        name="episode", metavar="ID", vehicle="--sitl", replay="may change", beside_spec=True,
        help="id or file (default: go to the cyan SUV)",
    ),
    Option(
        name="drones", kind=int, metavar="N", vehicle="--sitl", replay="as recorded",
        help="drones of a commanding episode, 1 to 8 (default 4)",
    ),
    Option(
        name="speed", metavar="N|max", vehicle="--sitl", replay="may change",
        help="factor on real time (default 1); max is lockstep",
    ),
    Option(
        name="seed", kind=int, vehicle="--sitl", replay="may change",
        help="seed of all random values (default 0)",
    ),
    Option(name="seconds", kind=float, vehicle="--connect", help="length of the flight (default 300)"),
    Option(
        name="patience", kind=float, metavar="S", vehicle="--connect",
        help="end the flight after S seconds without a reply (default 60)",
    ),
    Option(
        name="spec", kind=Path, metavar="FILE", help="repeat the flight of a run.json",
        beside_spec=True,
    ),
    Option(
        name="full", kind=bool, vehicle="--sitl", replay="may change",
        help="fly to the time limit even when the verdict is decided",
    ),
    Option(name="out", kind=Path, metavar="DIR", help="run folder (default runs/TIME-PILOT)", beside_spec=True),
    Option(name="json", kind=bool, help="end with one JSON object on standard output", beside_spec=True),
)  # fmt: skip
FLY = (*VEHICLE, *PILOT, COMMAND, LATENCY, *DISTURBANCES, *RUN)


def add_disturbances(parser: argparse.ArgumentParser) -> None:
    """Declare the disturbances in a separate group."""
    add(parser.add_argument_group("disturbances of a simulated flight (docs/disturbances.md)"), DISTURBANCES)


def with_folder(options: Iterable[Option], folder: str) -> list[Option]:
    """Return the options; the help of --out names `folder` as the default."""
    return [replace(o, help=f"{o.help} (default {folder})") if o.name == "out" else o for o in options]


def key_of(file: Path | None) -> bytes:
    """Return the key in the file of --sign; empty without a file. Raises UsageError."""
    return load_key(file) if file else b""


def speed(text: str) -> float | None:
    """Return the factor on real time of --speed; None for `max`. Raises UsageError."""
    from dronecats.flight.spec.flight_spec import SPEED

    return None if text == "max" else SPEED.read(text)


def level_list(text: str) -> list[str]:
    """Return the items of a comma-separated list."""
    return [word.strip() for word in text.split(",") if word.strip()]


def model_of(word: str, args: argparse.Namespace) -> ModelSpec:
    """Return the model of a row of models.toml or of PROVIDER/NAME, with the options applied. Raises UsageError."""
    return with_options(rows.model_of(word), args)


def with_options(spec: ModelSpec, args: argparse.Namespace) -> ModelSpec:
    """Return a model with the options applied. Raises UsageError for a value that cannot be sent."""
    changed: dict[str, Any] = {}
    if args.base_url:
        changed["base_url"] = args.base_url
    if args.axis:
        changed["axis_order"] = args.axis
    if args.schema:
        changed["schema"] = None if args.schema == "none" else args.schema
    if args.temperature is not None:
        changed["temperature"] = None if args.temperature == rows.NONE else _number("temperature", args.temperature)
    if args.top_p is not None:
        changed["top_p"] = _number("top_p", args.top_p)
    if args.max_tokens is not None:
        changed["max_tokens"] = int(_number("max_tokens", args.max_tokens))
    spec = replace(spec, **changed)
    if args.reasoning_effort is None:
        return spec
    if not re.fullmatch(r"[a-z]{1,20}", args.reasoning_effort):
        wanted = "--reasoning-effort must be a word of the vendor, such as none, low or high"
        raise UsageError(f"{wanted}, got '{args.reasoning_effort:.40}'")
    return with_effort(spec, args.reasoning_effort)


def accounts_of(args: argparse.Namespace, ledger: Path | None) -> "Accounts":
    """Return the cost limits of paid models, and the files of their ledger and reply cache. Raises UsageError."""
    from dronecats.agent.models.ledger import cost_limit, token_limit
    from dronecats.flight.spec.flight_spec import Accounts

    return Accounts(
        cost_limit_usd=None if args.cost_limit is None else cost_limit(args.cost_limit),
        token_limit=None if args.token_limit is None else token_limit(args.token_limit),
        ledger=str(ledger) if ledger else None,
        cache=str(args.cache) if args.cache else None,
    )


def describe_model(spec: ModelSpec) -> str:
    """Return one line about a model: its points, schema, temperature and length of replies."""
    point = "[x, y]" if spec.axis_order == "xy" else "[y, x]"
    schema = f"a schema with an {spec.schema} at its root" if spec.schema else "no schema"
    temperature = "no temperature" if spec.temperature is None else f"temperature {spec.temperature:g}"
    return f"{spec.title}: points are {point}, {schema}, {temperature}, replies of {spec.max_tokens:,} tokens at most"


def _number(name: str, text: str) -> float:
    """Return the number in an option's text. Raises UsageError if the field `name` of ModelSpec does not allow it."""
    try:
        value = json.loads(text)
    except ValueError:
        value = text
    return float(typed(value, fields_of(ModelSpec)[name], f"--{name.replace('_', '-')}"))


def add_exclusions(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare --exclude-above; `what`: plural noun for the items that it leaves out."""
    text = f"leave out {what} whose metric is above N"
    parser.add_argument("--exclude-above", action="append", default=[], metavar="METRIC=N", help=text)


def add_page(group: "argparse._ActionsContainer", prefix: str = "") -> None:
    """Declare the options of a browser page. `prefix` begins their names, for example `view-` in --view-port."""
    text = f"with --{prefix.rstrip('-')}: port of the page" if prefix else "port of the page on this machine"
    group.add_argument(f"--{prefix}port", type=int, metavar="N", help=f"{text} (default {PAGE_PORT})")
    group.add_argument(
        f"--{prefix}host",
        action="append",
        metavar="NAME",
        help="also accept this host name in the page's address, for example a reverse proxy's; may be repeated",
    )


def page_of(args: argparse.Namespace, prefix: str = "") -> tuple[int, tuple[str, ...]]:
    """Return the port of the page, and its host names in addition to the loopback names.

    Raises UsageError for an invalid value, and if the package that serves pages is not installed.
    """
    port, hosts = (getattr(args, f"{prefix}{name}".replace("-", "_")) for name in ("port", "host"))
    port, hosts = PAGE_PORT if port is None else port, tuple(hosts or ())
    if not 1 <= port <= 65535:
        raise UsageError(f"--{prefix}port {port} is not a port. Choose one from 1 to 65535")
    page_hosts.check(hosts, f"--{prefix}host")
    extras.require("viser")
    return port, hosts


def serve(page: Any, line: str, *, browser: bool) -> int:
    """Print a line, open the page in a browser if `browser`, and serve it until Ctrl-C. Return 0."""
    try:
        print(line, flush=True)
        if browser:
            webbrowser.open(page.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        page.close()
    return 0


def add_view(group: "argparse._ActionsContainer") -> None:
    """Declare --view and the options of its page."""
    group.add_argument("--view", action="store_true", help="show the flight live in the browser: docs/watching.md")
    add_page(group, "view-")
    group.add_argument("--view-stay", action="store_true", help="with --view: keep the page afterwards, until Ctrl-C")


def view_of(args: argparse.Namespace) -> WantedPage | None:
    """Return the page of --view; None without --view. Raises UsageError for options that need --view."""
    if not args.view:
        present = {"view-port": args.view_port is not None, "view-host": args.view_host, "view-stay": args.view_stay}
        if stray := next((name for name, is_present in present.items() if is_present), None):
            raise UsageError(f"--{stray} goes with --view. Add it, or leave --{stray} out")
        return None
    port, hosts = page_of(args, "view-")
    return WantedPage(port=port, hosts=hosts, stays=args.view_stay)
