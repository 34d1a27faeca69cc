"""Where a run is kept. Layout: docs/run-folder.md."""

import contextlib
import fcntl
import json
import platform
import re
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from importlib import metadata
from itertools import count
from pathlib import Path
from typing import Any, TextIO

from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import SCHEMA, check_version, json_object, run_configuration
from foundation.version import __version__
from foundation.whole_file import write_json as write_json

PER_EPISODE = ("episode", "record")  # in which the flights of one run differ
PER_SITTING = ("accounts",)  # in which a run may be gone on with
LOCK = ".lock"  # of a run: held by the processes that fly it
PACKAGES = ("numpy", "numba", "opencv-python-headless", "pymavlink", "httpx", "embreex", "scipy")


@contextlib.contextmanager
def create(
    out: Path | None,
    pilot_name: str,
    episode_id: str,
    configuration: dict[str, Any],
    first: Callable[[], None] = lambda: None,
) -> Iterator[Path]:
    """Yield a new episode folder inside a run folder, with its empty logs and the run's run.json, held until the end.

    The run folder is `out`, or a new one named after the time and the pilot. A flight there without a score is kept
    under UNFINISHED and flown again: one whose verdict is an error, or one that was killed, which has no verdict and no
    process that holds it. `first` is called once the folder is known to take this flight, before anything is written
    or moved there; when it raises, a folder that was new is gone again. Raises UsageError when `out` has another flight
    of that episode or another configuration, or when nothing can be written there.
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
                    raise UsageError(f"{folder} already holds a flight; choose another folder (option out)")
            before = run_configuration(run)
            if before is not None and differences(before, configuration):
                raise UsageError(
                    f"{run} is a run of another pilot or other settings; choose another folder (option out)"
                )
            held.callback(_remove_unused, run)
            first()
            if again:
                _set_aside(run, folder)
            prepare(folder)
            held.enter_context(hold(folder / layout.DECISIONS, folder))
            write_run(run, configuration)
        except OSError as error:
            raise UsageError(_unwritable(out or Path("runs"), error)) from None
        yield folder


def _remove_unused(run: Path) -> None:
    """Remove a run folder that holds nothing but its lock."""
    with contextlib.suppress(OSError):
        if [path.name for path in run.iterdir()] == [LOCK]:
            (run / LOCK).unlink()
            run.rmdir()


def hold(lock: Path, what: Path, *, shared: bool = False) -> TextIO:
    """Return a file with its lock, held until it is closed, or until the process ends, however it ends.

    Raises UsageError when another process holds the lock: that one is flying `what`. Raises OSError.
    """
    file = lock.open("a")
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise UsageError(
            f"another process is flying {what}; wait for it, or choose another folder (option out)"
        ) from None
    return file


def prepare(folder: Path) -> None:
    """Make an episode folder with its empty logs: a flight that breaks off before its first line is judged too.

    Raises OSError when the disk does not take it.
    """
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
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # a name for people, never read back
    name = f"{stamp}-{re.sub('[^A-Za-z0-9.]+', '-', pilot_name)}"
    runs = Path("runs")
    try:
        runs.mkdir(exist_ok=True)
        for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
            with contextlib.suppress(FileExistsError):
                (runs / (name + suffix)).mkdir()  # atomic: two flights that start in one second do not share a folder
                return runs / (name + suffix)
    except OSError as error:
        raise UsageError(_unwritable(runs, error)) from None
    raise UsageError(f"runs/{name} exists a thousand times; choose a folder (option out)")


def _unwritable(run: Path, error: OSError) -> str:
    return f"the run folder {run} cannot be written: {error.strerror}; choose another (option out)"


def differences(before: Mapping[str, Any], configuration: Mapping[str, Any]) -> list[str]:
    """Return what a run was configured with otherwise, but for its episodes; `before` is as it stands in run.json."""
    now = json.loads(json.dumps(configuration))  # tuples are lists there
    flight, then = now.pop("flight", {}), before.get("flight", {})
    named = [key for key in flight if key not in (*PER_EPISODE, *PER_SITTING) and then.get(key) != flight[key]]
    return named + [key for key, value in now.items() if before.get(key) != value]


def of_several(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration of a run of several episodes: it names none of them."""
    return {**configuration, "flight": {**configuration["flight"], **dict.fromkeys(PER_EPISODE)}}


def write_run(run: Path, configuration: dict[str, Any]) -> None:
    """Write run.json: the resolved configuration with the versions of everything that matters to a number.

    Where the one that stands there is of another episode, it is that of several from now on. Raises UsageError when a
    newer version wrote that, OSError.
    """
    check_version(run)
    before, flight = run_configuration(run), configuration.get("flight", {})
    if before is not None and any(before.get("flight", {}).get(key) != flight.get(key) for key in PER_EPISODE):
        configuration = of_several(configuration)
    versions = {"dronecats": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    write_json(run / layout.RUN, {"schema": SCHEMA, **configuration, "versions": versions})
