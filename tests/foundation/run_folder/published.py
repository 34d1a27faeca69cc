"""Validates every line of the files of a run folder against the published schemas."""

import json
from functools import cache
from pathlib import Path

import jsonschema

from foundation.run_folder import layout
from foundation.run_folder.schema import FOLDER

OF = {
    layout.RUN: "run",
    layout.DECISIONS: "decisions",
    layout.COMMANDER: "commander",
    layout.PROMPTS: "prompts",
    layout.TRUTH: "truth",
    layout.ESTIMATE: "estimate",
    layout.VERDICT: "verdict",
}


@cache
def validator(name: str) -> jsonschema.Draft202012Validator:
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def check(file: Path) -> int:
    """Validate a file of a run folder, and return the number of values in it."""
    text = file.read_text()
    values = [json.loads(line) for line in text.splitlines()] if file.suffix == ".jsonl" else [json.loads(text)]
    for value in values:
        validator(OF[file.name]).validate(value)
    return len(values)
