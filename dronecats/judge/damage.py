"""What a line of a log must hold before anything is concluded from it. Each function says what is wrong with a row."""

from typing import Any

Row = dict[str, Any]

EARLY_S = 0.05  # s, a telemetry message: as much as a decision may be told to be before its own frame
LARGE = 1e12  # beyond it a number is damage
DRONES = 255  # as many as MAVLink has system ids


def decision_fault(row: Row) -> str | None:
    """Return what is wrong with a line of decisions.jsonl, None when nothing is."""
    action = row.get("action", False)
    if not (action is None or (isinstance(action, dict) and isinstance(action.get("action"), str))):
        return "its action is not an action"
    fault = _not_whole(row, "step", "drone", "frame_id") or _not_number(row, "t_frame", "t_decided")
    if fault is None and not isinstance(row.get("reply", ""), str):
        return "its reply is not text"
    if fault is None and row["t_decided"] < max(0.0, row["t_frame"] - EARLY_S):
        return "its t_decided is before its t_frame" if row["t_decided"] >= 0.0 else "its t_decided is below 0"
    return fault


def truth_fault(row: Row) -> str | None:
    """Return what is wrong with a line of truth.jsonl, None when nothing is."""
    match row.get("kind"):
        case "begin":
            return _begin_fault(row)
        case "end":
            return _not_number(row, "t") or (None if isinstance(row.get("reason"), str) else "its reason is not text")
        case "pose" if not _is_place(row.get("position_ned")):
            return "its position_ned is not three numbers"
        case "pose" | "frame":
            return _measurement_fault(row)
        case kind:
            return None if isinstance(kind, str) else "it has no kind"


def estimate_fault(row: Row) -> str | None:
    """Return what is wrong with a line of estimate.jsonl, None when nothing is."""
    std = row.get("distance_std_m")
    if std is not None and not (is_number(std) and std >= 0):
        return "its distance_std_m is not a standard deviation"
    if row.get("kind") == "end":
        return "an estimate has no end"
    if row.get("kind") == "estimate":
        return _head_fault(row)
    return truth_fault(row)


def is_number(value: Any) -> bool:
    """Return whether a JSON value is a finite number of a size that something can be measured to have."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGE


def _measurement_fault(row: Row) -> str | None:
    if row["kind"] == "frame" and (fault := _not_whole(row, "frame_id")):
        return fault
    for name in ("position_ned", "target_ned"):
        if row.get(name) is not None and not _is_place(row[name]):
            return f"its {name} is not three numbers"
    distance_m, visible = row.get("distance_m", ""), row.get("visible", "")
    if distance_m is not None and not (is_number(distance_m) and distance_m >= 0.0):
        return "its distance_m is not a distance"
    if visible is not None and not isinstance(visible, bool):
        return "its visible is neither true nor false"
    return _not_whole(row, "drone") or _not_number(row, "t")


def _begin_fault(row: Row) -> str | None:
    if row.get("source") not in (None, "estimate"):
        return "its source is not known"
    cap_s = row.get("cap_s")
    if cap_s is not None and not (is_number(cap_s) and cap_s > 0.0):
        return "its cap_s is not a time"
    t0_us = row.get("t0_us")  # counts from whatever the vehicle's clock counts from
    return None if isinstance(t0_us, int) and not isinstance(t0_us, bool) else "its t0_us is not a whole number"


def _head_fault(row: Row) -> str | None:
    target = row.get("target")
    if not isinstance(row.get("source", ""), str):
        return "its source is not text"
    if target is None:
        return None
    numbers = isinstance(target, dict) and all(value is None or is_number(value) for value in target.values())
    return None if numbers else "its target is not a surveyed place"


def _is_place(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(is_number(v) for v in value)


def _not_whole(row: Row, *names: str) -> str | None:
    bad = [name for name in names if not (is_number(row.get(name)) and isinstance(row[name], int) and row[name] >= 0)]
    if not bad and "drone" in names and row["drone"] >= DRONES:
        return f"its drone is not below {DRONES}"
    return f"its {bad[0]} is not a whole number" if bad else None


def _not_number(row: Row, *names: str) -> str | None:
    bad = [name for name in names if not is_number(row.get(name))]
    return f"its {bad[0]} is not a number" if bad else None
