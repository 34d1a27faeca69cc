"""From a value that is none of a row's to one sentence that says which and why."""

import re
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from foundation.measurement import LARGE
from foundation.run_folder.rows import Decision

EARLY_S = 0.05  # s, a telemetry message: as much as a decision may be told to be before its own frame
AT = re.compile(r"\$\.(\w+)")  # where msgspec says that it stopped
MISSING = re.compile(r"missing required field `(\w+)`")
PLAIN = {str: "is not text", int: "is not a whole number", float: "is not a number", bool: "is neither true nor false"}

Row = TypeVar("Row")


def taken(value: dict[str, Any], row: type[Row]) -> tuple[Row, None] | tuple[None, str]:
    """Return (the row that a JSON object is, None), or (None, what is wrong with it)."""
    try:
        made = msgspec.convert(value, row)
    except msgspec.ValidationError as error:
        if missing := MISSING.search(str(error)):
            return None, f"it has no {missing[1]}"
        at = AT.search(str(error))
        return None, _wrong(row, at[1]) if at else str(error)
    except UnicodeError:  # msgspec compares words as UTF-8, and half a surrogate pair has none
        return None, "one of its words is no text"
    names = (field.name for field in fields(row))  # type: ignore[arg-type]
    if large := next((name for name in names if _too_large(getattr(made, name))), None):
        return None, _wrong(row, large)
    fault = impossible(made) if isinstance(made, Decision) else None
    return (None, fault) if fault else (made, None)


def impossible(decision: Decision) -> str | None:
    """Return what no decision can be, None when this one can."""
    if decision.action is not None and not isinstance(decision.action.get("action"), str):
        return "its action is not an action"
    if decision.t_decided < max(0.0, decision.t_frame - EARLY_S):
        return "its t_decided is before its t_frame" if decision.t_decided >= 0.0 else "its t_decided is below 0"
    return None


def _too_large(value: Any) -> bool:
    """Return whether a number, or one of a place or a table, is of a size that nothing can be measured to have."""
    if isinstance(value, float):
        return not abs(value) < LARGE
    several = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
    return any(isinstance(each, float) and not abs(each) < LARGE for each in several)


def _wrong(row: type, name: str) -> str:
    """Return the sentence about a field: what its annotation, or its plain type, says that the value is not."""
    parts = list(_parts(get_type_hints(row, include_extras=True).get(name)))
    said = [part.extra["wrong"] for part in parts if isinstance(part, msgspec.Meta) and part.extra]
    said += [PLAIN[part] for part in parts if part in PLAIN]
    return f"its {name} {said[0] if said else 'is not what it should be'}"


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation's metadata and types, outermost first."""
    if get_origin(annotation) is Annotated:
        inner, *told = get_args(annotation)
        yield from told
        yield from _parts(inner)
    elif get_args(annotation):
        for each in get_args(annotation):
            yield from _parts(each)
    else:
        yield annotation
