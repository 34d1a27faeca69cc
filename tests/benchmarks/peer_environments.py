"""Environments of other people's programs, faked by their one file that a benchmark starts."""

import sys
from pathlib import Path


def make_environments(folder: Path, scripts: dict[str, str]) -> None:
    """Make for each name a `bin/python` below `folder` that does what its script says, whatever it is asked to run."""
    for name, script in scripts.items():
        python = folder / name / "bin" / "python"
        python.parent.mkdir(parents=True)
        python.write_text(f"#!{sys.executable}\n{script}\n")
        python.chmod(0o755)
