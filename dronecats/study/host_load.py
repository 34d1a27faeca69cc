"""Measures the effect of a busy host on flights in lockstep and in real time, while other processes load the CPU."""

import hashlib
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from dronecats.bench.campaign import Batch, fly_run
from dronecats.flight.run.fly import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.judge.statistics.shares import wilson
from dronecats.report.table import CellValue, ReportTable, numbers, table_of, words
from dronecats.report.writers import as_markdown, as_shell
from foundation.errors import InfrastructureError
from foundation.files import file_errors_as
from foundation.run_folder import layout
from foundation.run_folder.reading import stored_result
from foundation.run_folder.results import SCORED

# the program ends soon after its parent process, even if the parent was killed
BUSY_PROGRAM = """
import os, sys
parent = int(sys.argv[1])
while os.getppid() == parent:
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run `count` processes that load the CPU during the block.

    Each process has its own session. Linux may divide processor time between sessions (sched(7), autogroup). Then all
    processes of one session together would get the processor time of one process.
    """
    command = [sys.executable, "-c", BUSY_PROGRAM, str(os.getpid())]
    started = [subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True) for _ in range(count)]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


Clock = Literal["lockstep", "real time"]
CLOCKS: tuple[Clock, ...] = ("lockstep", "real time")
LOGS = (layout.DECISIONS, layout.TRUTH, layout.VERDICT)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFlight:
    """The result of one flight while `busy` processes load the CPU."""

    episode: str
    clock: Clock
    busy: int  # number of processes that load the CPU
    flight: int  # number of this flight of the episode, from 1; the seed is this number minus 1
    success: bool
    ne_m: float | None  # m, navigation error in the verdict
    steps: int
    stalled_steps: int  # steps that the host delayed, counted as in `bench`
    digest: str  # SHA-256 of the contents of LOGS

    @property
    def marked(self) -> bool:
        """Whether `bench --drop-stalled` leaves the flight out."""
        return self.stalled_steps > 0


def fly(
    flight: FlightSpec,
    episodes: Sequence[str],
    levels: Sequence[int],
    *,
    flights: int,
    jobs: int,
    out: Path,
    progress: Callable[[str], None],
) -> list[LoadedFlight]:
    """Fly the missing flights into a folder, level by level, and return all flights. Raises DronecatsError.

    `flight`: a flight in real time without an episode. `levels`: numbers of processes that load the CPU; the first
    level is the reference. `flights`: flights of each episode with each clock at each level. `jobs`: flights at the
    same time. The flights of both clocks are validated before the first one starts.
    """
    for clock in CLOCKS:
        look_up(_with_clock(flight, clock, 1))
    flown: list[LoadedFlight] = []
    for level in levels:
        for clock in CLOCKS:
            progress(f"{clock}, with {level} busy processes …")
            for number in range(1, flights + 1):
                flown += _fly_level(_with_clock(flight, clock, number), episodes, jobs, out, (clock, level, number))
    return flown


def _with_clock(flight: FlightSpec, clock: Clock, number: int) -> FlightSpec:
    """Return the specification of all flights with this number (from 1), in lockstep or in real time."""
    simulated = flight.simulated
    assert simulated is not None
    simulated = replace(simulated, speed=None) if clock == "lockstep" else simulated
    return replace(flight, simulated=simulated, seed=number - 1)


def _fly_level(
    flight: FlightSpec, episodes: Sequence[str], jobs: int, out: Path, place: tuple[Clock, int, int]
) -> Iterator[LoadedFlight]:
    """Fly the missing flights of one `place`: (clock, level, number)."""
    clock, level, number = place
    assembled = look_up(flight)
    batch = Batch(out / f"{clock.replace(' ', '-')}-busy-{level}-f{number}", settings(assembled, assembled.camera))
    try:
        if batch.left(episodes):
            with busy(level):
                fly_run(batch, flight, episodes, jobs)
        for episode in episodes:
            folder = batch.folder(episode)
            result = stored_result(folder.name, folder)
            if result.outcome not in SCORED:
                raise InfrastructureError(
                    f"{folder} did not reach its end: {result.error or result.outcome}. Repeat the command"
                )
            yield LoadedFlight(
                episode=folder.name,
                clock=clock,
                busy=level,
                flight=number,
                success=bool(result.success),
                ne_m=result.ne_m,
                steps=result.steps,
                stalled_steps=result.host_stalls if isinstance(result.host_stalls, int) else 0,
                digest=log_digest(folder),
            )
    finally:
        batch.close()


