"""The hover-and-step task in other simulators, each in its own virtual environment, timed in the same run as ours."""

from pathlib import Path
from typing import Any


def compare(folder: Path, core_rtf: float) -> dict[str, Any]:
    return {}
