"""The options of the verbs that fly, each declared once.

From a declaration come the option on the command line with its help, the word of that name in the file of a benchmark
or a study with its type, and the vehicle that it goes with. Disturbances are declared in
`dronecats/flight/disturbances.py`. An option that is not given has no value, so that a file or a recorded flight can
set it.
"""

import argparse
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dronecats.agent.models.spec import PROVIDERS
from dronecats.flight.disturbances import DECLARED, UNDISTURBED, Disturbances

if TYPE_CHECKING:
    from dronecats.agent.models.spec import ModelSpec

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
    """An option, and the word of its name in a file."""

    name: str  # "frame_delay" of --frame-delay
    help: str
    metavar: str | None = None
    kind: type = str  # of its value on the command line; bool: a switch
    file: FileType | None = None  # of its value in a file, where it is not that of `kind`
    choices: tuple[str, ...] = ()
    many: bool = False  # takes several values
    repeated: bool = False  # may be said several times
    vehicle: Literal["--sitl", "--connect"] | None = None  # goes with this vehicle only
    replay: Literal["may change", "as recorded"] | None = None  # of a recorded flight
    beside_spec: bool = False  # may stand beside --spec FILE

    @property
    def flag(self) -> str:
        """It as it is typed."""
        return f"--{self.name.replace('_', '-')}"

    def read(self, value: Any) -> Any:
        """Return its value of a file's. Raises ValueError saying what it wants."""
        wanted = self.file or OF_KIND.get(self.kind, "a word")
        types = FILE_TYPES[wanted]
        if self.many or self.repeated:
            values = value if isinstance(value, list) else [value]
            types = (str,) if wanted == "a word" else types
            if not values or not all(_is(each, types) for each in values):
                raise ValueError(f"a list of {'numbers' if wanted == 'a number' else 'words'}")
            return [str(each) for each in values] if wanted == "a number" else values
        if not _is(value, types):
            raise ValueError(wanted)
        if self.choices and value not in self.choices:
            raise ValueError(f"one of {', '.join(self.choices)}")
        return str(value) if wanted == "a word" else value


def _is(value: Any, types: tuple[type, ...]) -> bool:
    return isinstance(value, types) and isinstance(value, bool) == (types == (bool,))


def add(group: "argparse._ActionsContainer", options: Iterable[Option]) -> None:
    """Declare options to argparse."""
    for option in options:
        words: dict[str, Any] = {"help": option.help}
        if option.kind is bool:
            words["action"] = "store_true"
        else:
            words |= {"metavar": option.metavar, "type": option.kind, "choices": option.choices or None}
        if option.many:
            words |= {"action": "extend", "nargs": "+"}
        if option.repeated:
            words["action"] = "append"
        group.add_argument(option.flag, **words)


def is_set(value: Any) -> bool:
    """Return whether an option was given; 0 is a valid value."""
    return value is not None and value is not False and value != []


def first_set(args: argparse.Namespace, options: Iterable[Option]) -> Option | None:
    """Return the first of some options that was given."""
    return next((option for option in options if is_set(getattr(args, option.name))), None)


