"""Reads the logs of a run folder, and checks their known fields strictly.

An impossible value raises UsageError. Unknown fields and kinds of rows, which later versions may add, are skipped. An
incomplete last line, which a kill may leave, is skipped too. A fast reader reads most valid lines. The strict reader
reads all others, and gives the same rows for valid lines.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from foundation.conversion import convert, decoder
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.run_folder import layout
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
from foundation.typed_file import LARGE, MISSING, fields_of, rule_of

SCHEMA = 1  # version of the run folder's files: rises when a field changes its meaning, not when a field is added

Row = TypeVar("Row")
TruthRow = Begin | Pose | FrameTruth | Hit | Clear | Reset | End
EstimateRow = EstimateHead | EstimatedPose | EstimatedFrame


@dataclass(frozen=True, slots=True)
class Estimate:
    """Content of estimate.jsonl: the smoothed position estimate of the autopilot, for a flight without truth."""

    head: EstimateHead
    frames: dict[tuple[int, int], EstimatedFrame]  # by (drone, frame id)
    poses: tuple[EstimatedPose, ...]


@dataclass(frozen=True, slots=True)
class Logs:
    """The logs of an episode."""

    decisions: tuple[Decision, ...]
    frames: dict[tuple[int, int], FrameTruth]  # by (drone, frame id)
    poses: tuple[Pose, ...]
    begin: Begin | None
    end: End | None
    estimate: Estimate | None = None  # None: not derived, or not needed
    record: FlownRecord | None = None  # None: missing or unreadable
    hits: tuple[Hit, ...] = ()
    clears: tuple[Clear, ...] = ()
    resets: tuple[Reset, ...] = ()
    only_commander_asked: bool = False  # a commander was asked, but gave no orders in time: there are no decisions

    @property
    def true(self) -> bool:
        """True if truth.jsonl contains the truth; false if it contains the estimate of an autopilot."""
        return self.begin is None or self.begin.source != "estimate"


def read(folder: Path) -> Logs:
    """Return the logs of an episode folder. Raises UsageError when a file is missing or a line in it is damaged."""
    check_version(folder.resolve().parent)
    by_kind: dict[type, list[Any]] = {kind: [] for kind in TRUTH_ROWS.values()}
    for row in truth(folder):
        by_kind[type(row)].append(row)
    decisions = tuple(rows(folder / layout.DECISIONS, Decision))
    logs = Logs(
        decisions=decisions,
        frames=_frames(by_kind[FrameTruth], folder / layout.TRUTH),
        poses=tuple(by_kind[Pose]),
        begin=next(iter(by_kind[Begin]), None),
        end=next(iter(by_kind[End]), None),
        hits=tuple(by_kind[Hit]),
        clears=tuple(by_kind[Clear]),
        resets=tuple(by_kind[Reset]),
        record=parse_row(json_object(folder / layout.EPISODE) or {}, FlownRecord)[0],
        only_commander_asked=not decisions and bool(exchanges(folder)),
    )
    return logs if logs.true else replace(logs, estimate=estimate(folder))


def truth(folder: Path) -> Iterator[TruthRow]:
    """Yield the rows of an episode's truth.jsonl. Raises UsageError."""
    return _of_kinds(folder / layout.TRUTH, TRUTH_ROWS)


def estimate(folder: Path) -> Estimate | None:
    """Return an episode's estimate.jsonl; None without one. Raises UsageError."""
    path = folder / layout.ESTIMATE
    if not path.exists():
        return None
    estimate_rows: list[EstimateRow] = list(_of_kinds(path, ESTIMATE_ROWS, never="end"))
    head = next((row for row in estimate_rows if isinstance(row, EstimateHead)), None)
    if head is None:
        raise UsageError(f"{path} is damaged: it has no row with its source (kind estimate)")
    frames = _frames([row for row in estimate_rows if isinstance(row, EstimatedFrame)], path)
    return Estimate(head, frames, tuple(row for row in estimate_rows if isinstance(row, EstimatedPose)))


def exchanges(folder: Path) -> tuple[Exchange, ...]:
    """Return an episode's commander.jsonl; empty without a commander. Raises UsageError."""
    path = folder / layout.COMMANDER
    return tuple(rows(path, Exchange)) if path.exists() else ()


def rows(path: Path, row: type[Row]) -> Iterator[Row]:
    """Yield the rows of a file with one kind of row. Raises UsageError naming the file and the line."""
    return _read(path, fast_reader(row), lambda line, value: line.row(value, row))


