"""Fakes the virtual environments of other programs. Only the file that a benchmark starts exists."""

import sys
from pathlib import Path


def make_environments(folder: Path, scripts: dict[str, str]) -> None:
    """Create `folder/NAME/bin/python` for each name. It always runs the script of that name."""
    for name, script in scripts.items():
        python = folder / name / "bin" / "python"
        python.parent.mkdir(parents=True)
        python.write_text(f"#!{sys.executable}\n{script}\n")
        python.chmod(0o755)