def log_digest(folder: Path) -> str:
    """Return the SHA-256 of the logs and the verdict in an episode's folder."""
    sha256 = hashlib.sha256()
    for name in LOGS:
        sha256.update((folder / name).read_bytes())
    return sha256.hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelRow:
    """Counts over the flights with one clock at one level (`busy`). `compare` defines the reference flights."""

    clock: Clock
    busy: int
    flights: int
    solved: int
    moved: int  # flights that succeeded although the reference failed, or the reverse
    other_bytes: int  # flights with another `digest` than the reference; flights in real time always differ
    ne_moved_m: float | None  # m, median difference in NE from the reference
    marked: int  # flights that `bench` marks as delayed by the host
    stalled_steps: int
    steps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Marking:
    """Numbers of marked and of moved flights in real time. LoadFindings defines "moved"."""

    moved: int
    marked: int  # flights that `bench` marks as delayed by the host
    both: int  # flights that are marked and moved
    precision: (
        tuple[float, float, float] | None
    )  # share of the marked that moved, Wilson's interval; None: none is marked
    recall: tuple[float, float, float] | None  # share of the moved that are marked, and its interval; None: none moved


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFindings:
    rows: Sequence[LevelRow]
    marking_of_verdicts: Marking  # a flight moved if only one of flight and reference succeeded
    # without the first level; a flight moved if its NE differs from the reference by more than idle_error_m
    marking_of_errors: Marking
    idle_error_m: float | None  # m, largest NE difference from the reference among real-time flights at the first level


def compare(flights: Sequence[LoadedFlight]) -> LoadFindings:
    """Return the findings. The reference of a flight is its lockstep flight at the first level."""
    first = flights[0].busy
    reference = {(f.episode, f.flight): f for f in flights if f.clock == "lockstep" and f.busy == first}
    groups: dict[tuple[Clock, int], list[LoadedFlight]] = {}
    for flight in flights:
        groups.setdefault((flight.clock, flight.busy), []).append(flight)
    rows = [_level_row(clock, busy, members, reference) for (clock, busy), members in groups.items()]
    real = [flight for flight in flights if flight.clock == "real time"]
    errors_m = {id(flight): ne_difference_m(flight, reference[flight.episode, flight.flight]) for flight in real}
    idle = [m for flight in real if flight.busy == first and (m := errors_m[id(flight)]) is not None]
    farthest = max(idle, default=None)
    strayed = [f for f in real if farthest is not None and (errors_m[id(f)] or 0.0) > farthest]
    return LoadFindings(
        rows=rows,
        marking_of_verdicts=_marking(real, [f for f in real if f.success != reference[f.episode, f.flight].success]),
        marking_of_errors=_marking([f for f in real if f.busy != first], strayed),
        idle_error_m=farthest,
    )


def ne_difference_m(first: LoadedFlight, second: LoadedFlight) -> float | None:
    """Return the difference (m) in NE of two flights; None if one has no NE."""
    if first.ne_m is None or second.ne_m is None:
        return None
    return abs(first.ne_m - second.ne_m)


