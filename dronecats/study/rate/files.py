"""What a measured chain leaves behind, beside an ordinary run folder: its questions, its trace, and a study of it."""

import csv
import json
import shlex
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from dronecats.agent.latency import LONGEST_S
from dronecats.flight.spec.flight_spec import COLUMN
from dronecats.study.rate.chain import DIGITS, QuestionTimes
from foundation.errors import InfrastructureError, UsageError

CHAIN, TRACE, STUDY = "chain.csv", "trace.csv", "study.toml"
COLUMNS = tuple(field.name for field in fields(QuestionTimes))


@dataclass(frozen=True, slots=True)
class ReplayedChain:
    """A measured chain as a simulation has it."""

    trace: Path
    frame_delay_s: float  # 0: none


class ChainLog:
    """chain.csv: a header, and a line a question, on disk as soon as it is through."""

    def __init__(self, folder: Path) -> None:
        """Begin it anew. Raises InfrastructureError."""
        try:
            self._file = (folder / CHAIN).open("w", encoding="utf-8", newline="")
            self._rows = csv.writer(self._file)
            self._put(COLUMNS)
        except OSError as error:
            raise _unwritten(folder / CHAIN, error) from None

    def write(self, times: QuestionTimes) -> None:
        """Append a question. Raises InfrastructureError."""
        try:
            self._put(["" if each is None else each for each in astuple(times)])
        except OSError as error:
            raise _unwritten(Path(self._file.name), error) from None

    def close(self) -> None:
        self._file.close()

    def _put(self, row: Sequence[object]) -> None:
        self._rows.writerow(row)
        self._file.flush()


def check_fresh(folder: Path) -> None:
    """Raise UsageError where a chain was measured before: the next one is no part of it."""
    if (folder / CHAIN).exists():
        raise UsageError(f"{folder} already holds a chain that was measured; choose another --out")


def write_replay(folder: Path, times: Sequence[QuestionTimes], frame_delay_s: float) -> ReplayedChain:
    """Write trace.csv, as `--latency trace:FILE` reads it, and study.toml, which studies it. InfrastructureError."""
    replayed = ReplayedChain(folder / TRACE, frame_delay_s)
    lines = [COLUMN, *(f"{min(each.latency_s, LONGEST_S):.{DIGITS}f}" for each in times)]
    for path, text in ((replayed.trace, "\n".join(lines) + "\n"), (folder / STUDY, study_file(replayed))):
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise _unwritten(path, error) from None
    return replayed


def study_file(chain: ReplayedChain) -> str:
    """Return a study of what the chain costs, against one that costs nothing."""
    delays = [0, chain.frame_delay_s] if chain.frame_delay_s else []
    return "\n".join(
        [
            "# What a measured chain costs, its replies and the age of its pictures apart: docs/rate.md",
            'name = "measured-chain"',
            'pilot = ["noisy"]',
            'cells = ["tracking", "approaching"]',
            'suite = "one-drone"',
            "",
            "[factors]",
            f"latency_policy = {json.dumps(['fixed:0', f'trace:{chain.trace.name}'], ensure_ascii=False)}",
            *([f"frame_delay = {json.dumps(delays)}"] if delays else []),
            "",
        ]
    )


def next_commands(chain: ReplayedChain) -> list[str]:
    """Return the commands that fly on with what was measured: a flight, a benchmark, the study."""
    delay = ["--frame-delay", f"{chain.frame_delay_s:g}"] if chain.frame_delay_s else []
    latency = ["--latency", f"trace:{chain.trace}", *delay]
    folder = chain.trace.parent
    return [
        shlex.join(["dronecats", *words])
        for words in (
            ["fly", "--sitl", "--speed", "max", *latency],
            ["bench", "--suite", "quick", "--pilot", "vision", *latency, "--out", f"{folder}-bench"],
            ["study", "run", str(folder / STUDY), "--out", f"{folder}-study"],
        )
    ]


def _unwritten(path: Path, error: OSError) -> InfrastructureError:
    return InfrastructureError(f"{path} cannot be written: {error.strerror}; what was measured is lost from there on")
