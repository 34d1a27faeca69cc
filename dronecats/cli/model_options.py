"""The options that say of a model what its row says, or says otherwise: shared by the verbs that open one."""

import argparse
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dronecats.agent.models.spec import ModelSpec

# as argparse has them
OPTIONS = ("base_url", "axis", "schema", "temperature", "top_p", "max_tokens", "reasoning_effort")


def add_options(group: "argparse._ActionsContainer") -> None:
    """Declare the options, none of which has a value unless it is given."""
    group.add_argument("--base-url", metavar="URL", help="where the model is served, http://HOST:PORT/v1")
    group.add_argument("--axis", choices=("xy", "yx"), help="the order in which the model points (its row's, or xy)")
    group.add_argument(
        "--schema", choices=("object", "array", "none"), help="the root of the schema that replies are held to"
    )
    group.add_argument("--temperature", metavar="X", help="of the sampling (its row's, or 0.4); none sends none")
    group.add_argument("--top-p", metavar="X", help="of the sampling (its row's, or the provider's)")
    group.add_argument("--max-tokens", metavar="N", help="of a reply, reasoning included (its row's, or 8192)")
    group.add_argument(
        "--reasoning-effort", metavar="WORD", help="on every step but the one after a think: the vendor's word, as low"
    )


def add_accounts(group: "argparse._ActionsContainer") -> None:
    """Declare what a model may cost."""
    group.add_argument("--cost-limit", metavar="USD", help="with --model: land when so much is spent")
    group.add_argument("--token-limit", metavar="N", help="with --model: land when so many are spent")
    group.add_argument("--cache", type=Path, metavar="FILE", help="with --model: replies kept, and not asked for twice")


def add_manners(group: "argparse._ActionsContainer") -> None:
    """Declare how a pilot is asked and read, and who commands it."""
    group.add_argument("--prompt", type=Path, metavar="FILE", help="another prompt template")
    group.add_argument(
        "--parser", choices=("strict", "lenient"), help="how replies are read, see docs/replies.md (default strict)"
    )
    group.add_argument(
        "--stop-unreadable", type=int, metavar="N",
        help="end a flight as an error when N replies in a row are no actions (default: never)",
    )  # fmt: skip
    group.add_argument("--commander", metavar="NAME", help="of a hierarchy; or scripted:divide, no model")
    group.add_argument("--commander-url", metavar="URL", help="where that is served")


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


def told(spec: "ModelSpec") -> str:
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
