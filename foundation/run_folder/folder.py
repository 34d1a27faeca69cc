"""Creates run folders and episode folders, and locks them. Layout: docs/run-folder.md."""

import contextlib
import fcntl
import json
import os
import platform
import re
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from importlib import metadata
from itertools import count
from pathlib import Path
from typing import Any, TextIO

from foundation.errors import UsageError
from foundation.files import write_json as write_json
from foundation.run_folder import layout
from foundation.run_folder.reading import SCHEMA, check_version, json_object, run_configuration
from foundation.version import __version__

PER_EPISODE = ("episode", "record")  # settings that may differ between the flights of one run
PER_RESUME = ("accounts",)  # settings that may change when a run is resumed
MEASURED = ("schema", "served_rate_hz", "pace", "firmware")  # keys of run.json that are not settings and not compared
SUITE = "suite"  # key that only benchmarks write to run.json; later flights in the same run keep its value
LOCK = ".lock"  # lock file in a run folder; every process that flies the run holds it
PACKAGES = ("numpy", "numba", "opencv-python-headless", "pymavlink", "httpx", "embreex", "scipy")


@contextlib.contextmanager
def create(
    out: Path | None,
    pilot_name: str,
    episode_id: str,
    configuration: dict[str, Any],
    first: Callable[[], None] = lambda: None,
) -> Iterator[Path]:
    """Yield a new episode folder with empty logs, in a run folder with run.json. Both are locked during the block.

    The run folder is `out`, or a new one named after the time and the pilot. An earlier flight of the episode without a
    score (killed, or its verdict is an error) is moved to UNFINISHED. `first` is called when the run folder exists and
    accepts this flight, before logs are written and before an earlier flight is moved. If `first` raises, a new run
    folder is removed again. Raises UsageError if `out` has a scored flight of the episode, has another configuration,
    or cannot be written.
    """
    with contextlib.ExitStack() as held:
        try:
            run = out or fresh_run(pilot_name)
            folder = run / episode_id
            run.mkdir(parents=True, exist_ok=True)
            held.enter_context(hold(run / LOCK, run, shared=True))
            again = (folder / layout.DECISIONS).exists()
            if again:
                held.enter_context(hold(folder / layout.DECISIONS, folder))
                if not _has_no_score(folder):
                    raise UsageError(f"{folder} already has a flight. Choose another folder with --out")
            _check_settings(run, configuration)
            held.callback(_remove_unused, run)
            first()
            if again:
                _set_aside(run, folder)
            prepare(folder)
            log = held.enter_context(hold(folder / layout.DECISIONS, folder))
            if log.tell() or (folder / layout.VERDICT).exists():  # another process has flown the episode during `first`
                raise UsageError(f"{folder} already has a flight. Choose another folder with --out")
            with _exclusive(run):
                _check_settings(run, configuration)  # again: another process may have begun the run during `first`
                write_run(run, configuration)
        except OSError as error:
            raise UsageError(_unwritable(out or Path("runs"), error)) from None
        yield folder


def _check_settings(run: Path, configuration: Mapping[str, Any]) -> None:
    before = run_configuration(run)
    if before is not None and (changed := differences(before, configuration)):
        raise UsageError(
            f"{run} is a run of another pilot or other settings ({', '.join(changed)}). Choose another folder"
            " with --out"
        )


@contextlib.contextmanager
def _exclusive(folder: Path) -> Iterator[None]:
    """Wait until no other process is in this block for the folder. Raises OSError."""
    directory = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(directory, fcntl.LOCK_EX)
        yield
    finally:
        os.close(directory)


def _remove_unused(run: Path) -> None:
    """Remove a run folder that holds nothing but its lock."""
    with contextlib.suppress(OSError):
        if [path.name for path in run.iterdir()] == [LOCK]:
            (run / LOCK).unlink()
            run.rmdir()


def hold(lock: Path, folder: Path, *, shared: bool = False) -> TextIO:
    """Lock a file and return it open. The lock lasts until the file is closed or the process ends.

    Raises UsageError if another process holds the lock, which means that it is flying `folder`. Raises OSError.
    """
    file = lock.open("a")
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise UsageError(
            f"another process is flying {folder}. Wait for it, or choose another folder with --out"
        ) from None
    return file


