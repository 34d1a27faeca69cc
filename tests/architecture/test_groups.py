"""Slow tests of one file run in one pytest-xdist worker, because they share flights. The longest files run first."""

import os
import subprocess
import sys

from tests.conftest import LONGEST

SLOW_FILE = """
import os
from pathlib import Path
import pytest

pytestmark = pytest.mark.slow

@pytest.mark.parametrize("number", range(4))
def test_where_it_runs(number):
    Path(f"{number}.txt").write_text(os.environ["PYTEST_XDIST_WORKER"])
"""


def test_slow_tests_of_one_file_run_in_one_worker(pytestconfig, tmp_path):
    (tmp_path / "conftest.py").write_text("from tests.conftest import pytest_configure, pytest_itemcollected\n")
    for name in ("test_one.py", "test_other.py"):
        (tmp_path / name).write_text(SLOW_FILE.replace("{number}", f"{name}-{{number}}"))
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = slow\n")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "loadgroup", "-m", "slow"]
    environment = {**os.environ, "PYTHONPATH": str(pytestconfig.rootpath)}
    subprocess.run(command, check=True, cwd=tmp_path, env=environment, capture_output=True)
    for name in ("test_one.py", "test_other.py"):
        assert len({path.read_text() for path in tmp_path.glob(f"{name}-*.txt")}) == 1


def test_the_files_that_begin_first_exist(pytestconfig):
    assert [file for file in LONGEST if not (pytestconfig.rootpath / file).exists()] == []
