"""Models by name: the rows of the built-in models.toml and of the user's own file, validated when read."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from dronecats.agent.models.spec import PROVIDERS, ModelSpec, Text, provider_of, spec_of
from foundation.errors import UsageError
from foundation.typed_file import fields_of, file_bytes, no_choice, toml_of, typed, unknown_key_message
from foundation.wording import did_you_mean, nearest

OWN_FILE = "DRONECATS_MODELS"  # environment variable: the user's file
SHIPPED = "models.toml"
INTEGER_MAX = 2**63 - 1  # every JSON reader accepts integers up to this
NONE = "none"  # a key with this value: requests do not send the setting
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRow:
    """One model of the table."""

    name: str
    spec: ModelSpec
    file: str  # the file with the row; the user's file if both files have one
    source: str | None = None  # source of the prices
    note: str | None = None  # advice for users


# key of a row → field of ModelSpec
KEYS = {
    "provider": "provider", "identifier": "name", "base_url": "base_url", "axis": "axis_order", "schema": "schema",
    "temperature": "temperature", "top_p": "top_p", "top_k": "top_k", "max_tokens": "max_tokens",
    "tokens_field": "tokens_field", "reasoning_off": "quick", "reasoning_lifted": "thinking", "input_usd": "input_usd",
    "output_usd": "output_usd", "context": "context_tokens",
}  # fmt: skip
NOTES = ("source", "note")  # for people, never sent
MAY_BE_NONE = ("schema", "temperature")  # keys that may be "none"
NEEDED = ("provider", "identifier")
PRICES = ("input_usd", "output_usd")


def rows() -> dict[str, ModelRow]:
    """Return the rows by name, the built-in ones first. The user's file may change single keys of a built-in row.

    Raises UsageError with file, row and key.
    """
    shipped = files("dronecats.agent.models").joinpath(SHIPPED).read_bytes()
    tables = _tables(shipped, SHIPPED)
    for name, (where, stated) in _own().items():
        before = tables[name][1] if name in tables else {}
        if any(price in stated for price in PRICES):
            before = {key: value for key, value in before.items() if key != "source"}
        tables[name] = (where, {**before, **stated})
    return {name: _row(name, table, where) for name, (where, table) in tables.items()}


def own_file() -> Path | None:
    """Return the path of the user's file, which need not exist; None for a user without a home folder."""
    try:
        if path := os.environ.get(OWN_FILE):
            return Path(path).expanduser()
        config = os.environ.get("XDG_CONFIG_HOME")
        return (Path(config) if config else Path.home() / ".config") / "dronecats" / SHIPPED
    except RuntimeError:  # the user id has no home folder
        return None


def row_of(word: str, known: Mapping[str, ModelRow]) -> ModelRow | None:
    """Return the row with this name, or with the identifier PROVIDER/NAME; None for an unknown identifier.

    Raises UsageError for an unknown name, and for an identifier that several rows have.
    """
    if word in known:
        return known[word]
    if "/" not in word:
        near = nearest(word, known)
        hint = did_you_mean(near) if near else "check the name."
        raise UsageError(
            f"model '{word[:80]}' is not in models.toml: {hint} Or name a model as PROVIDER/NAME. See:"
            " dronecats models list"
        )
    matches = [row for row in known.values() if row.spec.title == word]
    if len(matches) > 1:
        raise UsageError(f"model '{word}' has several rows. Name one of them: {', '.join(row.name for row in matches)}")
    return matches[0] if matches else None


def model_of(word: str, base_url: str | None = None) -> ModelSpec:
    """Return the model for the name of a row or for PROVIDER/NAME. Raises UsageError."""
    row = row_of(word, rows())
    spec = row.spec if row else spec_of(word)
    return replace(spec, base_url=base_url) if base_url else spec


def _own() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the rows of the user's file like `_tables`. Raises UsageError."""
    path = own_file()
    if path is None:
        if named_path := os.environ.get(OWN_FILE):
            raise UsageError(f"{OWN_FILE} names {named_path[:80]}, a folder of an unknown user. Write its full path")
        return {}
    if not path.exists():
        if os.environ.get(OWN_FILE):
            raise UsageError(f"{OWN_FILE} names {path}, which does not exist")
        return {}
    return _tables(file_bytes(path, str(path)), str(path))


def _tables(data: bytes, where: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the rows of a file by name: `where`, and the valid settings by key. Raises UsageError."""
    tables = {}
    for name, table in toml_of(data, where).items():
        if not isinstance(table, dict):
            raise UsageError(f"{where}: '{name[:40]}' is outside of a row. Put it below a line [NAME]")
        if not _NAME.fullmatch(name):
            raise UsageError(f"{where}: '{name[:40]}' cannot name a row. Use letters, digits, '.', '_' and '-'")
        tables[name] = where, {key: _stated(key, value, f"{where}: [{name}]") for key, value in table.items()}
    return tables


def _stated(key: str, value: Any, where: str) -> Any:
    """Return the value of a key of a row, validated; None for "none". Raises UsageError."""
    if key in NOTES:
        return typed(value, Text, where, key)
    if key not in KEYS:
        if isinstance(value, dict) and not set(value).isdisjoint({*KEYS, *NOTES}):
            raise UsageError(f"{where} has a row '{key[:40]}'. Put a name with a dot into quotes: [\"NAME.WITH.DOTS\"]")
        raise UsageError(f"{where}: '{key[:40]}' {unknown_key_message(key, [*KEYS, *NOTES])}")
    if value == NONE and key in MAY_BE_NONE:
        return None
    stated = typed(value, fields_of(ModelSpec)[KEYS[key]], where, key)
    if isinstance(stated, dict) and not _is_json(stated):
        raise UsageError(
            f"{where}: '{key}' has a value that JSON does not have. Use text, numbers, booleans, lists and tables"
        )
    if key == "provider" and stated not in PROVIDERS:
        raise UsageError(f"{where}: '{key}' {no_choice(stated, PROVIDERS)}")
    return stated


def _is_json(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_is_json(inner) for inner in value.values())
    if isinstance(value, list):
        return all(_is_json(inner) for inner in value)
    return abs(value) <= INTEGER_MAX if isinstance(value, int) else isinstance(value, str | float)


def _row(name: str, table: Mapping[str, Any], where: str) -> ModelRow:
    for key in NEEDED:
        if key not in table:
            raise UsageError(f"{where}: [{name}] has no {key}. Add it")
    provider = provider_of(table["provider"])
    if "tokens_field" in table and provider.wire != "openai":
        raise UsageError(
            f"{where}: [{name}] tokens_field works with the OpenAI chat format only, and {provider.name} has"
            " another one. Remove it"
        )
    stated = {KEYS[key]: value for key, value in table.items() if key in KEYS}
    spec = ModelSpec(**{"temperature": provider.temperature, **stated})
    return ModelRow(name=name, spec=spec, file=where, **{key: table.get(key) for key in NOTES})
