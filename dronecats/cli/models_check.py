"""`dronecats models check NAME`: ask a model for the point of a mark, and say what came back."""

import argparse
import json
from typing import TYPE_CHECKING, Any

from dronecats.agent.models.model import ending_reason
from dronecats.cli.options import MODEL, add, describe_model, model_of

if TYPE_CHECKING:
    from dronecats.agent.models.probe import ProbeResult

REPLY_SHOWN = 120  # characters


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("check", help="send one small picture, and say what came back: some cents at most")
    parser.add_argument("model", metavar="NAME", help="a row's name, or PROVIDER/NAME")
    add(parser, MODEL)
    parser.add_argument("--parser", choices=("strict", "lenient"), default="strict", help="how replies are read")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Ask; status 0 when the model can fly, 1 when its points cannot be used, 3 when its endpoint fails."""
    from dronecats.agent.models.probe import probe
    from dronecats.agent.models.wire_formats import open_model

    spec = model_of(args.model, args)
    model = open_model(spec)
    try:
        result = probe(model, spec, args.parser)
    finally:
        model.close()
    if args.json:
        print(json.dumps(as_json(result)))
        return 0 if result.order_is_right else 1
    print(describe_model(spec))
    for asked in result.answers:
        reply = asked.reply
        tokens = f"{_count(reply.tokens_in)} tokens in, {_count(reply.tokens_out)} out"
        said = " ".join(reply.text.split())
        print(f"\n{asked.question}: {reply.latency_s:.2f} s, {tokens}")
        print(f"  {said[:REPLY_SHOWN]}{'…' if len(said) > REPLY_SHOWN else ''}" if said else "  (an empty reply)")
        if why := ending_reason(reply.finish, reply.tokens_out):
            print(f"  {why}")
    print()
    for line in findings(result):
        print(line)
    return 0 if result.order_is_right else 1


def findings(result: "ProbeResult") -> list[str]:
    """Return what the replies come to, a sentence each."""
    spec, cost = result.spec, result.cost_usd
    lines = [_pointing(result), f"Schema: {_SCHEMA[result.enforced]}."]
    whys = (ending_reason(asked.reply.finish, asked.reply.tokens_out) for asked in result.answers)
    lines += [f"Unfinished: {why}." for why in dict.fromkeys(whys) if why]
    tokens_in, tokens_out = result.tokens
    known = f"${cost:.6f}" if cost is not None else "not known: its row has no prices, or the endpoint told no tokens"
    lines.append(
        f"Cost of these {len(result.answers)}: {known} ({_count(tokens_in)} tokens in, {_count(tokens_out)} out)."
    )
    if result.too_long:
        lines.append(f"Too long: such a question and a reply of {spec.max_tokens} exceed {spec.context_tokens} tokens.")
    lines.append("It can fly." if result.order_is_right else "It cannot fly like this.")
    return lines


def as_json(result: "ProbeResult") -> dict[str, Any]:
    """Return what came back as JSON values."""
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
                "what": asked.question,
                "pointed": asked.order,
                "reply": asked.reply.text,
                "latency_s": asked.reply.latency_s,
                "tokens_in": asked.reply.tokens_in,
                "tokens_out": asked.reply.tokens_out,
                "finish": asked.reply.finish,
            }
            for asked in result.answers
        ],
    }


_SCHEMA = {
    None: "none is sent",
    True: "enforced, the reply kept to it although it was asked for something else",
    False: "NOT enforced, the reply was none that it allows",
}
_POINTING = {
    "as declared": "it points in the order that is declared, either way",
    "always [x, y]": "it always points as [x, y], whatever is declared",
    "always [y, x]": "it always points as [y, x], whatever is declared",
    "as not declared": "it points in the other order than the declared one, either way",
    "not at all": "it did not point at the mark",
}


def _pointing(result: "ProbeResult") -> str:
    said = f"Points: {_POINTING[result.pointing]}"
    if result.order_is_right or not result.pointing.startswith("always"):
        return f"{said}."
    return f"{said}: fly it with --axis {'xy' if result.pointing == 'always [x, y]' else 'yx'}, or say so in its row."


def _count(tokens: int | None) -> str:
    return "?" if tokens is None else str(tokens)
