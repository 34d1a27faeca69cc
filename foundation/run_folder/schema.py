"""Generates the published JSON Schemas of the run folder's files from the row classes. `make schemas` calls `write`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from foundation.run_folder import layout
from foundation.run_folder.results import Benchmark, Result, Study, Verdict
from foundation.run_folder.rows import (
    ESTIMATE_ROWS,
    TRUTH_ROWS,
    Decision,
    EnvelopeRow,
    EpisodeIdentity,
    Exchange,
    LoggedPrompt,
    Run,
)
from foundation.run_folder.writing import field_names

FOLDER = Path(__file__).with_name("schemas")
DRAFT = "https://json-schema.org/draft/2020-12/schema"
EMPTY = {"type": "object", "maxProperties": 0}
FILES: Mapping[str, tuple[str, tuple[type, ...]]] = {  # name → (title, row classes)
    "run": (layout.RUN, (Run,)),
    "bench": (layout.BENCH, (Benchmark,)),
    "study": (layout.STUDY, (Study,)),
    "decisions": ("A line of decisions.jsonl", (Decision,)),
    "commander": ("A line of commander.jsonl", (Exchange,)),
    "prompts": ("A line of prompts.jsonl", (LoggedPrompt,)),
    "safety": ("A line of safety.jsonl", (EnvelopeRow,)),
    "truth": ("A line of truth.jsonl", tuple(TRUTH_ROWS.values())),
    "estimate": ("A line of estimate.jsonl", tuple(ESTIMATE_ROWS.values())),
    "verdict": (layout.VERDICT, (Verdict,)),
    "identity": (layout.IDENTITY, (EpisodeIdentity,)),
    "result": ("What `dronecats fly --json` prints", (Result,)),
}


def published() -> dict[str, dict[str, Any]]:
    """Return the JSON Schemas by the names of their files."""
    return {f"{name}.schema.json": _schema(title, rows) for name, (title, rows) in FILES.items()}


def text(schema: Mapping[str, Any]) -> str:
    """Return the text of a schema's file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def write() -> None:
    """Write all schema files to FOLDER. Raises OSError."""
    FOLDER.mkdir(exist_ok=True)
    for name, schema in published().items():
        (FOLDER / name).write_text(text(schema), encoding="utf-8")


def _schema(title: str, rows: tuple[type, ...]) -> dict[str, Any]:
    tops, definitions = msgspec.json.schema_components(rows, ref_template="#/$defs/{name}")
    for row in rows:  # in the order of the files; msgspec puts inherited fields first
        definition, names = definitions[row.__name__], field_names(row)
        definition["required"] = [name for name in names if name in definition["required"]]
        definition["properties"] = {name: definition["properties"][name] for name in (*definition["required"], *names)}
    for definition in definitions.values():
        if kind := definition["properties"].pop("kind", None):  # it has a default in the class, but lines must have it
            definition["properties"] = {"kind": {"const": kind["default"]}, **definition["properties"]}
            definition["required"] = ["kind", *definition["required"]]
    if verdict := definitions.get("Verdict"):
        verdict["properties"]["diagnostics"]["anyOf"].append(EMPTY)  # the file has {} for None
    root = dict(next(iter(tops))) if len(rows) == 1 else {"anyOf": list(tops)}
    return {"$schema": DRAFT, "title": title, **root, "$defs": definitions}
