"""Which formats there are, and how runs become files: one an episode, or one set of files for all."""

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dronecats.report.export.flight import ExportedFlight, exported_flight
from dronecats.report.results import tabulation
from dronecats.report.results.flown_run import FlownRun
from foundation.errors import UsageError
from foundation.whole_file import whole_file

FILE_OF_EPISODE = {
    "mcap": (".mcap", "mcap"),
    "rerun": (".rrd", "rerun"),
    "ulog": (".ulg", "ulog"),
    "kml": (".kml", "kml"),
    "geojson": (".geojson", "geojson"),
}  # format → the ending of its files, the module of this room that writes one
TABLES = ("csv", "parquet")
DATASETS = ("lerobot",)
FORMATS = (*FILE_OF_EPISODE, *DATASETS, *TABLES)
BESIDE = {  # format → what writes the files that go with all of its own
    "mcap": "dronecats.report.export.foxglove_layout",
    "ulog": "dronecats.report.export.plotjuggler_layout",
}

Writer = Callable[[ExportedFlight, Path], int]  # writes one flight, and returns how much of it there is


@dataclass(slots=True)
class Exported:
    """What an export came to."""

    files: dict[Path, int] = field(default_factory=dict)  # file or folder → messages, places, rows or frames in it
    left_out: list[str] = field(default_factory=list)  # a sentence an episode that is in none of them


def export(kind: str, runs: Sequence[FlownRun], out: Path, overwrite: bool = False) -> Exported:
    """Write runs in a format into a folder. Raises UsageError, before anything is written where it can tell."""
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file; name a folder")
    try:
        if kind in TABLES:
            return _tables(kind, runs, out, overwrite)
        if kind in DATASETS:
            return _dataset(runs, out, overwrite)
        return _files(kind, runs, out, overwrite)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}; choose another --out") from None


def _files(kind: str, runs: Sequence[FlownRun], out: Path, overwrite: bool) -> Exported:
    suffix, module = FILE_OF_EPISODE[kind]
    write: Writer = importlib.import_module(f"dronecats.report.export.{module}").write
    wanted = [(run, folder, out / f"{name}{suffix}") for run, folder, name in _named(runs)]
    beside = importlib.import_module(BESIDE[kind]) if kind in BESIDE else None
    _refuse([path for _, _, path in wanted] + [out / name for name in (beside.NAMES if beside else ())], overwrite)
    done = Exported()
    drones: set[int] = set()
    for run, folder, path in wanted:
        if (flight := _flight(run, folder, done)) is None:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with whole_file(path) as draft:
                count = write(flight, draft)
        except UsageError as said:
            done.left_out.append(str(said))
            continue
        done.files[path] = count
        drones.add(len(flight.drones))
    if beside and drones:
        for name, count in beside.wanted(drones).items():
            done.files[out / name] = beside.write(count, out / name)
    return _something(done)


def _dataset(runs: Sequence[FlownRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.export import lerobot

    done = Exported()
    flights = (flight for run, folder, _ in _named(runs) if (flight := _flight(run, folder, done)) is not None)
    done.files[out] = lerobot.write(flights, out, overwrite, done.left_out)
    return done


def _tables(kind: str, runs: Sequence[FlownRun], out: Path, overwrite: bool) -> Exported:
    from dronecats.report.export import tables
    from dronecats.report.results.table_files import TableFormat

    told: TableFormat = "csv" if kind == "csv" else "parquet"
    _refuse(tables.files(told, out), overwrite)
    rows, damage = tables.write(told, runs, out)
    return Exported(rows, damage)


def _named(runs: Sequence[FlownRun]) -> Iterator[tuple[FlownRun, Path, str]]:
    """Yield (run, episode folder, its name), of several runs the run's name before it."""
    for run, name in zip(runs, tabulation.names(runs), strict=True):
        for folder in run.episodes:
            yield run, folder, f"{name}/{folder.resolve().name}" if len(runs) > 1 else folder.resolve().name


def _flight(run: FlownRun, folder: Path, done: Exported) -> ExportedFlight | None:
    """Return an episode, None where it is left out, which is told."""
    try:
        return exported_flight(run, folder)
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
