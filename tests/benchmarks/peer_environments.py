"""Environments of foreign programs, faked by the one file that a benchmark starts."""

import sys
from pathlib import Path


def make_environments(folder: Path, scripts: dict[str, str]) -> None:
    """Create for each name a `bin/python` below `folder` that behaves like its script, for any arguments."""
    for name, script in scripts.items():
        python = folder / name / "bin" / "python"
        python.parent.mkdir(parents=True)
        python.write_text(f"#!{sys.executable}\n{script}\n")
        python.chmod(0o755)
