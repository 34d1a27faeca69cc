"""decisions.jsonl: one line per step and drone, written by the agent, flushed as it happens."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TextIO


@dataclass(frozen=True, slots=True)
class Decision:
    """What the pilot decided, on which frame, when. Times are vehicle seconds since the episode began."""

    step: int
    drone: int
    frame_id: int
    t_frame: float
    t_decided: float
    reply: str  # as received
    action: dict[str, Any] | None  # parsed, point in [x, y] order; None when the reply holds no valid action
    error: str | None
    latency_s: float
    tokens_in: int | None
    tokens_out: int | None
    thinking: bool
    rate_hz: float | None  # decisions per second of vehicle time since the previous one; None for the first


class DecisionLog:
    """Appends to a file that is readable after a kill at any byte."""

    def __init__(self, path: Path) -> None:
        self._file: TextIO = path.open("a", encoding="utf-8", errors="backslashreplace")

    def write(self, decision: Decision) -> None:
        self._file.write(json.dumps(asdict(decision)) + "\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()
