"""The files of an episode, read as they are: a torn last line is what a kill leaves, and is skipped."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dronecats.judge.damage import Row as Row
from dronecats.judge.damage import decision_fault, estimate_fault, truth_fault
from foundation.errors import UsageError


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
    truth = list(lines(folder / "truth.jsonl", truth_fault))
    logs = Logs(
        decisions=tuple(lines(folder / "decisions.jsonl", decision_fault)),
        frames=_frames(truth, folder / "truth.jsonl"),
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
    rows = list(lines(path, estimate_fault))
    head = next((r for r in rows if r["kind"] == "estimate"), None)
    if head is None:
        raise UsageError(f"{path} is damaged: it does not say what it was derived from")
    return Estimate(
        head=head,
        frames=_frames(rows, path),
        poses=tuple(r for r in rows if r["kind"] == "pose"),
    )


def _frames(rows: list[Row], path: Path) -> dict[tuple[int, int], Row]:
    frames: dict[tuple[int, int], Row] = {}
    for row in rows:
        if row["kind"] == "frame" and frames.setdefault((row["drone"], row["frame_id"]), row) != row:
            which = f"frame {row['frame_id']} of drone {row['drone']}"
            raise UsageError(f"{path} is damaged: it tells two truths of {which}")
    return frames


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
        reason: str | None
        try:
            value = json.loads(row, parse_constant=_refuse)
            reason = fault(value) if isinstance(value, dict) else "it is not a JSON object"
        except (ValueError, RecursionError):
            if number == len(rows):
                return  # no newline after it: the write was cut short
            reason = "it is not JSON"
        if reason is not None:
            raise UsageError(f"{path} line {number} is damaged: {reason}")
        yield value


def json_object(path: Path) -> Row | None:
    """Return the object that a JSON file holds, None when there is no such file or a kill has left half of one."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _refuse(constant: str) -> Any:
    raise ValueError(constant)
