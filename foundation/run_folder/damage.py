"""From a value that is none of a row's to one sentence that says which and why."""

import re
from typing import Any, TypeVar

import msgspec

from foundation.measurement import LARGE
from foundation.run_folder.rows import Decision
from foundation.typed_file import MISSING, fields_of, rule_of

EARLY_S = 0.05  # s, a telemetry message: as much as a decision may be told to be before its own frame
AT = re.compile(r"\$\.(\w+)")  # where msgspec says that it stopped

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
    if large := next((name for name in fields_of(row) if _too_large(getattr(made, name))), None):
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
    """Return the sentence about a field: what its annotation says that the value is not."""
    return f"its {name} {rule_of(fields_of(row)[name]).words}"
