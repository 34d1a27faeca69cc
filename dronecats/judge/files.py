"""The files of an episode, read as they are: a torn last line is what a kill leaves, and is skipped."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dronecats.border.errors import UsageError
from dronecats.judge.verdict import CAP_S, Measured


@dataclass(frozen=True, slots=True)
class Estimate:
    """estimate.jsonl: where the autopilot thought it was, smoothed, in a flight whose truth nobody knew."""

    head: dict[str, Any]
    frames: dict[tuple[int, int], dict[str, Any]]  # (drone, frame id) -> frame record
    poses: tuple[dict[str, Any], ...]


@dataclass(frozen=True, slots=True)
class Logs:
    """What the verifier knows."""

    decisions: tuple[dict[str, Any], ...]
    frames: dict[tuple[int, int], dict[str, Any]]  # (drone, frame id) -> frame record
    poses: tuple[dict[str, Any], ...]
    begin: dict[str, Any] | None
    end: dict[str, Any] | None
    estimate: Estimate | None = None  # None: not derived, or not needed because the truth was known

    @property
    def true(self) -> bool:
        """Whether truth.jsonl is the truth, and not what an autopilot said of itself."""
        return (self.begin or {}).get("source") != "estimate"


def read(folder: Path) -> Logs:
    """Return the logs of an episode folder. Raises UsageError when a file is missing or a line in it is damaged."""
    truth = list(lines(folder / "truth.jsonl", _truth_fault))
    logs = Logs(
        decisions=tuple(lines(folder / "decisions.jsonl", _decision_fault)),
        frames={(r["drone"], r["frame_id"]): r for r in truth if r["kind"] == "frame"},
        poses=tuple(r for r in truth if r["kind"] == "pose"),
        begin=next((r for r in truth if r["kind"] == "begin"), None),
        end=next((r for r in truth if r["kind"] == "end"), None),
    )
    return logs if logs.true else replace(logs, estimate=_estimate(folder / "estimate.jsonl"))


def episode_folder(path: Path) -> Path:
    """Return the episode folder that is meant: the folder itself, or a run's only one. Raises UsageError."""
    if (path / "truth.jsonl").exists():
        return path
    inside = sorted(p.parent for p in path.glob("*/truth.jsonl"))
    if len(inside) != 1:
        many = f"holds {len(inside)} episodes; name one of them" if inside else "holds no episode"
        raise UsageError(f"{path} {many}")
    return inside[0]


def _estimate(path: Path) -> Estimate | None:
    if not path.exists():
        return None
    rows = list(lines(path, _estimate_fault))
    head = next((r for r in rows if r["kind"] == "estimate"), None)
    if head is None:
        raise UsageError(f"{path} is damaged: it does not say what it was derived from")
    return Estimate(
        head=head,
        frames={(r["drone"], r["frame_id"]): r for r in rows if r["kind"] == "frame"},
        poses=tuple(r for r in rows if r["kind"] == "pose"),
    )


Row = dict[str, Any]


def lines(path: Path, fault: Callable[[Row], str | None] = lambda row: None) -> Iterator[Row]:
    """Yield the objects of a JSON-lines file; a torn last line is left out.

    `fault` says what is wrong with a row. Raises UsageError naming the file and the line.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}; is this the folder of an episode?") from None
    rows = data.split(b"\n")
    for number, row in enumerate(rows, 1):
        if not row.strip():
            continue
        try:
            value = json.loads(row, parse_constant=_refuse)
            reason = fault(value) if isinstance(value, dict) else "it is not a JSON object"
        except (ValueError, RecursionError):
            reason = "it is not JSON"
        if reason is None:
            yield value
        elif number < len(rows):
            raise UsageError(f"{path} line {number} is damaged: {reason}")
        else:
            return  # no newline after it: the write was cut short


def json_object(path: Path) -> Row | None:
    """Return the object that a JSON file holds, None when there is no such file or a kill has left half of one."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _refuse(constant: str) -> Any:
    raise ValueError(constant)


def _decision_fault(row: Row) -> str | None:
    action = row.get("action")
    if not (action is None or (isinstance(action, dict) and isinstance(action.get("action"), str))):
        return "its action is not an action"
    return _not_whole(row, "step", "drone", "frame_id") or _not_number(row, "t_decided")


def _truth_fault(row: Row) -> str | None:
    kind = row.get("kind")
    if kind == "end":
        return None if isinstance(row.get("reason"), str) else "its reason is not text"
    if kind not in ("pose", "frame"):
        return None if isinstance(kind, str) else "it has no kind"
    whole = ("drone", "frame_id") if kind == "frame" else ("drone",)
    place = row.get("position_ned")
    if kind == "pose" and not (isinstance(place, list) and len(place) == 3 and all(_is_number(v) for v in place)):
        return "its position_ned is not three numbers"
    if row.get("distance_m") is not None and not _is_number(row["distance_m"]):
        return "its distance_m is not a number"
    if row.get("visible") not in (True, False, None):
        return "its visible is neither true nor false"
    return _not_whole(row, *whole) or _not_number(row, "t")


def _estimate_fault(row: Row) -> str | None:
    std = row.get("distance_std_m")
    if std is not None and not (_is_number(std) and std >= 0):
        return "its distance_std_m is not a standard deviation"
    if row.get("kind") == "end":
        return "an estimate has no end"
    return _truth_fault(row)


def _not_whole(row: Row, *names: str) -> str | None:
    bad = [name for name in names if not isinstance(row.get(name), int) or isinstance(row[name], bool)]
    return f"its {bad[0]} is not a whole number" if bad else None


def _not_number(row: Row, *names: str) -> str | None:
    bad = [name for name in names if not _is_number(row.get(name))]
    return f"its {bad[0]} is not a number" if bad else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12


class UnmeasuredError(Exception):
    """A decision refers to a frame whose truth was not logged."""


def finished(logs: Logs) -> list[Row]:
    """Return the decisions that declare arrival."""
    return [d for d in logs.decisions if (d["action"] or {}).get("action") == "finished"]


def declarations(logs: Logs) -> list[Measured]:
    """Return the declarations with the truth at their frames. Raises UnmeasuredError for one that could count."""
    return [measured(d, logs) for d in finished(logs) if d["t_decided"] <= CAP_S]


def last_action(logs: Logs) -> Measured | None:
    """Return the last action within the cap; of a fleet, the closest of the last step. Raises UnmeasuredError."""
    acted = [d for d in logs.decisions if d["t_decided"] <= CAP_S]
    if not acted:
        return None
    last = [measured(d, logs) for d in acted if d["step"] == acted[-1]["step"]]
    return min(last, key=lambda m: m.distance_m)


def measured(decision: dict[str, Any], logs: Logs) -> Measured:
    """Return a decision with the truth at its own frame. Raises UnmeasuredError."""
    frame = logs.frames.get((decision["drone"], decision["frame_id"]))
    if frame is None or frame.get("distance_m") is None:
        raise UnmeasuredError(
            f"step {decision['step']} of drone {decision['drone']} was decided on frame {decision['frame_id']},"
            " of which the logger has no truth"
        )
    return Measured(
        decision["step"], decision["drone"], decision["t_decided"], frame["distance_m"], bool(frame["visible"])
    )
