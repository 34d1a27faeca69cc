"""The two logs of an episode, read as they are: a torn last line is what a kill leaves, and is skipped."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.border.errors import UsageError
from dronecats.judge.verdict import CAP_S, Measured


@dataclass(frozen=True, slots=True)
class Logs:
    """What the verifier knows."""

    decisions: tuple[dict[str, Any], ...]
    frames: dict[tuple[int, int], dict[str, Any]]  # (drone, frame id) -> frame record
    poses: tuple[dict[str, Any], ...]
    begin: dict[str, Any] | None
    end: dict[str, Any] | None


def read(folder: Path) -> Logs:
    """Return the logs of an episode folder. Raises UsageError when a file is missing or torn in the middle."""
    truth = list(lines(folder / "truth.jsonl"))
    return Logs(
        decisions=tuple(lines(folder / "decisions.jsonl")),
        frames={(r["drone"], r["frame_id"]): r for r in truth if r.get("kind") == "frame"},
        poses=tuple(r for r in truth if r.get("kind") == "pose"),
        begin=next((r for r in truth if r.get("kind") == "begin"), None),
        end=next((r for r in truth if r.get("kind") == "end"), None),
    )


def lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the objects of a JSON-lines file; a torn last line is left out."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}; is this the folder of an episode?") from None
    rows = data.split(b"\n")
    for number, row in enumerate(rows, 1):
        if not row.strip():
            continue
        try:
            value = json.loads(row)
            if not isinstance(value, dict):
                raise ValueError
        except ValueError:
            if number == len(rows):
                return  # no newline after it: the write was cut short
            raise UsageError(f"{path} line {number} is not a JSON object; the log is damaged") from None
        yield value


class UnmeasuredError(Exception):
    """A decision refers to a frame whose truth was not logged."""


def declarations(logs: Logs) -> list[Measured]:
    """Return the declarations within the cap with the truth at their frames. Raises UnmeasuredError."""
    finished = [d for d in logs.decisions if (d.get("action") or {}).get("action") == "finished"]
    return [measured(d, logs) for d in finished if d["t_decided"] <= CAP_S]


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
