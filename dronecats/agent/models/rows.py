"""Models by name: the rows of models.toml, which ships, and of the user's own file. Data, checked where it is read."""

import difflib
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from dronecats.agent.models.model import ModelSpec
from dronecats.agent.models.providers import PROVIDERS, provider_of, spec_of
from foundation.errors import UsageError
from foundation.wording import did_you_mean, nearest

OWN_FILE = "DRONECATS_MODELS"  # environment variable: the user's file
SHIPPED = "models.toml"
BYTES_MAX = 1_000_000  # of a file: a hundred times what ships
TEMPERATURE_MAX = 2.0
PRICE_MAX = 100_000.0  # $ per million tokens
COUNT_MAX = 100_000_000  # of tokens
INTEGER_MAX = 2**63 - 1  # that JSON's readers have in common
NONE = "none"  # how a row says that nothing is sent
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRow:
    """One model by its name."""

    name: str
    spec: ModelSpec
    file: str  # where it is stated, last
    source: str | None = None  # of its prices
    note: str | None = None  # what somebody who flies it should know


class _UnfitError(ValueError):
    """A value that its key does not take; the text says what it wants."""


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise _UnfitError("a text")
    return value


def _one_of(*words: str) -> Callable[[Any], str]:
    def read(value: Any) -> str:
        if value not in words:
            raise _UnfitError(", ".join(f'"{word}"' for word in words[:-1]) + f' or "{words[-1]}"')
        return str(value)

    return read


def _number(low: float, high: float, whole: bool = False) -> Callable[[Any], float | int]:
    def read(value: Any) -> float | int:
        kinds: tuple[type, ...] = (int,) if whole else (int, float)
        if type(value) not in kinds or not low <= value <= high:
            raise _UnfitError(f"a {'whole ' if whole else ''}number from {low:g} to {high:,.10g}")
        return int(value) if whole else float(value)

    return read


def _schema(value: Any) -> str | None:
    root = _one_of("object", "array", NONE)(value)
    return None if root == NONE else root


def _temperature(value: Any) -> float | None:
    try:
        return None if value == NONE else float(_number(0.0, TEMPERATURE_MAX)(value))
    except _UnfitError as wants:
        raise _UnfitError(f'{wants}, or "none" where none may be sent') from None


