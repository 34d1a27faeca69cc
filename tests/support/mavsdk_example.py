"""Runs a client script of `examples/` as a user does."""

import subprocess
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def fly_example(name: str, python: Path, url: str) -> None:
    """Run an example script, and check the height and speed that it prints."""
    run = subprocess.run([python, EXAMPLES / name, url], capture_output=True, text=True, timeout=150, check=False)
    assert run.returncode == 0, run.stderr[-2000:]
    height, speed, landed = run.stdout.splitlines()
    assert float(height.split()[1]) == pytest.approx(2.75, abs=0.6)
    assert float(speed.split()[1]) == pytest.approx(2.0, abs=0.15)
    assert landed == "landed"