MODEL = (
    Option(name="base_url", metavar="URL", help="where the model is served, http://HOST:PORT/v1", beside_spec=True),
    Option(
        name="axis", choices=("xy", "yx"), help="the order in which the model points (its row's, or xy)",
        replay="as recorded",
    ),
    Option(
        name="schema", choices=("object", "array", "none"), help="the root of the schema that replies are held to",
        replay="as recorded",
    ),
    Option(
        name="temperature", metavar="X", help="of the sampling (its row's, or 0.4); none sends none",
        replay="as recorded",
    ),
    Option(name="top_p", metavar="X", help="of the sampling (its row's, or the provider's)", replay="as recorded"),
    Option(
        name="max_tokens", metavar="N", help="of a reply, reasoning included (its row's, or 8192)", replay="as recorded"
    ),
    Option(
        name="reasoning_effort", metavar="WORD", replay="as recorded",
        help="on every step but the one after a think: the vendor's word, as low",
    ),
)  # fmt: skip
ACCOUNTS = (
    Option(
        name="cost_limit", metavar="USD", file="a number", help="with --model: land when so much is spent",
        beside_spec=True,
    ),
    Option(
        name="token_limit", metavar="N", file="a whole number", help="with --model: land when so many are spent",
        beside_spec=True,
    ),
    Option(
        name="cache", kind=Path, metavar="FILE", help="with --model: replies kept, and not asked for twice",
        beside_spec=True,
    ),
)  # fmt: skip
REPLIES = (
    Option(name="prompt", kind=Path, metavar="FILE", help="another prompt template", replay="may change"),
    Option(
        name="parser", choices=("strict", "lenient"), help="how replies are read, see docs/replies.md (default strict)",
        replay="may change",
    ),
    Option(
        name="stop_unreadable", kind=int, metavar="N", replay="may change",
        help="end a flight as an error when N replies in a row are no actions (default: never)",
    ),
    Option(
        name="commander", metavar="NAME", help="of a hierarchy; or scripted:divide, no model", replay="as recorded"
    ),
    Option(name="commander_url", metavar="URL", help="where that is served", beside_spec=True),
)  # fmt: skip
AGENT = Option(
    name="agent", metavar="NAME", help="paper (default), steady, or MODULE:NAME: docs/extending.md",
    replay="as recorded",
)  # fmt: skip
COMMAND = Option(
    name="command", choices=("flat", "hierarchical", "solo"), help="who decides for a fleet: docs/commanding.md",
    vehicle="--sitl", replay="as recorded",
)  # fmt: skip
LATENCY = Option(
    name="latency", metavar="POLICY", replay="may change",
    help="what a reply takes: real, fixed:SECONDS …; default real, in lockstep fixed:0.5: docs/latency.md",
)  # fmt: skip
DISTURBANCES = tuple(
    Option(
        name=option.name, metavar=option.metavar, kind=option.kind, vehicle="--sitl", replay="may change",
        help=option.help if option.read or not each.quantity else f"{option.help}; {each.quantity.wanted}",
    )
    for _, _, each in DECLARED
    if (option := each.option)
)  # fmt: skip
# of the verbs that fly many episodes
PART = (
    Option(name="suite", repeated=True, metavar="NAME", help="quick, one-drone, commanding, all or v1"),
    Option(name="flights", kind=int, metavar="N", help="of each episode, on seeds of their own (default 1)"),
    Option(name="seed", kind=int, metavar="S", help="of the first flight; the next have the next (default 0)"),
    Option(name="limit", kind=int, metavar="N", help="the first N episodes only"),
    Option(name="shard", metavar="i/n", help="the i-th of n parts of them, for one machine of n"),
    Option(name="full", kind=bool, help="fly to the cap even when the verdict is decided"),
)
PILOTS = (
    Option(
        name="model", many=True, file="a word or a table", metavar="NAME",
        help=f"rows of `dronecats models list`, or PROVIDER/NAME, of {', '.join(PROVIDERS)}",
    ),
    Option(name="pilot", many=True, metavar="NAME", help="built-in pilots, which are no models"),
    *MODEL,
    *ACCOUNTS,
    *REPLIES,
)  # fmt: skip
PLACE = (
    Option(name="speed", metavar="N|max", help="factor on real time; max (default) is lockstep"),
    Option(name="rendered", kind=bool, help="draw the frames for pilots that do not look, too"),
    Option(name="jobs", kind=int, metavar="J", help="flights in the air at a time (default: one per core)"),
    Option(name="engine", choices=("local", "ray"), help="this machine (default), or a Ray cluster"),
    Option(name="address", metavar="HOST:PORT", help="with --engine ray: of the cluster (default: one here)"),
    Option(name="out", kind=Path, metavar="DIR", help="folder, gone on with"),
    Option(name="json", kind=bool, help="end with one JSON object on standard output"),
)


def add_disturbances(parser: argparse.ArgumentParser) -> None:
    """Declare what is done to a flight on purpose, in a group of its own."""
    add(parser.add_argument_group("disturbances, of what is simulated (docs/disturbances.md)"), DISTURBANCES)


