"""Fixtures: two flights of the oracle, and their dataset, exported with the user's command."""

from pathlib import Path

import pytest

from dronecats.cli.main import main

EPISODES = ("residential-approaching-05", "residential-searching-03")


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory) -> Path:
    """A run folder of two rendered flights. No test may write into it."""
    folder = tmp_path_factory.mktemp("action_head") / "flown"
    words = ["fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--latency", "fixed:0.1", "--out", str(folder)]
    for episode in EPISODES:
        assert main([*words, "--episode", episode]) == 0
    return Path(folder)


@pytest.fixture(scope="session")
def dataset_folder(run_folder) -> Path:
    """The LeRobot dataset of those flights."""
    folder = run_folder.with_name("dataset")
    assert main(["export", str(run_folder), "--to", "lerobot", "--out", str(folder)]) == 0
    return Path(folder)
