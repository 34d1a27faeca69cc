"""`dronecats models list`: one line per model that is known by name."""

import argparse
import json
import os
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import show

if TYPE_CHECKING:
    from dronecats.agent.models.rows import ModelRow


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("list", help="one line per model that is known by name")
    parser.add_argument(
        "--endpoint", metavar="URL", help="a PROVIDER or an address: the models that its server lists instead"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the rows, or the models that a server lists."""
    from dronecats.agent.models.rows import rows
    from dronecats.report.table import numbers, table_of, words

    if args.endpoint:
        names = listed(args.endpoint)
        print(json.dumps({"endpoint": args.endpoint, "models": names}) if args.json else "\n".join(names))
        return 0
    known = [as_json(row) for row in rows().values()]
    if args.json:
        print(json.dumps({"models": known}))
        return 0
    files = list(dict.fromkeys(row["file"] for row in known))
    columns = [*map(words, ("name", "model", "points", "schema")), numbers("$ in"), numbers("$ out"), words("key")]
    lines = [(*_line(row), row["file"]) if len(files) > 1 else _line(row) for row in known]
    if len(files) > 1:
        show(table_of([*columns, words("from")], lines))
    else:
        show(table_of(columns, lines, *(f"from: {file}" for file in files)))
    return 0


def listed(endpoint: str) -> list[str]:
    """Return the models that a server lists. Raises UsageError for no address, ModelError where none is listed.

    A server at a provider's own address is asked with that provider's key.
    """
    from dronecats.agent.models.spec import PROVIDERS, ModelSpec
    from dronecats.agent.models.wire_formats import open_model

    url = endpoint.rstrip("/")
    known = next((each for each in PROVIDERS.values() if url in (each.name, each.base_url)), PROVIDERS["local"])
    base_url = None if url == known.name else endpoint
    model = open_model(ModelSpec(provider=known.name, name="models", base_url=base_url))
    try:
        return model.listed()
    finally:
        model.close()


def as_json(row: "ModelRow") -> dict[str, Any]:
    """Return a row as JSON values: what it states, where, and whether its key is set, never the key."""
    from dronecats.agent.models.spec import LOOPBACK, provider_of

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
    key = f"{row['key_variable'] or '-'}{'' if row['key_set'] or not row['key_needed'] else ' (not set)'}"
    return (row["name"], f"{row['provider']}/{row['identifier']}", point, row["schema"], *prices, key)