def episode_folder(path: Path) -> Path:
    """Return the folder itself if it is an episode's, or the only episode folder of a run. Raises UsageError."""
    if (path / layout.TRUTH).exists():
        return path
    inside = sorted(p.parent for p in path.glob(f"*/{layout.TRUTH}"))
    if len(inside) != 1:
        if not path.is_dir():
            raise UsageError(f"folder {path} does not exist")
        if inside:
            raise UsageError(f"{path} has {len(inside)} episodes. Name one of them, such as {inside[0]}")
        if below := next(path.glob(f"*/*/{layout.TRUTH}"), None):
            raise UsageError(f"{path} has several runs. Name an episode, such as {below.parent}")
        raise UsageError(f"{path} has no episode. Name a run folder, or the folder of an episode")
    return inside[0]


def episodes(run: Path) -> list[Path]:
    """Return the episode folders of a run, sorted by name. For an episode folder, return that folder."""
    if (run / layout.DECISIONS).exists():
        return [run]
    return sorted(path.parent for path in run.glob(f"*/{layout.DECISIONS}"))


def stored_result(episode: str, folder: Path) -> Result:
    """Return the result in an episode's verdict.json. Raises UsageError for an invalid one."""
    path = folder / layout.VERDICT
    return result_of({**(json_object(path) or {}), "episode": episode}, str(path))


def result_of(value: Mapping[str, Any], where: str = "a worker's answer") -> Result:
    """Return the result in a JSON object. Raises UsageError, with `where` as the source of the object."""
    made, fault = parse_row(dict(value), Result)
    if made is None:
        raise UsageError(f"{where} is damaged: {fault}")
    return made


def run_configuration(run: Path) -> dict[str, Any] | None:
    """Return the content of run.json; None without one. Raises UsageError when a newer version wrote it."""
    check_version(run)
    return json_object(run / layout.RUN)


def check_version(run: Path) -> None:
    """Raise UsageError when the files of a run folder have a newer version, or run.json has an invalid one."""
    version = (json_object(run / layout.RUN) or {}).get("schema", SCHEMA)  # the first files had no version
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise UsageError(f"{run / layout.RUN} is damaged: its schema is not a version")
    if version > SCHEMA:
        raise UsageError(
            f"{run} is of a newer dronecats: its files have version {version}, this one reads {SCHEMA}. Update"
        )


