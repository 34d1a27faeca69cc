"""Folders without write access.

With such a working folder, a command ends with status 2 and a one-line error.
With such a home, everything works without a cache.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dronecats.cli import doctor
from dronecats.cli.main import main
from foundation import compiled
from tests.needs import needs

ROOT = Path(__file__).parents[2]
NOWHERE = os.path.join(os.devnull, "nowhere")  # not even root can make a folder there


def run(*words, cwd, **variables):
    """Run Python in the folder `cwd`, with this checkout on its path; return the finished process."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, *words],
        cwd=cwd,
        env={**environment, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("words", ["fly --sitl --speed max", "episodes audit blocks-commanding-01"])
def test_a_file_in_place_of_the_runs_folder_is_a_one_line_error(tmp_path, monkeypatch, capsys, words):
    (tmp_path / "runs").write_text("a file, where the folder would be")
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert re.search(r"\bruns\b.*File exists", error)
    assert error.count("\n") == 1


@needs("user")
def test_a_read_only_working_folder_is_an_error_with_a_hint(tmp_path):
    tmp_path.chmod(0o555)
    done = run("-m", "dronecats.cli.main", "fly", "--sitl", "--speed", "max", cwd=tmp_path)
    assert done.returncode == 2
    assert re.search("Permission denied.*--out", done.stderr)


def test_without_a_home_kernels_compile_without_a_cache(tmp_path):
    code = """
from foundation import compiled
@compiled.njit()
def double(x): return 2.0 * x
print(double(1.5), compiled.CAN_CACHE, type(double._cache).__name__)
"""
    script = tmp_path / "kernel.py"
    script.write_text(code)
    done = run(script, cwd=tmp_path, HOME=NOWHERE, XDG_CACHE_HOME=NOWHERE)
    assert done.stdout.split() == ["3.0", "False", "NullCache"], done.stderr
    assert not list(tmp_path.rglob("*.nb[ic]"))


def test_doctor_reports_a_missing_kernel_cache(monkeypatch):
    monkeypatch.setattr(compiled, "CAN_CACHE", True)
    assert doctor._compiler().state == doctor.OK
    monkeypatch.setattr(compiled, "CAN_CACHE", False)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", NOWHERE)
    lost = doctor._compiler()
    assert lost.state == doctor.NOTE  # a flight is still possible
    assert f"{NOWHERE}/dronecats" in lost.detail
