"""The one reader of the logs. Strict about what it knows, patient with what it does not. Good lines go by `quick.py`.

A torn last line is what a kill leaves, and is skipped; a value that cannot be is damage, named in one sentence; fields
and kinds of rows that a later version added are passed over.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.damage import taken
from foundation.run_folder.quick import quick, quick_of_kinds
from foundation.run_folder.results import Result
from foundation.run_folder.rows import (
    ESTIMATE_ROWS,
    TRUTH_ROWS,
    Begin,
    Clear,
    Decision,
    End,
    EstimatedFrame,
    EstimatedPose,
    EstimateHead,
    Exchange,
    FlownRecord,
    FrameTruth,
    Hit,
    Pose,
    Reset,
    drone_label,
)

SCHEMA = 1  # version of the run folder's files; counts up when a field changes its meaning, which adding one does not

Row = TypeVar("Row")
TruthRow = Begin | Pose | FrameTruth | Hit | Clear | Reset | End
EstimateRow = EstimateHead | EstimatedPose | EstimatedFrame


@dataclass(frozen=True, slots=True)
class Estimate:
    """estimate.jsonl: where the autopilot thought it was, smoothed, in a flight whose truth nobody knew."""

    head: EstimateHead
    frames: dict[tuple[int, int], EstimatedFrame]  # by (drone, frame id)
    poses: tuple[EstimatedPose, ...]


@dataclass(frozen=True, slots=True)
class Logs:
    """What is known of an episode when its process is gone."""

    decisions: tuple[Decision, ...]
    frames: dict[tuple[int, int], FrameTruth]  # by (drone, frame id)
    poses: tuple[Pose, ...]
    begin: Begin | None
    end: End | None
    estimate: Estimate | None = None  # None: not derived, or not needed because the truth was known
    record: FlownRecord | None = None  # None: there is none that can be read
    hits: tuple[Hit, ...] = ()
    clears: tuple[Clear, ...] = ()
    resets: tuple[Reset, ...] = ()

    @property
    def true(self) -> bool:
        """Whether truth.jsonl is the truth, and not what an autopilot said of itself."""
        return self.begin is None or self.begin.source != "estimate"


def read(folder: Path) -> Logs:
    """Return the logs of an episode folder. Raises UsageError when a file is missing or a line in it is damaged."""
    check_version(folder.resolve().parent)
    told: dict[type, list[Any]] = {kind: [] for kind in TRUTH_ROWS.values()}
    for row in truth(folder):
        told[type(row)].append(row)
    logs = Logs(
        decisions=tuple(rows(folder / layout.DECISIONS, Decision)),
        frames=_frames(told[FrameTruth], folder / layout.TRUTH),
        poses=tuple(told[Pose]),
        begin=next(iter(told[Begin]), None),
        end=next(iter(told[End]), None),
        hits=tuple(told[Hit]),
        clears=tuple(told[Clear]),
        resets=tuple(told[Reset]),
        record=taken(json_object(folder / layout.EPISODE) or {}, FlownRecord)[0],
    )
    return logs if logs.true else replace(logs, estimate=estimate(folder))


def truth(folder: Path) -> Iterator[TruthRow]:
    """Yield the rows of an episode's truth.jsonl. Raises UsageError."""
    return _of_kinds(folder / layout.TRUTH, TRUTH_ROWS)


def estimate(folder: Path) -> Estimate | None:
    """Return an episode's estimate.jsonl, None where none was derived. Raises UsageError."""
    path = folder / layout.ESTIMATE
    if not path.exists():
        return None
    told: list[EstimateRow] = list(_of_kinds(path, ESTIMATE_ROWS, never="end"))
    head = next((row for row in told if isinstance(row, EstimateHead)), None)
    if head is None:
        raise UsageError(f"{path} is damaged: it does not say what it was derived from")
    frames = _frames([row for row in told if isinstance(row, EstimatedFrame)], path)
    return Estimate(head, frames, tuple(row for row in told if isinstance(row, EstimatedPose)))


def exchanges(folder: Path) -> tuple[Exchange, ...]:
    """Return an episode's commander.jsonl, nothing where no commander was asked. Raises UsageError."""
    path = folder / layout.COMMANDER
    return tuple(rows(path, Exchange)) if path.exists() else ()


def rows(path: Path, row: type[Row]) -> Iterator[Row]:
    """Yield the lines of a file that holds one kind of row. Raises UsageError naming the file and the line."""
    at_once = quick(row)
    for number, text in _lines(path):
        if (made := at_once(text)) is not None:
            yield made
            continue
        line = LogLine(path, number, text)
        value = line.value()
        if value is None:
            return
        yield line.whole(value, row)