def json_object(path: Path) -> dict[str, Any] | None:
    """Return the object in a JSON file; None when the file is missing, damaged, or not an object."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _of_kinds(path: Path, kinds: Mapping[str, type[Any]], never: str | None = None) -> Iterator[Any]:
    """Yield the rows of these kinds. Other kinds are skipped. A row of the kind `never` raises UsageError."""

    def strictly(line: LogLine, value: dict[str, Any]) -> Any:
        kind = value.get("kind")
        if not isinstance(kind, str):
            raise line.damaged("it has no kind")
        if kind == never:
            raise line.damaged(f"a row of the kind {never} does not belong into this file")
        return line.row(value, kinds[kind]) if kind in kinds else None

    return _read(path, fast_reader_of_kinds(kinds), strictly)


def _read(
    path: Path, at_once: "FastReader[Row]", strictly: Callable[["LogLine", dict[str, Any]], Row | None]
) -> Iterator[Row]:
    """Yield the rows of a file. `strictly` reads the lines that the fast reader does not; None: skip the line."""
    for number, text in _lines(path):
        made = at_once(text)
        if made is None:
            line = LogLine(path, number, text)
            if (value := line.value()) is None:
                return
            made = strictly(line, value)
        if made is not None:
            yield made


Framed = TypeVar("Framed", FrameTruth, EstimatedFrame)


def _frames(frame_rows: list[Framed], path: Path) -> dict[tuple[int, int], Framed]:
    frames: dict[tuple[int, int], Framed] = {}
    for row in frame_rows:
        first = frames.setdefault((row.drone, row.frame_id), row)
        if first is not row and first != row:
            raise UsageError(
                f"{path} is damaged: frame {row.frame_id} of {drone_label(row.drone)} has two different rows"
            )
    return frames


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of a file of JSON lines, read strictly."""

    path: Path
    number: int  # from 1; negative: the last line, without a newline, which may be incomplete
    text: bytes

    def value(self) -> dict[str, Any] | None:
        """Return the JSON object in the line; None for an incomplete line. Raises UsageError."""
        try:
            value = json.loads(self.text, parse_constant=_reject_constant)
        except (ValueError, RecursionError):
            if self.number < 0:
                return None
            raise self.damaged("it is not JSON") from None
        if not isinstance(value, dict):
            raise self.damaged("it is not a JSON object")
        return value

    def row(self, value: dict[str, Any], row: type[Row]) -> Row:
        """Return `value`, the object in the line, as a row. Raises UsageError."""
        made, fault = parse_row(value, row)
        if made is None:
            raise self.damaged(str(fault))
        return made

    def damaged(self, reason: str) -> UsageError:
        return UsageError(f"{self.path} line {abs(self.number)} is damaged: {reason}")


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the lines that are not blank, with their numbers as in `LogLine`. Raises UsageError."""
    with file_errors_as(UsageError, f"{path} cannot be read", ". Name the folder of an episode"):
        data = path.read_bytes()
    texts = data.split(b"\n")
    for number, text in enumerate(texts, 1):
        if text and not text.isspace():
            yield (number if number < len(texts) else -number), text


def _reject_constant(constant: str) -> Any:
    raise ValueError(constant)


LONG = 4000  # bytes; longer lines get the strict reader: a number may have more digits than Python accepts
KIND = 15  # this many bytes at the beginning of a line show its kind, for example {"kind": "pose"

FastReader = Callable[[bytes], Row | None]  # line → its row; None: the strict reader must read it


def fast_reader(row: type[Row]) -> FastReader[Row]:
    """Return a fast reader of lines that all have the same kind of row."""
    decode: Callable[[bytes], Row] = decoder(row)
    checked = row is Decision

    def read(line: bytes) -> Row | None:
        made = _decoded(line, decode)
        return None if checked and made is not None and impossible(made) else made  # type: ignore[arg-type]

    return read


def fast_reader_of_kinds(kinds: Mapping[str, type[Row]]) -> FastReader[Row]:
    """Return a fast reader of lines that have these kinds of rows. The first bytes of a line show its kind."""
    decoders = {f'{{"kind": "{kind}", '.encode()[:KIND]: decoder(row) for kind, row in kinds.items()}

    def read(line: bytes) -> Row | None:
        decode = decoders.get(line[:KIND])
        return _decoded(line, decode) if decode else None

    return read


def _decoded(line: bytes, decode: Callable[[bytes], Row]) -> Row | None:
    if len(line) > LONG or not line.isascii():  # msgspec does not check non-ASCII text in fields that it skips
        return None
    try:
        return decode(line)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


EARLY_S = 0.05  # s by which a picture may be newer than the telemetry that gives `t_decided`
AT = re.compile(r"\$\.(\w+)")  # the field in an error of msgspec


def parse_row(value: dict[str, Any], row: type[Row]) -> tuple[Row, None] | tuple[None, str]:
    """Return a JSON object as (row, None), or (None, description of its fault)."""
    try:
        made = convert(value, row)
    except msgspec.ValidationError as error:
        if missing := MISSING.search(str(error)):
            return None, f"it has no {missing[1]}"
        at = AT.search(str(error))
        return None, _wrong(row, at[1]) if at else str(error)
    except UnicodeError:  # half a surrogate pair, which UTF-8 cannot encode
        return None, "it has text that is not valid UTF-8"
    if large := next((name for name in fields_of(row) if _too_large(getattr(made, name))), None):
        return None, _wrong(row, large)
    fault = impossible(made) if isinstance(made, Decision) else None
    return (None, fault) if fault else (made, None)


def impossible(decision: Decision) -> str | None:
    """Return a message about an impossible value in a decision; None if all are possible."""
    if decision.action is not None and not isinstance(decision.action.get("action"), str):
        return "its action is not an action"
    if decision.t_decided < max(0.0, decision.t_frame - EARLY_S):
        return "its t_decided is before its t_frame" if decision.t_decided >= 0.0 else "its t_decided is below 0"
    return None


def _too_large(value: Any) -> bool:
    """Return whether a number, or a number in a tuple or dict, is too large for any measurement."""
    if isinstance(value, float):
        return not abs(value) < LARGE
    several = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
    return any(isinstance(item, float) and not abs(item) < LARGE for item in several)


def _wrong(row: type, name: str) -> str:
    return f"its {name} {rule_of(fields_of(row)[name]).words}"
