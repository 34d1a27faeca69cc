"""Where a run is kept. Layout: design.md, "Files of a run"."""

import json
import platform
import re
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from dronecats import __version__
from dronecats.border.errors import UsageError

PACKAGES = ("numpy", "numba", "opencv-python-headless", "pymavlink", "httpx", "embreex", "scipy")


def create(out: Path | None, pilot_name: str, episode_id: str) -> Path:
    """Return a new episode folder inside a run folder: `out`, or one named after the time and the pilot.

    Raises UsageError when the episode has been flown in that run already, or the folder cannot be made.
    """
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # a name for people, never read back
    run = out or Path("runs") / f"{stamp}-{re.sub('[^A-Za-z0-9.]+', '-', pilot_name)}"
    folder = run / episode_id
    if (folder / "decisions.jsonl").exists():
        raise UsageError(f"{folder} already holds a flight; choose another --out")
    try:
        (folder / "frames").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"the run folder {folder} cannot be made: {error.strerror}") from None
    return folder


def write_run(run: Path, configuration: dict[str, Any]) -> None:
    """Write run.json: the resolved configuration with the versions of everything that matters to a number."""
    versions = {"dronecats": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    write_json(run / "run.json", {**configuration, "versions": versions})


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file so that a kill leaves the old one or the new one, never half of one."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    draft.replace(path)