def episode_folder(path: Path) -> Path:
    """Return the episode folder that is meant: the folder itself, or a run's only one. Raises UsageError."""
    if (path / layout.TRUTH).exists():
        return path
    inside = sorted(p.parent for p in path.glob(f"*/{layout.TRUTH}"))
    if len(inside) != 1:
        many = f"holds {len(inside)} episodes; name one of them" if inside else "holds no episode"
        raise UsageError(f"{path} {many}")
    return inside[0]


def episodes(run: Path) -> list[Path]:
    """Return the episode folders of a run, by name; of an episode folder, itself."""
    if (run / layout.DECISIONS).exists():
        return [run]
    return sorted(path.parent for path in run.glob(f"*/{layout.DECISIONS}"))


def stored_result(episode: str, folder: Path) -> Result:
    """Return what verdict.json says of an episode that was judged. Raises UsageError when that is no verdict."""
    path = folder / layout.VERDICT
    return result_of({**(json_object(path) or {}), "episode": episode}, str(path))


def result_of(told: Mapping[str, Any], where: str = "a worker's answer") -> Result:
    """Return the result that a JSON object is. Raises UsageError naming where it stands."""
    made, fault = taken(dict(told), Result)
    if made is None:
        raise UsageError(f"{where} is damaged: {fault}")
    return made


def run_configuration(run: Path) -> dict[str, Any] | None:
    """Return what run.json holds, None when there is none. Raises UsageError when a newer version wrote it."""
    check_version(run)
    return json_object(run / layout.RUN)


def check_version(run: Path) -> None:
    """Raise UsageError when a run folder's files are of a version that this one does not know."""
    version = (json_object(run / layout.RUN) or {}).get("schema", SCHEMA)  # none was written before there were any
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise UsageError(f"{run / layout.RUN} is damaged: its schema is not a version")
    if version > SCHEMA:
        raise UsageError(f"{run} is of a newer dronecats: its files have version {version}, known is {SCHEMA}; update")


def json_object(path: Path) -> dict[str, Any] | None:
    """Return the object that a JSON file holds, None when there is no such file or a kill has left half of one."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _of_kinds(path: Path, kinds: Mapping[str, type[Any]], never: str | None = None) -> Iterator[Any]:
    """Yield the rows of these kinds; others are passed over, but for one that must not be."""
    at_once = quick_of_kinds(kinds)
    for number, text in _lines(path):
        if (made := at_once(text)) is not None:
            yield made
            continue
        line = LogLine(path, number, text)
        value = line.value()
        if value is None:
            return
        kind = value.get("kind")
        if not isinstance(kind, str):
            raise line.damaged("it has no kind")
        if kind == never:
            raise line.damaged(f"there is no {never} of what it tells")
        if kind in kinds:
            yield line.whole(value, kinds[kind])


Framed = TypeVar("Framed", FrameTruth, EstimatedFrame)


def _frames(told: list[Framed], path: Path) -> dict[tuple[int, int], Framed]:
    frames: dict[tuple[int, int], Framed] = {}
    for row in told:
        first = frames.setdefault((row.drone, row.frame_id), row)
        if first is not row and first != row:
            raise UsageError(
                f"{path} is damaged: it tells two truths of frame {row.frame_id} of {drone_label(row.drone)}"
            )
    return frames


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of a file of JSON lines, read strictly."""

    path: Path
    number: int  # 1 is the first; below 0: the last, after which there is no newline, so that it may be torn
    text: bytes

    def value(self) -> dict[str, Any] | None:
        """Return the object that it holds, None where it is torn. Raises UsageError."""
        try:
            value = json.loads(self.text, parse_constant=_refuse)
        except (ValueError, RecursionError):
            if self.number < 0:
                return None
            raise self.damaged("it is not JSON") from None
        if not isinstance(value, dict):
            raise self.damaged("it is not a JSON object")
        return value

    def whole(self, value: dict[str, Any], row: type[Row]) -> Row:
        """Return the row that its object is. Raises UsageError."""
        made, fault = taken(value, row)
        if made is None:
            raise self.damaged(str(fault))
        return made

    def damaged(self, reason: str) -> UsageError:
        return UsageError(f"{self.path} line {abs(self.number)} is damaged: {reason}")


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the lines in which something stands, with their numbers as `LogLine` has them. Raises UsageError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}; is this the folder of an episode?") from None
    texts = data.split(b"\n")
    for number, text in enumerate(texts, 1):
        if text and not text.isspace():
            yield (number if number < len(texts) else -number), text


def _refuse(constant: str) -> Any:
    raise ValueError(constant)