def prepare(folder: Path) -> None:
    """Create an episode folder with empty logs, so that a flight that logs nothing can be judged. Raises OSError."""
    (folder / layout.FRAMES).mkdir(parents=True, exist_ok=True)
    for log in (layout.DECISIONS, layout.TRUTH):
        (folder / log).touch()


def _has_no_score(folder: Path) -> bool:
    """Return whether the flight in a folder was an error, or was killed before it had a verdict."""
    verdict = json_object(folder / layout.VERDICT)
    return verdict is None or verdict.get("outcome") == "error"


def _set_aside(run: Path, folder: Path) -> None:
    kept = run / layout.UNFINISHED
    kept.mkdir(exist_ok=True)
    number = next(n for n in count(1) if not (kept / f"{folder.name}-{n}").exists())
    folder.rename(kept / f"{folder.name}-{number}")


def fresh_run(pilot_name: str) -> Path:
    """Return a new folder below `runs`, named after the time and the pilot. Raises UsageError."""
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # for people; never parsed
    name = f"{stamp}-{re.sub('[^A-Za-z0-9.]+', '-', pilot_name)}"
    runs = Path("runs")
    try:
        runs.mkdir(exist_ok=True)
        for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
            with contextlib.suppress(FileExistsError):
                (runs / (name + suffix)).mkdir()  # atomic: two flights in one second get two folders
                return runs / (name + suffix)
    except OSError as error:
        raise UsageError(_unwritable(runs, error)) from None
    raise UsageError(f"runs/{name} exists a thousand times. Choose a folder with --out")


def _unwritable(run: Path, error: OSError) -> str:
    return f"the run folder {run} cannot be written: {error.strerror}. Choose another folder with --out"


def differences(before: Mapping[str, Any], configuration: Mapping[str, Any]) -> list[str]:
    """Return the settings and packages in which a configuration differs from run.json (`before`).

    Keys that differ between the episodes of a run, or that may change when it is resumed, do not count.
    """
    now = json.loads(json.dumps(configuration))  # tuples become lists, as in run.json
    now.setdefault(SUITE, before.get(SUITE))
    parts = (
        (before.get("flight", {}), now.get("flight", {}), (*PER_EPISODE, *PER_RESUME)),
        (before, now, ("flight", "versions", *MEASURED)),
        (comparable_versions(before.get("versions", {})), comparable_versions(versions()), ()),
    )
    return [
        key
        for then, wanted, free in parts
        for key in dict.fromkeys([*wanted, *then])
        if key not in free and then.get(key) != wanted.get(key)
    ]


def without_episode(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration of a run of several episodes, in which the settings of PER_EPISODE are None."""
    return {**configuration, "flight": {**configuration["flight"], **dict.fromkeys(PER_EPISODE)}}


def write_run(run: Path, configuration: dict[str, Any]) -> None:
    """Write run.json: the resolved configuration, with the versions of all packages that affect results.

    If the existing file is of another episode, the new file describes a run of several episodes. Raises UsageError if a
    newer version wrote the existing file. Raises OSError.
    """
    check_version(run)
    before, flight = run_configuration(run), configuration.get("flight", {})
    if before is not None and any(before.get("flight", {}).get(key) != flight.get(key) for key in PER_EPISODE):
        configuration = without_episode(configuration)
    kept = {SUITE: before[SUITE]} if before and SUITE in before else {}
    write_json(run / layout.RUN, {"schema": SCHEMA, **kept, **configuration, "versions": versions()})


def versions() -> dict[str, str]:
    """Return the versions of Python, of DroneCATS, and of the packages that affect results."""
    found = {"dronecats": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


def comparable_versions(recorded: Mapping[str, Any]) -> dict[str, str]:
    """Return recorded versions without the patch release of Python, which does not affect results."""
    return {
        package: ".".join(str(version).split(".")[:2]) if package == "python" else str(version)
        for package, version in recorded.items()
    }
