"""Reads a table of a TOML file, or an object of a JSON file, into a dataclass, and checks it by the annotations.

A dataclass declares each key once: its type, its bounds and its description (`msgspec.Meta`). msgspec checks the
values. This module also rejects values that msgspec accepts (unknown keys, nulls, numbers that are not finite), and
turns an error into one sentence with the file, the key, the value and the rule. `Meta(extra={"wrong": "is not …"})`
replaces the default message about a wrong value of a field.
"""

import json
import math
import re
import tomllib
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from foundation.conversion import convert
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.wording import suggestion

BYTES_MAX = 1_000_000  # size limit of a file that people write
DEPTH_MAX = 12  # levels of brackets in a JSON file
SHOWN = 60  # a message shows at most this many characters of a value
STEP = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")  # a key or index in the path at the end of a msgspec message
REFUSALS = ("Expected", "Invalid", "Object", "Number")  # beginnings of msgspec's own messages
MISSING = re.compile(r"missing required field `(\w+)`")
WRONG = {
    str: "is not text", int: "is not a whole number", float: "is not a number", bool: "is neither true nor false",
    dict: "is not a table",
}  # fmt: skip

LARGE = 1e12  # bound of the numbers in files and rows; a larger number counts as damage
Number = Annotated[float, msgspec.Meta(gt=-LARGE, lt=LARGE)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, lt=LARGE)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, lt=LARGE)]

T = TypeVar("T")
PlacedFault = tuple[str, str]  # place of a value in the file, and what is wrong with it


def file_bytes(path: Path, where: str, bytes_max: int = BYTES_MAX) -> bytes:
    """Return the content of a file. `where` names the file in errors. Raises UsageError above `bytes_max` bytes."""
    with file_errors_as(UsageError, f"{where} cannot be read"), path.open("rb") as file:
        data = file.read(bytes_max + 1)
    _check_size(data, where, bytes_max)
    return data


def toml_table(path: Path, where: str) -> dict[str, Any]:
    """Return the content of a TOML file. Raises UsageError."""
    return toml_of(file_bytes(path, where), where)


def toml_of(data: bytes, where: str) -> dict[str, Any]:
    """Return the content of a TOML file, given as bytes. Raises UsageError."""
    try:
        return tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # not TOML, not UTF-8, or a number of thousands of digits
        raise UsageError(f"{where} is not TOML: {_reason(error)}") from None


