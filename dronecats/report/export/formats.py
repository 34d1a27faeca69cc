"""Exports runs in other formats: one file per episode, or one set of files for all episodes.

docs/query.md describes the tables. The name of a column begins with `judge/` if its data is hidden from the pilot.
The module of a format needs its own packages, so it is imported only when the format is used.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dronecats.report.export import layouts
from dronecats.report.export.conventions import JUDGE
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results import tables as tabulation
from dronecats.report.results.tables import TABLES
from foundation.errors import UsageError
from foundation.files import check_folder, file_errors_as, whole_file
from foundation.run_folder import layout

FILE_OF_EPISODE = {
    "mcap": (".mcap", "mcap", "write"),
    "rerun": (".rrd", "rerun", "write"),
    "ulog": (".ulg", "ulog", "write"),
    "kml": (".kml", "maps", "write_kml"),
    "geojson": (".geojson", "maps", "write_geojson"),
}  # format → suffix of its files, module of this package, function that writes a file
FILES_OF_TABLES = ("csv", "parquet")
DATASETS = ("lerobot",)
FORMATS = (*FILE_OF_EPISODE, *DATASETS, *FILES_OF_TABLES)
OPEN_EPISODE = frozenset({"run", "episode", "map", "cell", "instruction", "drones", "ended", "ended_s"})
OPEN_COSTS = frozenset({"questions", "median_latency_s", "rate_hz_5", "rate_hz_50", "rate_hz_95", "all_tokens_in",
                   "all_tokens_out", "decisions", "unreadable", "refused", "cut_off"})  # fmt: skip
OPEN_STEP = frozenset({"run", "episode", "drone_index", "step", "frame_id", "t_frame_s", "t_decided_s", "action",
                     "point_x", "point_y", "depth_m", "angle_deg", "reply", "error", "mended", "latency_s", "tokens_in",
                     "tokens_out", "thinking", "rate_hz", "finish", "rescaled", "wide_rotation"})  # fmt: skip
# table → columns with data that the pilot may have; only the judge has the data of the other columns
OPEN: Mapping[str, frozenset[str]] = {
    "runs": frozenset(column.name for column in TABLES["runs"].columns),
    "episodes": OPEN_EPISODE | OPEN_COSTS | {"wide_rotations"},
    "steps": OPEN_STEP,
    "poses": frozenset({"run", "episode", "drone_index", "t_s"}),
    "declarations": frozenset({"run", "episode", "number", "drone_index", "step", "t_s", "counts"}),
}

Writer = Callable[[RecordedFlight, Path], int]  # writes one flight; returns the number of messages or places


@dataclass(slots=True)
class Exported:
    """The files of an export, and the omitted episodes."""

    files: dict[Path, int] = field(default_factory=dict)  # file or folder → number of messages, places, rows or frames
    left_out: list[str] = field(default_factory=list)  # a sentence for each omitted episode


def export(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool = False) -> Exported:
    """Write runs in a format into a folder. Raises UsageError, if possible before it writes a file."""
    check_folder(out)
    with file_errors_as(UsageError, f"{out} cannot be written", ". Choose another --out"):
        if kind in FILES_OF_TABLES:
            return _tables(kind, runs, out, overwrite)
        if kind in DATASETS:
            return _dataset(runs, out, overwrite)
        return _files(kind, runs, out, overwrite)


def _files(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    suffix, module, function = FILE_OF_EPISODE[kind]
    write: Writer = getattr(importlib.import_module(f"dronecats.report.export.{module}"), function)
    wanted = [(folder, out / f"{name}{suffix}") for folder, name in _named(runs)]
    _check_free([path for _, path in wanted] + [out / name for name in layouts.FILES.get(kind, ())], overwrite)
    done = Exported()
    drones: set[int] = set()
    for folder, path in wanted:
        if (flight := _flight(folder, done)) is None:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with whole_file(path) as draft:
                count = write(flight, draft)
        except UsageError as error:
            done.left_out.append(str(error))
            continue
        done.files[path] = count
        drones.add(len(flight.drone_tracks))
    if kind in layouts.FILES and drones:
        for name, count in layouts.layout_files(kind, drones).items():
            done.files[out / name] = layouts.write(out / name, count)
    return _check_not_empty(done)


def _dataset(runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.export import lerobot

    done = Exported()
    flights = (flight for folder, _ in _named(runs) if (flight := _flight(folder, done)) is not None)
    done.files[out] = lerobot.write(flights, out, overwrite, done.left_out)
    return done


def _tables(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.results.database import TableFormat, table_file, write_tables

    ending: TableFormat = "csv" if kind == "csv" else "parquet"
    _check_free([table_file(ending, table, out) for table in TABLES], overwrite)
    rows, damage = write_tables(ending, runs, out, column_name)
    return Exported({table_file(ending, table, out): count for table, count in rows.items()}, damage)


def column_name(table: str, column: str) -> str:
    """Return the name of a table's column in the exported files."""
    return column if column in OPEN[table] else f"{JUDGE}/{column}"


def _named(runs: Sequence[RecordedRun]) -> Iterator[tuple[Path, str]]:
    """Yield (episode folder, its name in the export). With several runs, the name begins with the run's name."""
    for run, name in zip(runs, tabulation.names(runs), strict=True):
        for folder in run.episodes:
            yield folder, f"{name}/{folder.resolve().name}" if len(runs) > 1 else folder.resolve().name


def finished_flight(folder: Path) -> RecordedFlight:
    """Return the flight of an episode folder. Raises UsageError if the flight is damaged or unfinished."""
    flight = RecordedFlight.read(folder)
    logs = flight.logs
    if logs.begin is None or logs.end is None:
        missing = "has no beginning" if logs.begin is None else "has no end"
        raise UsageError(f"{folder} is unfinished: its {layout.TRUTH} {missing}")
    assert flight.frames is not None
    assert flight.drone_tracks  # both asserts read files, so that a damaged file fails before the export writes
    return flight


def _flight(folder: Path, done: Exported) -> RecordedFlight | None:
    """Return a flight. If the flight cannot be exported, add a sentence to `done` and return None."""
    try:
        return finished_flight(folder)
    except UsageError as error:
        done.left_out.append(str(error))
        return None


def _check_free(wanted: Sequence[Path], overwrite: bool) -> None:
    existing = [path for path in wanted if path.exists()]
    if existing and not overwrite:
        exist = f"and {len(existing) - 1} more exist" if len(existing) > 1 else "exists"
        raise UsageError(f"{existing[0]} {exist} already. Choose another --out, or replace with --overwrite")


def _check_not_empty(done: Exported) -> Exported:
    if not done.files:
        raise UsageError(f"nothing was exported: {'; '.join(done.left_out) or 'there is no episode'}")
    return done
