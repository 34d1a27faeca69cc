"""Room for the run folder."""

import os
import shutil
from pathlib import Path

from hil.preflight.row import Row

NAME = "disk"
LEAST_GB = 1.0  # an episode keeps some 120 frames of 40 kB and 30 MB of telemetry; a full disk ends a log in mid-flight


def row(folder: Path) -> Row:
    """Return the row of the disk that `folder` is on, or would be."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        return Row(NAME, False, f"{folder} cannot be written to", "name another folder with --out")
    free_gb = shutil.disk_usage(there).free / 1e9
    if free_gb < LEAST_GB:
        return Row(NAME, False, f"{free_gb:.2f} GB free for {folder}", f"make room for {LEAST_GB:g} GB")
    return Row(NAME, True, f"{free_gb:.0f} GB free for {folder}")
