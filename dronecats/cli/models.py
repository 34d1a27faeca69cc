"""Verbs `models` and `prompt`: list, show and check models, and copy a paper's prompt to a file."""

import argparse
import base64
import json
import os
import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.agent.models.model import Request, ending_reason
from dronecats.agent.models.rows import ModelRow, row_of, rows
from dronecats.agent.models.spec import LOOPBACK, PROVIDERS, ModelSpec, provider_of, spec_of
from dronecats.cli.next_commands import print_next
from dronecats.cli.options import MODEL, add, describe_model, is_set, model_of, with_options
from dronecats.cli.output import show
from dronecats.report.table import numbers, table_of, words
from foundation.errors import UsageError
from foundation.protocol import HISTORY_LENGTH
from foundation.redaction import redacted_url
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.agent.models.probe import ProbeResult

INSTRUCTION = "go to the cyan SUV"  # the task in the request that `show` prints
REPLY_SHOWN = 120  # characters of a reply that are printed
SCHEMA_FINDINGS = {
    None: "no schema is sent",
    True: "enforced: the reply follows it, although the question asked for something else",
    False: "NOT enforced: the reply does not follow it",
}
POINTING_FINDINGS = {
    "as declared": "the model follows the declared order, both [x, y] and [y, x]",
    "always [x, y]": "the model always points as [x, y], in both declared orders",
    "always [y, x]": "the model always points as [y, x], in both declared orders",
    "as not declared": "the model always uses the opposite of the declared order",
    "not at all": "the model did not point at the mark",
}


def add_models_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="print one line per model of models.toml")
    listing.add_argument("--endpoint", metavar="URL", help="list the models that this PROVIDER or address serves")
    listing.set_defaults(run=_list)
    showing = actions.add_parser("show", help="print a model's row, its settings, and an example of a request")
    showing.add_argument("model", metavar="NAME", help="a row's name, or PROVIDER/NAME")
    add(showing, MODEL)
    showing.add_argument("--lifted", action="store_true", help="show the request after a think")
    showing.set_defaults(run=_show)
    checking = actions.add_parser(
        "check", help="send questions with one small picture and check the replies; costs a few cents at most"
    )
    checking.add_argument("model", metavar="NAME", help="a row's name, or PROVIDER/NAME")
    add(checking, MODEL)
    checking.add_argument("--parser", choices=("strict", "lenient"), default="strict", help="how replies are read")
    checking.set_defaults(run=_check)
    for action in (listing, showing, checking):
        action.add_argument("--json", action="store_true", help="print one JSON object")


def _list(args: argparse.Namespace) -> int:
    """Print the rows, or the models that a server lists."""
    if args.endpoint:
        names = listed(args.endpoint)
        print(json.dumps({"endpoint": args.endpoint, "models": names}) if args.json else "\n".join(names))
        return 0
    models = [_row_as_json(row) for row in rows().values()]
    if args.json:
        print(json.dumps({"models": models}))
        return 0
    files = list(dict.fromkeys(row["file"] for row in models))
    columns = [
        *map(words, ("name", "model", "points", "schema")),
        numbers("$ in"),
        numbers("$ out"),
        words("key"),
        words("set"),
    ]
    if len(files) > 1:
        show(table_of([*columns, words("from")], ((*_line(row), row["file"]) for row in models)))
    else:
        show(table_of(columns, map(_line, models), *(f"from: {file}" for file in files)))
    return 0


def listed(endpoint: str) -> list[str]:
    """Return the models that a server lists.

    `endpoint` is an address or a provider's name. Only a provider's own address gets that provider's key. Raises
    UsageError for an invalid address, and ModelError if the server sends no list.
    """
    from dronecats.agent.models.wire_formats import open_model

    url = endpoint.rstrip("/")
    provider = next((row for row in PROVIDERS.values() if url in (row.name, row.base_url)), PROVIDERS["local"])
    base_url = None if url == provider.name else endpoint
    model = open_model(ModelSpec(provider=provider.name, name="models", base_url=base_url))
    try:
        return model.listed()
    finally:
        model.close()


def _row_as_json(row: ModelRow) -> dict[str, Any]:
    """Return a row as JSON values: its settings, its file, and whether its key is set. The key is not included."""
    spec, provider = row.spec, provider_of(row.spec.provider)
    variable = provider.key_variable
    return {
        "name": row.name,
        "provider": spec.provider,
        "identifier": spec.name,
        "axis": spec.axis_order,
        "schema": spec.schema or "none",
        "temperature": "none" if spec.temperature is None else spec.temperature,
        "input_usd": spec.input_usd,
        "output_usd": spec.output_usd,
        "context": spec.context_tokens,
        "key_variable": variable,
        "key_needed": bool(variable) and not (provider.base_url or "").startswith(LOOPBACK),
        "key_set": bool(variable and os.environ.get(variable, "").strip()),
        "file": row.file,
        "source": row.source,
        "note": row.note,
    }


