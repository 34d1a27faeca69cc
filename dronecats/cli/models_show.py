"""`dronecats models show NAME`: a row, the model that it comes to, and a request as it would be sent."""

import argparse
import base64
import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from dronecats.cli.options import MODEL, add, describe_model, with_options

if TYPE_CHECKING:
    from dronecats.agent.models.spec import ModelSpec

INSTRUCTION = "go to the cyan SUV"  # of the request that is shown


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("show", help="a row, what it comes to, and a request as it would be sent")
    parser.add_argument("model", metavar="NAME", help="a row's name, or PROVIDER/NAME")
    add(parser, MODEL)
    parser.add_argument("--lifted", action="store_true", help="the request of a step whose reasoning is lifted")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the model; nothing is sent, and no key is needed."""
    from dronecats.agent.models.rows import row_of, rows
    from dronecats.agent.models.spec import spec_of
    from dronecats.cli.models_list import as_json

    row = row_of(args.model, rows())
    spec = with_options(row.spec if row else spec_of(args.model), args)
    shown = request(spec, args.lifted)
    if args.json:
        print(json.dumps({"row": as_json(row) if row else None, "spec": kept(spec), "request": shown}))
        return 0
    print(describe_model(spec))
    print(f"Row {row.name} of {row.file}" if row else _rowless(spec))
    for word in ("source", "note"):
        if row and getattr(row, word):
            print(f"{word.capitalize()}: {getattr(row, word)}")
    print("\nAs run.json keeps it:", json.dumps(kept(spec), indent=2), sep="\n")
    print(f"\nPOST {shown['url']}")
    for name, value in shown["headers"].items():
        print(f"{name}: {value}")
    print(json.dumps(shown["body"], indent=2, ensure_ascii=False))
    return 0


def _rowless(spec: "ModelSpec") -> str:
    """Return what is to be known of a model that has no row."""
    from dronecats.agent.models.spec import provider_of

    provider = provider_of(spec.provider)
    switched = bool(provider.thinking or provider.quick)
    unsaid = "" if switched else "; it reasons as it likes until a row says reasoning_off and reasoning_lifted"
    return f"No row of models.toml: what every model of {provider.name} takes{unsaid}"


def kept(spec: "ModelSpec") -> dict[str, Any]:
    """Return the model as JSON values, its address without what may be a key."""
    from foundation.redaction import redacted_url

    return asdict(replace(spec, base_url=redacted_url(spec.base_url) if spec.base_url else None))


def request(spec: "ModelSpec", lifted: bool) -> dict[str, Any]:
    """Return {url, headers, body} of the first step's request, without key and picture. Raises UsageError."""
    from dronecats.agent.history import History
    from dronecats.agent.models.model import Request
    from dronecats.agent.models.probe import marked_picture
    from dronecats.agent.models.spec import provider_of
    from dronecats.agent.models.wire_formats import open_model
    from dronecats.agent.prompt import Prompt
    from foundation.camera import CameraModel
    from foundation.protocol import HISTORY_LENGTH

    provider = provider_of(spec.provider)
    # with an address given, no key is asked for
    model = open_model(replace(spec, base_url=spec.base_url or provider.base_url))
    jpeg = marked_picture()
    text = Prompt.load().render(INSTRUCTION, History(CameraModel()).render(), HISTORY_LENGTH, spec.axis_order)
    body = model.body(Request(text, (jpeg,), lifted))
    model.close()
    key = {model.key_header.name: f"{model.key_header.before}***"} if provider.key_variable else {}
    return {"url": model.address, "headers": {**model.headers(), **key}, "body": _abbreviated(body, jpeg)}


def _abbreviated(value: Any, jpeg: bytes) -> Any:
    """Return a request's values with a word in the place of the picture."""
    if isinstance(value, dict):
        return {key: _abbreviated(inner, jpeg) for key, inner in value.items()}
    if isinstance(value, list):
        return [_abbreviated(inner, jpeg) for inner in value]
    if isinstance(value, str):
        for code in (base64.b64encode(jpeg), base64.urlsafe_b64encode(jpeg)):
            value = value.replace(code.decode(), f"<{len(jpeg)} bytes of JPEG in base64>")
    return value
