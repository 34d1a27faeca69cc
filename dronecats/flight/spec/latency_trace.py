"""Latencies that were recorded, as a flight has them: the numbers themselves, since a file is one machine's."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import UNSET

from dronecats.agent.latency import TRACE, TRACE_MAX, LatencyPolicy, split_policy, trace_name
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision

COLUMN = "latency_s"  # of a CSV file
BYTES_MAX = 4_000_000
AT = "@"  # between a file's name and what its latencies are known by


def latency_policy(text: str, recorded: Sequence[float] | None = None) -> LatencyPolicy:
    """Return the policy of a text; the file of a `trace:FILE` is read.

    `recorded`: latencies (s) that are there already, for a text that `carried` gave of them: no file is read then.
    Raises UsageError for a policy that is none, and for a file that holds no latencies.
    """
    file = _file(text)
    if file is None:
        return LatencyPolicy.parse(text)
    trace = recorded if recorded is not None and trace_name(recorded) == digest_of(text) else read_trace(Path(file))
    return LatencyPolicy.parse(_instead(text, trace_name(trace)), trace)


def carried(text: str) -> str:
    """Return the words of a policy as they hold on every machine: of `trace:FILE`, `trace:NAME@DIGEST`.

    NAME is the file's without its folder, for people, DIGEST what `trace_name` gives. Raises UsageError as
    `read_trace` does.
    """
    file = _file(text)
    return (
        text if file is None else _instead(text, f"{Path(file).resolve().name}{AT}{trace_name(read_trace(Path(file)))}")
    )


def from_folder(text: str, folder: Path) -> str:
    """Return the words of a policy with the FILE of its `trace:FILE`, unless it is absolute, in a folder."""
    file = _file(text)
    return text if file is None else _instead(text, str(folder / file))


def digest_of(text: str) -> str | None:
    """Return by which name the recorded latencies of words that `carried` gave are known; None: they have none."""
    file = _file(text)
    return file.rpartition(AT)[2] if file and AT in file else None


def _file(text: str) -> str | None:
    return next((part.partition(":")[2] for part in split_policy(text) if part.startswith(f"{TRACE}:")), None)


def _instead(text: str, name: str) -> str:
    parts = split_policy(text)
    return "+".join(f"{TRACE}:{name}" if part == f"{TRACE}:{_file(text)}" else part for part in parts)


def read_trace(path: Path) -> tuple[float, ...]:
    """Return the latencies (s) of a run or episode folder in the order of its steps, or of a CSV file.

    Of a CSV that is the column `latency_s`, or its only one. Raises UsageError.
    """
    if path.exists() and not (path.is_dir() or path.is_file()):
        raise UsageError(f"--latency trace:{path} is no file; name a run folder or a CSV file")
    try:
        found = _of_run(path) if path.is_dir() else _of_csv(path)
    except OSError as error:
        raise UsageError(f"--latency trace:{path} cannot be read: {error.strerror}") from None
    if not found:
        raise UsageError(f"--latency trace:{path} holds no latency; name a run that took steps, or a CSV file")
    if len(found) > TRACE_MAX:
        raise UsageError(f"--latency trace:{path} holds {len(found):,} latencies; {TRACE_MAX:,} are the most")
    return tuple(round(seconds, 6) for seconds in found)


def _of_run(folder: Path) -> list[float]:
    own = folder / layout.DECISIONS
    logs = [own] if own.exists() else sorted(folder.rglob(layout.DECISIONS))
    return [seconds for log in logs for seconds in _of_steps(log)]


def _of_steps(log: Path) -> Iterator[float]:
    """Yield what each question's reply took: of those that were asked for together once, of a commander's word none."""
    told: set[int] = set()
    for said in rows(log, Decision):
        if said.latency_s is not None and said.confirmed_by is UNSET and said.step not in told:
            told.add(said.step)
            yield said.latency_s


def _of_csv(path: Path) -> list[float]:
    if path.stat().st_size > BYTES_MAX:
        raise UsageError(f"--latency trace:{path} is longer than {TRACE_MAX:,} latencies can be")
    try:
        lines = [line for line in csv.reader(path.read_text(encoding="utf-8").splitlines()) if line]
    except (ValueError, csv.Error):
        raise UsageError(f"--latency trace:{path} is not CSV, nor a run folder") from None
    if not lines:
        return []
    head = [cell.strip() for cell in lines[0]]
    if COLUMN in head:
        column, lines = head.index(COLUMN), lines[1:]
    elif len(head) == 1:
        column = 0
    else:
        raise UsageError(f"--latency trace:{path} has several columns, and none of them is {COLUMN}")
    return [_number(path, number, line, column) for number, line in enumerate(lines, 1)]


def _number(path: Path, number: int, line: list[str], column: int) -> float:
    try:
        return float(line[column])
    except (ValueError, IndexError):
        raise UsageError(f"--latency trace:{path} has no number of seconds as its latency {number}") from None
