"""Which formats there are, and how runs become files: one an episode, or one set of files for all.

The tables are those of docs/query.md; what the judge knows and the agent did not is in columns under `judge/`. Which
packages a format needs, its module imports.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dronecats.report.export import layouts
from dronecats.report.export.conventions import JUDGE
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results import tabulation
from dronecats.report.results.tables import TABLES
from foundation.errors import UsageError
from foundation.files import whole_file
from foundation.run_folder import layout

FILE_OF_EPISODE = {
    "mcap": (".mcap", "mcap", "write"),
    "rerun": (".rrd", "rerun", "write"),
    "ulog": (".ulg", "ulog", "write"),
    "kml": (".kml", "maps", "write_kml"),
    "geojson": (".geojson", "maps", "write_geojson"),
}  # format → the ending of its files, the module of this room that writes one, its function
FILES_OF_TABLES = ("csv", "parquet")
DATASETS = ("lerobot",)
FORMATS = (*FILE_OF_EPISODE, *DATASETS, *FILES_OF_TABLES)
OF_EPISODE = frozenset({"run", "episode", "map", "cell", "instruction", "drones", "ended", "ended_s"})
COSTS = frozenset({"questions", "median_latency_s", "rate_hz_5", "rate_hz_50", "rate_hz_95", "all_tokens_in",
                   "all_tokens_out", "decisions", "unreadable", "refused", "cut_off"})  # fmt: skip
OF_STEP = frozenset({"run", "episode", "drone_index", "step", "frame_id", "t_frame_s", "t_decided_s", "action",
                     "point_x", "point_y", "depth_m", "angle_deg", "reply", "error", "mended", "latency_s", "tokens_in",
                     "tokens_out", "thinking", "rate_hz", "finish", "rescaled", "wide_rotation"})  # fmt: skip
# table → columns that anybody could know who had flown the drone; all others of these tables are the judge's
OPEN: Mapping[str, frozenset[str]] = {
    "runs": frozenset(column.name for column in TABLES["runs"].columns),
    "episodes": OF_EPISODE | COSTS | {"wide_rotations"},
    "steps": OF_STEP,
    "poses": frozenset({"run", "episode", "drone_index", "t_s"}),
    "declarations": frozenset({"run", "episode", "number", "drone_index", "step", "t_s", "counts"}),
}

Writer = Callable[[RecordedFlight, Path], int]  # writes one flight, and returns how much of it there is


@dataclass(slots=True)
class Exported:
    """What an export came to."""

    files: dict[Path, int] = field(default_factory=dict)  # file or folder → messages, places, rows or frames in it
    left_out: list[str] = field(default_factory=list)  # a sentence an episode that is in none of them


def export(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool = False) -> Exported:
    """Write runs in a format into a folder. Raises UsageError, before anything is written where it can tell."""
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file; name a folder")
    try:
        if kind in FILES_OF_TABLES:
            return _tables(kind, runs, out, overwrite)
        if kind in DATASETS:
            return _dataset(runs, out, overwrite)
        return _files(kind, runs, out, overwrite)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}; choose another --out") from None


def _files(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    suffix, module, function = FILE_OF_EPISODE[kind]
    write: Writer = getattr(importlib.import_module(f"dronecats.report.export.{module}"), function)
    wanted = [(folder, out / f"{name}{suffix}") for _, folder, name in _named(runs)]
    _refuse([path for _, path in wanted] + [out / name for name in layouts.FILES.get(kind, ())], overwrite)
    done = Exported()
    drones: set[int] = set()
    for folder, path in wanted:
        if (flight := _flight(folder, done)) is None:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with whole_file(path) as draft:
                count = write(flight, draft)
        except UsageError as said:
            done.left_out.append(str(said))
            continue
        done.files[path] = count
        drones.add(len(flight.drone_tracks))
    if kind in layouts.FILES and drones:
        for name, count in layouts.wanted(kind, drones).items():
            done.files[out / name] = layouts.write(out / name, count)
    return _something(done)


def _dataset(runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.export import lerobot

    done = Exported()
    flights = (flight for _, folder, _ in _named(runs) if (flight := _flight(folder, done)) is not None)
    done.files[out] = lerobot.write(flights, out, overwrite, done.left_out)
    return done


def _tables(kind: str, runs: Sequence[RecordedRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.results.database import TableFormat, table_file, write_tables

    ending: TableFormat = "csv" if kind == "csv" else "parquet"
    _refuse([table_file(ending, table, out) for table in TABLES], overwrite)
    rows, damage = write_tables(ending, runs, out, column_name)
    return Exported({table_file(ending, table, out): count for table, count in rows.items()}, damage)


def column_name(table: str, column: str) -> str:
    """Return what a column of a table is called in the files."""
    return column if column in OPEN[table] else f"{JUDGE}/{column}"


def _named(runs: Sequence[RecordedRun]) -> Iterator[tuple[RecordedRun, Path, str]]:
    """Yield (run, episode folder, its name), of several runs the run's name before it."""
    for run, name in zip(runs, tabulation.names(runs), strict=True):
        for folder in run.episodes:
            yield run, folder, f"{name}/{folder.resolve().name}" if len(runs) > 1 else folder.resolve().name


def finished_flight(folder: Path) -> RecordedFlight:
    """Return the flight of an episode folder, which tells all that a format needs.

    Raises UsageError when it is damaged or was never flown to its end.
    """
    flight = RecordedFlight.read(folder)
    logs = flight.logs
    if logs.begin is None or logs.end is None:
        missing = "has no beginning" if logs.begin is None else "has no end"
        raise UsageError(f"{folder} is unfinished: its {layout.TRUTH} {missing}")
    assert flight.frames is not None
    assert flight.drone_tracks  # read here, so that what is damaged is told before anything is written
    return flight


def _flight(folder: Path, done: Exported) -> RecordedFlight | None:
    """Return a flight, None where it is left out, which is told."""
    try:
        return finished_flight(folder)
    except UsageError as said:
        done.left_out.append(str(said))
        return None


def _refuse(wanted: Sequence[Path], overwrite: bool) -> None:
    there = [path for path in wanted if path.exists()]
    if there and not overwrite:
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise UsageError(f"{there[0]}{more} exists already: choose another --out, or write it anew with --overwrite")


def _something(done: Exported) -> Exported:
    if not done.files:
        raise UsageError(f"nothing was exported: {'; '.join(done.left_out) or 'there is no episode'}")
    return done
