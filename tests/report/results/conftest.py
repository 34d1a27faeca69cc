"""Two archives for several test files: a complete suite, and two episodes that tests change."""

from pathlib import Path

import pytest

from dronecats.report.leaderboard.submission import submit
from dronecats.report.recorded.run import recorded_runs
from tests.report.results.archives import QUICK, TWO
from tests.report.results.synthetic_runs import write_run


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return write_run(tmp_path_factory.mktemp("archive") / "oracle", QUICK)


@pytest.fixture(scope="module")
def suite_archive(run) -> Path:
    path = run.parent / "oracle.tar.xz"
    submit(recorded_runs([run]), path)
    return Path(path)


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """An archive of two episodes that tests change."""
    folder = tmp_path_factory.mktemp("small")
    submit(recorded_runs([write_run(folder / "oracle", TWO)]), folder / "small.tar.xz", partial=True)
    return Path(folder / "small.tar.xz")