def with_folder(options: Iterable[Option], folder: str) -> list[Option]:
    """Return options with the folder that --out is unless it is given in its help."""
    return [replace(each, help=f"{each.help} (default {folder})") if each.name == "out" else each for each in options]


def disturbances_of(args: argparse.Namespace, base: Disturbances = UNDISTURBED) -> Disturbances:
    """Return what the options say, over what `base` has. Raises UsageError for what cannot be."""
    values = {option.name: getattr(args, option.name) for option in DISTURBANCES}
    return base.with_options({name: value for name, value in values.items() if value is not None})


def add_sign(group: "argparse._ActionsContainer", when: str = "") -> None:
    """Declare --sign KEYFILE; `when` begins its help where it goes with another option only."""
    more = "sign MAVLink messages, believe no others: docs/signing.md"
    add(group, [Option(name="sign", kind=Path, metavar="KEYFILE", help=f"{when}{more}")])


def key_of(file: Path | None) -> bytes:
    """Return the key in the file of --sign, empty without one. Raises UsageError."""
    from foundation.signing import load_key

    return load_key(file) if file else b""


def speed(text: str) -> float | None:
    """Return the factor on real time of --speed; None for `max`. Raises UsageError."""
    from dronecats.flight.spec.flight_spec import SPEED

    return None if text == "max" else SPEED.read(text)


def level_list(text: str) -> list[str]:
    """Return the words of a list with commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def model_of(word: str, args: argparse.Namespace) -> "ModelSpec":
    """Return the model of a row's name or PROVIDER/NAME, with what the options say otherwise. Raises UsageError."""
    from dronecats.agent.models.rows import model_of

    return with_options(model_of(word), args)


def with_options(spec: "ModelSpec", args: argparse.Namespace) -> "ModelSpec":
    """Return a model with what the options say otherwise. Raises UsageError for a value that cannot be sent."""
    from dronecats.agent.models.spec import with_effort

    changed: dict[str, Any] = {}
    if args.base_url:
        changed["base_url"] = args.base_url
    if args.axis:
        changed["axis_order"] = args.axis
    if args.schema:
        changed["schema"] = None if args.schema == "none" else args.schema
    if args.temperature is not None:
        changed["temperature"] = _temperature(args.temperature)
    if args.top_p is not None:
        changed["top_p"] = float(_stated("top_p", args.top_p))
    if args.max_tokens is not None:
        changed["max_tokens"] = int(_stated("max_tokens", args.max_tokens))
    spec = replace(spec, **changed)
    return with_effort(spec, _effort(args.reasoning_effort)) if args.reasoning_effort else spec


def describe_model(spec: "ModelSpec") -> str:
    """Return in one line what is declared of a model that decides how it is asked and read."""
    point = "[x, y]" if spec.axis_order == "xy" else "[y, x]"
    schema = f"a schema with an {spec.schema} at its root" if spec.schema else "no schema"
    temperature = "no temperature" if spec.temperature is None else f"temperature {spec.temperature:g}"
    return f"{spec.title}: points are {point}, {schema}, {temperature}, replies of {spec.max_tokens:,} tokens at most"


def _temperature(text: str) -> float | None:
    from dronecats.agent.models.rows import NONE

    return None if text == NONE else _stated("temperature", text)


def _stated(name: str, text: str) -> float:
    """Return the number that an option states. Raises UsageError for one that a model cannot have."""
    from dronecats.agent.models.spec import ModelSpec
    from foundation.typed_file import fields_of, typed

    try:
        value = json.loads(text)
    except ValueError:
        value = text
    return float(typed(value, fields_of(ModelSpec)[name], f"--{name.replace('_', '-')}"))


def _effort(text: str) -> str:
    from foundation.errors import UsageError

    if not re.fullmatch(r"[a-z]{1,20}", text):
        raise UsageError(f"--reasoning-effort wants the vendor's word for it, as none, low or high, got '{text:.40}'")
    return text