def json_of(data: bytes, where: str, bytes_max: int = BYTES_MAX, depth_max: int = DEPTH_MAX) -> Any:
    """Return the content of a JSON file, given as bytes. Raises UsageError, also for NaN, Infinity, duplicate keys."""

    def constant(name: str) -> NoReturn:
        raise UsageError(f"{where}: {name} is not a number that JSON allows")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise UsageError(f"{where}: {short_repr(twice)} appears twice in one object")
        return table

    _check_size(data, where, bytes_max)
    try:
        text = data.decode("utf-8")
        depth = 0
        for mark in re.finditer(r'"(?:[^"\\]|\\.)*"|[\[{\]}]', text, re.DOTALL):
            depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(mark.group(), 0)
            if depth > depth_max:
                raise UsageError(f"{where}: the JSON is nested more than {depth_max} levels deep")
        return json.loads(text, parse_constant=constant, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise UsageError(f"{where} is not JSON: line {error.lineno}, column {error.colno}: {error.msg}") from None
    except UnicodeDecodeError as error:
        raise UsageError(f"{where} is not UTF-8 text (byte {error.start})") from None
    except (ValueError, RecursionError) as error:  # a number of thousands of digits
        raise UsageError(f"{where} is not readable JSON: {_reason(error)}") from None


def _check_size(data: bytes, where: str, bytes_max: int) -> None:
    if len(data) > bytes_max:
        raise UsageError(f"{where} has more than {bytes_max} bytes, too many for such a file")


def _reason(error: Exception) -> str:
    return str(error).splitlines()[0].split(";")[0] if str(error) else "it is nested too deeply"


def typed(value: Any, kind: type[T], where: str, at: str = "") -> T:
    """Return the value as a `kind`: a dataclass, or any annotation. Raises UsageError.

    `where` names the file, and `at` the value's place in it.
    """
    fault = _first_extra_fault(value, kind, at)
    if fault is None:
        try:
            return convert(value, kind)
        except msgspec.ValidationError as error:
            fault = _rejected(str(error), value, kind, at)
        except UnicodeError:  # half a surrogate pair
            fault = at, "has a character that is not text"
    place, reason = fault
    raise UsageError(f"{where}: {short_repr(place)} {reason}" if place else f"{where} {reason}")


def replaced(base: T, table: dict[str, Any], where: str) -> T:
    """Return a copy of a dataclass with the values of a table. Raises UsageError."""
    fields = fields_of(type(base))
    if stray := next((key for key in table if key not in fields), None):
        raise UsageError(f"{where}: {short_repr(stray)} {unknown_key_message(stray, fields)}")
    changes = {key: typed(value, fields[key], where, key) for key, value in table.items()}
    return replace(base, **changes)  # type: ignore[type-var]


def join(at: str, key: str) -> str:
    """Return the place of a key in the table at `at`."""
    return f"{at}.{key}" if at else key


def short_repr(value: Any) -> str:
    """Return a value for a message, short and on one line."""
    try:
        text = repr(value)
    except ValueError:  # Python does not print numbers with thousands of digits
        return "too long a number"
    return text if len(text) <= SHOWN else text[: SHOWN - 3] + "..."


def unknown_key_message(key: str, names: Iterable[str]) -> str:
    """Return the message about an unknown key."""
    return f"is not known: {suggestion(key, names, count=1, cutoff=0.6)}"


def no_choice(value: Any, choices: Iterable[str]) -> str:
    """Return the message about a value that is not one of the choices."""
    return f"is {short_repr(value)}: {suggestion(value if isinstance(value, str) else '', choices)}"


@dataclass(frozen=True, slots=True)
class FieldRule:
    """The rule that an annotation sets for a value."""

    kind: Any  # the annotated type without None; may be a union
    meta: tuple[msgspec.Meta, ...]  # outermost annotation first
    optional: bool  # whether None is allowed

    @property
    def words(self) -> str:
        """The message about a value that breaks the rule."""
        if self.own_words:
            return self.own_words
        low, high = self.bound("min_length"), self.bound("max_length")
        if get_origin(self.kind) is tuple:
            items = get_args(self.kind)
            if items[-1] is not Ellipsis:
                return f"is not a list of {len(items)} values"
            if high is not None:
                return f"is not a list of {low or 0} … {high} items"
            return "is not a list" if low is None else f"is not a list of {low} or more items"
        if is_dataclass(self.kind):
            return "is not a table of keys and values"
        return WRONG.get(get_origin(self.kind) or self.kind, "is not valid")

    @property
    def own_words(self) -> str | None:
        """The field's own message about a value that breaks the rule."""
        return next((str(meta.extra["wrong"]) for meta in self.meta if meta.extra and "wrong" in meta.extra), None)

    @property
    def range(self) -> str:
        """The message about a number out of bounds."""
        low, high = self.bound("ge"), self.bound("le")
        if low is not None and high is not None:
            return f"outside {low:g} … {high:g}"
        signs = {"above": "gt", "at least": "ge", "below": "lt", "at most": "le"}
        bounds = [f"{sign} {bound:g}" for sign, name in signs.items() if (bound := self.bound(name)) is not None]
        return f"and must be {' and '.join(bounds)}" if bounds else "which is too large"

    def bound(self, name: str) -> Any:
        """Return a bound by its name in `msgspec.Meta`; None if not set."""
        return next((bound for meta in self.meta if (bound := getattr(meta, name)) is not None), None)

    def item(self, index: int) -> Any:
        """Return the annotation of the list item at `index`, or of a dict's values."""
        kinds = get_args(self.kind)
        if get_origin(self.kind) is not tuple:
            return kinds[-1]
        return kinds[0] if kinds[-1] is Ellipsis else kinds[min(index, len(kinds) - 1)]

    def broken_by(self, value: Any) -> str:
        """Return the message about this value, which breaks the rule."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if self.own_words:
            return f"{self.own_words} ({short_repr(value)})"
        if number and (self.kind is float or (self.kind is int and isinstance(value, int))):
            return f"is {short_repr(value)}, {self.range}"
        if get_origin(self.kind) is Literal:
            choices = [str(word) for word in get_args(self.kind)]
            return no_choice(value, choices)
        longest = self.bound("max_length")
        if self.kind is str and isinstance(value, str) and longest and not 0 < len(value) <= longest:
            return f"must have {self.bound('min_length') or 0} … {longest} characters"
        return f"{self.words} ({short_repr(value)})"


def fields_of(kind: Any) -> dict[str, Any]:
    """Return the annotations of a dataclass's fields by their names."""
    return _type_hints(kind)


@cache
def _type_hints(kind: Hashable) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def rule_of(annotation: Any) -> FieldRule:
    """Return the rule that an annotation sets."""
    meta: list[msgspec.Meta] = []
    optional = False
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *more = get_args(annotation)
            meta += [entry for entry in more if isinstance(entry, msgspec.Meta)]
            continue
        kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else ()
        left = [kind for kind in kinds if kind not in (NoneType, msgspec.UnsetType)]
        optional = optional or NoneType in kinds
        if len(left) != 1:
            return FieldRule(annotation, tuple(meta), optional)
        annotation = left[0]


def _first_extra_fault(value: Any, annotation: Any, at: str) -> PlacedFault | None:
    """Return the first fault that msgspec accepts (unknown key, null, infinite or NaN number); None: no such fault."""
    if isinstance(value, float):
        return None if math.isfinite(value) else (at, f"is {value}, which is not a finite number")
    if not isinstance(value, dict | list):
        return None
    rule = rule_of(annotation)
    if isinstance(value, dict) and is_dataclass(rule.kind):
        fields = fields_of(rule.kind)
        for key, inner in value.items():
            if key not in fields:
                return join(at, key), unknown_key_message(key, fields)
            if inner is None and rule_of(fields[key]).optional:
                return join(at, key), "is null. Leave it out"
            if fault := _first_extra_fault(inner, fields[key], join(at, key)):
                return fault
    elif isinstance(value, dict) and get_origin(rule.kind) is dict:
        faults = (_first_extra_fault(inner, rule.item(0), join(at, key)) for key, inner in value.items())
        return next(filter(None, faults), None)
    elif isinstance(value, list) and get_origin(rule.kind) in (tuple, list):
        faults = (_first_extra_fault(inner, rule.item(k), f"{at}[{k}]") for k, inner in enumerate(value))
        return next(filter(None, faults), None)
    return None


def _rejected(error: str, value: Any, annotation: Any, at: str) -> PlacedFault:
    """Return the fault of a value that msgspec rejected with this message."""
    for key, index in STEP.findall(error.partition(" - at `$")[2]):
        rule = rule_of(annotation)
        if get_origin(rule.kind) in (Union, UnionType):  # a union: msgspec does not say which member failed
            break
        if key:
            annotation, at, value = fields_of(rule.kind)[key], join(at, key), value[key]
        elif index.isdecimal():
            annotation, at, value = rule.item(int(index)), f"{at}[{index}]", value[int(index)]
        else:  # a dict: msgspec does not say which key
            annotation = rule.item(0)
            key = next(name for name, inner in value.items() if not _converts(inner, annotation))
            at, value = join(at, key), value[key]
    if not error.startswith(REFUSALS):  # from the dataclass's own `__post_init__`
        return at, f"is wrong: {error.partition(' - at `$')[0]}"
    if missing := MISSING.search(error):
        return join(at, missing[1]), "is missing"
    return at, rule_of(annotation).broken_by(value)


def _converts(value: Any, annotation: Any) -> bool:
    try:
        convert(value, annotation)
    except (msgspec.ValidationError, UnicodeError):
        return False
    return True
