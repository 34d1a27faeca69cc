"""A dataset as a user gets it: two flights of the oracle, and their export."""

from pathlib import Path

import pytest

from dronecats.cli.main import main

EPISODES = ("residential-approaching-05", "residential-searching-03")


@pytest.fixture(scope="session")
def flown(tmp_path_factory) -> Path:
    """A run folder of two flights that were drawn; nothing may be written into it."""
    folder = tmp_path_factory.mktemp("action_head") / "flown"
    words = ["fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--latency", "fixed:0.1", "--out", str(folder)]
    for episode in EPISODES:
        assert main([*words, "--episode", episode]) == 0
    return Path(folder)


@pytest.fixture(scope="session")
def dataset_folder(flown) -> Path:
    """The LeRobot dataset of those flights."""
    folder = flown.with_name("dataset")
    assert main(["export", str(flown), "--to", "lerobot", "--out", str(folder)]) == 0
    return Path(folder)