def _fields(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not _is_json(value):
        raise _UnfitError("a table of what is merged into the request, { } for nothing")
    return value


def _is_json(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_is_json(inner) for inner in value.values())
    if isinstance(value, list):
        return all(_is_json(inner) for inner in value)
    if isinstance(value, int):
        return abs(value) <= INTEGER_MAX
    return isinstance(value, str) or (isinstance(value, float) and math.isfinite(value))


def _shown(value: Any) -> str:
    """Return the beginning of a value, as a sentence has it."""
    try:
        return str(value)[:40]
    except ValueError:  # Python writes no number of thousands of digits
        return "too long a number"


@dataclass(frozen=True, slots=True)
class _Key:
    """A key of a row: the field of a ModelSpec that it states, and what reads it. Raises _UnfitError."""

    field: str
    read: Callable[[Any], Any]


KEYS: dict[str, _Key] = {
    "provider": _Key("provider", _text),
    "identifier": _Key("name", _text),
    "base_url": _Key("base_url", _text),
    "axis": _Key("axis_order", _one_of("xy", "yx")),
    "schema": _Key("schema", _schema),
    "temperature": _Key("temperature", _temperature),
    "top_p": _Key("top_p", _number(0.0, 1.0)),
    "top_k": _Key("top_k", _number(1, COUNT_MAX, whole=True)),
    "max_tokens": _Key("max_tokens", _number(1, COUNT_MAX, whole=True)),
    "tokens_field": _Key("tokens_field", _one_of("max_tokens", "max_completion_tokens")),
    "reasoning_off": _Key("quick", _fields),
    "reasoning_lifted": _Key("thinking", _fields),
    "input_usd": _Key("input_usd", _number(0.0, PRICE_MAX)),
    "output_usd": _Key("output_usd", _number(0.0, PRICE_MAX)),
    "context": _Key("context_tokens", _number(1, COUNT_MAX, whole=True)),
}
SAID = ("source", "note")  # for people, and in no request
NEEDED = ("provider", "identifier")
PRICES = ("input_usd", "output_usd")


def rows() -> dict[str, ModelRow]:
    """Return the rows by name, those that ship first. Raises UsageError, one sentence with file, row and key."""
    shipped = files("dronecats.agent.models").joinpath(SHIPPED).read_bytes()
    tables = {name: (SHIPPED, table) for name, table in _tables(shipped, SHIPPED).items()}
    for name, table in _own().items():
        where, stated = table
        before = tables[name][1] if name in tables else {}
        if any(price in stated for price in PRICES):
            before = {key: value for key, value in before.items() if key != "source"}
        tables[name] = (where, {**before, **stated})
    return {name: _row(name, table, where) for name, (where, table) in tables.items()}


def own_file() -> Path | None:
    """Return where the user's rows are, or would be; None for a user without a home."""
    try:
        if given := os.environ.get(OWN_FILE):
            return Path(given).expanduser()
        config = os.environ.get("XDG_CONFIG_HOME")
        return (Path(config) if config else Path.home() / ".config") / "dronecats" / SHIPPED
    except RuntimeError:  # a user id that has none
        return None


def row_of(word: str, known: Mapping[str, ModelRow]) -> ModelRow | None:
    """Return the row that a word names: by its name, or as PROVIDER/NAME by its identifier. None where none has that.

    Raises UsageError for a word that is neither, and for an identifier that several rows have.
    """
    if word in known:
        return known[word]
    if "/" not in word:
        near = nearest(word, known)
        hint = did_you_mean(near) if near else "see `dronecats models list`,"
        raise UsageError(f"there is no model '{word[:80]}' in models.toml; {hint} or name one as PROVIDER/NAME")
    found = [row for row in known.values() if row.spec.title == word]
    if len(found) > 1:
        raise UsageError(f"'{word}' is the model of several rows: name one of {', '.join(row.name for row in found)}")
    return found[0] if found else None


def model_of(word: str, base_url: str | None = None) -> ModelSpec:
    """Return the model that a row's name or PROVIDER/NAME stands for. Raises UsageError."""
    row = row_of(word, rows())
    spec = row.spec if row else spec_of(word)
    return replace(spec, base_url=base_url) if base_url else spec


def _own() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the user's tables by their rows' names, each with the file's name. Raises UsageError."""
    path = own_file()
    if path is None:
        if given := os.environ.get(OWN_FILE):
            raise UsageError(f"{OWN_FILE} names {given[:80]}, whose home nobody knows")
        return {}
    try:
        with path.open("rb") as file:
            data = file.read(BYTES_MAX + 1)
    except (FileNotFoundError, NotADirectoryError):
        if os.environ.get(OWN_FILE):
            raise UsageError(f"{OWN_FILE} names {path}, which is not there") from None
        return {}
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    return {name: (str(path), table) for name, table in _tables(data, str(path)).items()}


def _tables(data: bytes, where: str) -> dict[str, dict[str, Any]]:
    """Return a file's tables by their rows' names, each key checked. Raises UsageError."""
    if len(data) > BYTES_MAX:
        raise UsageError(f"{where} is longer than {BYTES_MAX} bytes, so it is no file of models")
    try:
        tables = tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # not TOML, not UTF-8, or a number of thousands of digits
        reason = str(error).splitlines()[0] if str(error) else "it is nested too deeply"
        raise UsageError(f"{where} is not TOML: {reason}") from None
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise UsageError(f"{where}: '{name[:40]}' stands outside of a row; a row begins with [NAME]")
        if not _NAME.fullmatch(name):
            raise UsageError(f"{where}: '{name[:40]}' is no name of a row: letters, digits, '.', '_' and '-' are")
        for key, value in table.items():
            _check(key, value, f"{where}: [{name}]", table)
    return tables


def _check(key: str, value: Any, where: str, table: Mapping[str, Any]) -> None:
    """Raise UsageError unless a row may have this key with this value."""
    if key not in KEYS and key not in SAID:
        if isinstance(value, dict) and not set(value).isdisjoint({*KEYS, *SAID}):
            raise UsageError(
                f"{where} holds a row '{key[:40]}'; put a name with a dot into quotes: [\"NAME.WITH.DOTS\"]"
            )
        raise UsageError(f"{where} has no '{key[:40]}'{_near(key, [*KEYS, *SAID])}")
    try:
        (KEYS[key].read if key in KEYS else _text)(value)
    except _UnfitError as wants:
        raise UsageError(f"{where} {key} wants {wants}; it is {_shown(value)!r}") from None
    if key == "provider" and value not in PROVIDERS:
        raise UsageError(f"{where} provider: there is no '{value[:40]}'{_near(value, list(PROVIDERS))}")


def _row(name: str, table: Mapping[str, Any], where: str) -> ModelRow:
    for key in NEEDED:
        if key not in table:
            raise UsageError(f"{where}: [{name}] lacks {key}")
    if "tokens_field" in table and provider_of(table["provider"]).wire != "openai":
        raise UsageError(
            f"{where}: [{name}] tokens_field is of the OpenAI chat format, which {table['provider']} is not"
        )
    stated: dict[str, Any] = {"temperature": provider_of(table["provider"]).temperature}
    stated |= {KEYS[key].field: KEYS[key].read(value) for key, value in table.items() if key in KEYS}
    said = {key: table.get(key) for key in SAID}
    return ModelRow(name=name, spec=ModelSpec(**stated), file=where, **said)


def _near(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean '{near[0]}'?" if near else f"; there are {', '.join(known)}"