def _level_row(
    clock: Clock, busy: int, members: Sequence[LoadedFlight], reference: dict[tuple[str, int], LoadedFlight]
) -> LevelRow:
    pairs = [(flight, reference[flight.episode, flight.flight]) for flight in members]
    moved_m = [m for first, second in pairs if (m := ne_difference_m(first, second)) is not None]
    return LevelRow(
        clock=clock,
        busy=busy,
        flights=len(members),
        solved=sum(flight.success for flight in members),
        moved=sum(first.success != second.success for first, second in pairs),
        other_bytes=sum(first.digest != second.digest for first, second in pairs),
        ne_moved_m=round(statistics.median(moved_m), 3) if moved_m else None,
        marked=sum(flight.marked for flight in members),
        stalled_steps=sum(flight.stalled_steps for flight in members),
        steps=sum(flight.steps for flight in members),
    )


def _marking(flights: Sequence[LoadedFlight], moved: Sequence[LoadedFlight]) -> Marking:
    marked, both = sum(flight.marked for flight in flights), sum(flight.marked for flight in moved)
    return Marking(
        moved=len(moved), marked=marked, both=both, precision=_share(both, marked), recall=_share(both, len(moved))
    )


def _share(part: int, total: int) -> tuple[float, float, float] | None:
    return (part / total, *wilson(part, total)) if total else None


NAME = "host-load"
TEXT = """This page shows how a busy host changes flights. The study flies each episode in lockstep and in real
time. Meanwhile several processes load the processor (*busy* is their number). The lockstep flights in the first row of
the table are the reference. The study compares each flight with the reference flight of the same episode and seed.

| column | meaning |
| --- | --- |
| solved | flights that succeeded |
| changed | flights whose verdict differs from the reference |
| log differs | flights whose log differs from the reference; in real time every flight |
| marked | flights that `bench` marks as delayed by the host; `--drop-stalled` leaves them out |
| delayed steps | steps that the host delayed, of all steps |
| change of NE | median difference of the navigation error (NE) from the reference |
| precision | share of the marked flights that changed |
| recall | share of the changed flights that were marked |"""


def tables(findings: LoadFindings) -> list[ReportTable]:
    """Return the table of levels, and the table of marked and moved flights."""
    levels = [words("clock"), *map(numbers, ("busy", "flights", "solved", "changed", "log differs", "marked",
                                             "delayed steps", "change of NE"))]  # fmt: skip
    rows = (
        (r.clock, r.busy, r.flights, r.solved, r.moved, r.other_bytes, r.marked, f"{r.stalled_steps} of {r.steps}",
         None if r.ne_moved_m is None else f"{r.ne_moved_m:.2f} m")
        for r in findings.rows
    )  # fmt: skip
    marks = [
        words("definition of changed (real time only)"),
        *map(numbers, ("changed", "marked", "both", "precision", "recall")),
    ]
    lines = [_mark_cells("other verdict", findings.marking_of_verdicts)]
    if findings.idle_error_m is not None:
        case = (
            f"NE differs from the reference by more than {findings.idle_error_m:.2f} m. This threshold is the largest"
            f" difference with {findings.rows[0].busy} busy processes"
        )
        lines.append(_mark_cells(case, findings.marking_of_errors))
    return [table_of(levels, rows), table_of(marks, lines)]


def _mark_cells(case: str, marking: Marking) -> tuple[CellValue, ...]:
    shares = (
        None if share is None else f"{100 * share[0]:.0f} % ({100 * share[1]:.0f} … {100 * share[2]:.0f})"
        for share in (marking.precision, marking.recall)
    )
    return case, marking.moved, marking.marked, marking.both, *shares


def write(findings: LoadFindings, out: Path, command: str, machine: str) -> Sequence[Path]:
    """Write the page and the JSON file into a folder and return their paths. Raises InfrastructureError."""
    page, data = out / f"{NAME}.md", out / f"{NAME}.json"
    with file_errors_as(InfrastructureError, f"{out} cannot be written"):
        made = "\n".join(map(as_markdown, tables(findings)))
        head = f"# A busy host\n\n{as_shell([command])}\n{TEXT}\n\n"
        page.write_text(f"{head}{made}\n{machine}\n", encoding="utf-8")
        data.write_text(json.dumps({"command": command, **asdict(findings)}, indent=1) + "\n", encoding="utf-8")
    return page, data