def _line(row: dict[str, Any]) -> tuple[str, ...]:
    prices = ("-" if row[price] is None else f"{row[price]:g}" for price in ("input_usd", "output_usd"))
    point = "[x, y]" if row["axis"] == "xy" else "[y, x]"
    is_set = "yes" if row["key_set"] else "no" if row["key_needed"] else "-"
    title = f"{row['provider']}/{row['identifier']}"
    return (row["name"], title, point, row["schema"], *prices, row["key_variable"] or "-", is_set)


def _show(args: argparse.Namespace) -> int:
    """Print the model's settings and an example request. This sends nothing and needs no key."""
    row = row_of(args.model, rows())
    spec = with_options(row.spec if row else spec_of(args.model), args)
    shown = _request(spec, args.lifted)
    if args.json:
        print(json.dumps({"row": _row_as_json(row) if row else None, "spec": _recorded(spec), "request": shown}))
        return 0
    print(describe_model(spec))
    print(f"Row {row.name} of {row.file}" if row else _rowless(spec))
    for word in ("source", "note"):
        if row and getattr(row, word):
            print(f"{word.capitalize()}: {getattr(row, word)}")
    print("\nAs run.json records it:", json.dumps(_recorded(spec), indent=2), sep="\n")
    print(f"\nPOST {shown['url']}")
    for name, value in shown["headers"].items():
        print(f"{name}: {value}")
    print(json.dumps(shown["body"], indent=2, ensure_ascii=False))
    return 0


def _rowless(spec: ModelSpec) -> str:
    provider = provider_of(spec.provider)
    has_switch = bool(provider.thinking or provider.quick)
    note = (
        "" if has_switch else "; its reasoning cannot be switched until a row sets reasoning_off and reasoning_lifted"
    )
    return f"No row of models.toml: the settings of every model of {provider.name}{note}"


def _recorded(spec: ModelSpec) -> dict[str, Any]:
    """Return the model as JSON values. Parts of its address that may be a key are removed."""
    return asdict(replace(spec, base_url=redacted_url(spec.base_url) if spec.base_url else None))


def _request(spec: ModelSpec, lifted: bool) -> dict[str, Any]:
    """Return {url, headers, body} of a flight's first request, without key and picture. `lifted`: with reasoning."""
    from dronecats.agent.models.probe import marked_picture
    from dronecats.agent.models.wire_formats import open_model
    from dronecats.agent.prompt import History, Prompt
    from foundation.camera import CameraModel

    provider = provider_of(spec.provider)
    # with the base_url set, `open_model` does not require the key
    model = open_model(replace(spec, base_url=spec.base_url or provider.base_url))
    jpeg = marked_picture()
    text = Prompt.load().render(INSTRUCTION, History(CameraModel()).render(), HISTORY_LENGTH, spec.axis_order)
    body = model.body(Request(text, (jpeg,), lifted))
    model.close()
    key = {model.key_header.name: f"{model.key_header.before}***"} if provider.key_variable else {}
    return {"url": model.address, "headers": {**model.headers(), **key}, "body": _abbreviated(body, jpeg)}


def _abbreviated(value: Any, jpeg: bytes) -> Any:
    """Return a request's values, in which a note replaces the picture."""
    if isinstance(value, dict):
        return {key: _abbreviated(inner, jpeg) for key, inner in value.items()}
    if isinstance(value, list):
        return [_abbreviated(inner, jpeg) for inner in value]
    if isinstance(value, str):
        for code in (base64.b64encode(jpeg), base64.urlsafe_b64encode(jpeg)):
            value = value.replace(code.decode(), f"<{len(jpeg)} bytes of JPEG in base64>")
    return value


def _check(args: argparse.Namespace) -> int:
    """Probe a model. Return 0 if its points have the declared axis order, else 1; status 3 if its endpoint fails."""
    from dronecats.agent.models.probe import probe
    from dronecats.agent.models.wire_formats import open_model

    spec = model_of(args.model, args)
    model = open_model(spec)
    try:
        result = probe(model, spec, args.parser)
    finally:
        model.close()
    if args.json:
        print(json.dumps(_result_as_json(result)))
        return 0 if result.order_is_right else 1
    print(describe_model(spec))
    for answer in result.answers:
        reply = answer.reply
        tokens = f"{_count(reply.tokens_in)} tokens in, {_count(reply.tokens_out)} out"
        text = " ".join(reply.text.split())
        print(f"\n{answer.question}: {reply.latency_s:.2f} s, {tokens}")
        print(f"  {text[:REPLY_SHOWN]}{'…' if len(text) > REPLY_SHOWN else ''}" if text else "  (an empty reply)")
        if reason := ending_reason(reply.finish, reply.tokens_out):
            print(f"  {reason}")
    print("", *_findings(result), sep="\n")
    if result.order_is_right:
        own = [word for option in MODEL if is_set(value := getattr(args, option.name)) for word in (option.flag, value)]
        print_next("models check", model=[args.model, *own])
    return 0 if result.order_is_right else 1


def _findings(result: "ProbeResult") -> list[str]:
    """Return the conclusions from the replies, one sentence each."""
    spec, cost = result.spec, result.cost_usd
    lines = [_pointing(result), f"Schema: {SCHEMA_FINDINGS[result.enforced]}."]
    reasons = (ending_reason(answer.reply.finish, answer.reply.tokens_out) for answer in result.answers)
    lines += [f"Unfinished: {reason}." for reason in dict.fromkeys(reasons) if reason]
    tokens_in, tokens_out = result.tokens
    usd = f"${cost:.6f}" if cost is not None else "unknown, because prices or token counts are missing"
    lines.append(f"Cost of these {counted(len(result.answers), 'question')}: {usd}.")
    lines.append(f"Tokens: {_count(tokens_in)} in, {_count(tokens_out)} out.")
    if result.too_long:
        lines.append(
            f"Too long: the question and a reply of {spec.max_tokens} tokens exceed {spec.context_tokens} tokens."
            " Lower --max-tokens."
        )
    lines.append("The model can fly." if result.order_is_right else "The model cannot fly with these settings.")
    return lines


def _result_as_json(result: "ProbeResult") -> dict[str, Any]:
    tokens_in, tokens_out = result.tokens
    return {
        "model": result.spec.title,
        "axis": result.spec.axis_order,
        "pointing": result.pointing,
        "schema": result.spec.schema or "none",
        "schema_enforced": result.enforced,
        "tokens_in": tokens_in,
        "tokens_out": tokens_out,
        "cost_usd": result.cost_usd,
        "can_fly": result.order_is_right,
        "asked": [
            {
                "what": answer.question,
                "pointed": answer.order,
                "reply": answer.reply.text,
                "latency_s": answer.reply.latency_s,
                "tokens_in": answer.reply.tokens_in,
                "tokens_out": answer.reply.tokens_out,
                "finish": answer.reply.finish,
            }
            for answer in result.answers
        ],
    }


def _pointing(result: "ProbeResult") -> str:
    finding = f"Points: {POINTING_FINDINGS[result.pointing]}"
    if result.order_is_right or not result.pointing.startswith("always"):
        return f"{finding}."
    return (
        f"{finding}. Fly with --axis {'xy' if result.pointing == 'always [x, y]' else 'yx'}, or set axis in its"
        " row of models.toml."
    )


def _count(tokens: int | None) -> str:
    return "?" if tokens is None else str(tokens)


def add_prompt_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    extract = actions.add_parser("extract", help="copy the prompt of a LaTeX source to a file for --prompt")
    extract.add_argument("source", type=Path, metavar="PAPER.tex", help="LaTeX file with the prompt in a listing")
    extract.add_argument("--out", type=Path, required=True, metavar="FILE", help="prompt template to write")
    extract.set_defaults(run=run_prompt)


def run_prompt(args: argparse.Namespace) -> int:
    """Write the prompt to a file. Raises UsageError if the file exists with other content."""
    from dronecats.agent.prompt import Prompt, prompt_listing

    try:
        source = args.source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the LaTeX source {args.source} cannot be read: {error}") from None
    template = prompt_listing(source, str(args.source))
    try:
        if args.out.exists() and args.out.read_text(encoding="utf-8") != template:
            raise UsageError(f"{args.out} exists and has other content. Choose another --out")
        args.out.write_text(template, encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--out {args.out} cannot be written: {error}") from None
    prompt = Prompt(template)
    print(f"{args.out}: {len(template):,} characters, prompt {prompt.name}, digest {prompt.digest[:8]}")
    print(f"Fly with it: add --prompt {shlex.quote(str(args.out))} to a command with --model NAME")
    rows_with_key = [row for row in map(_row_as_json, rows().values()) if row["key_needed"] and row["key_set"]]
    if rows_with_key:
        print_next("prompt extract", model=rows_with_key[0]["name"], prompt=args.out)
    return 0
