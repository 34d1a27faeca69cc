"""A dataset as a user gets it: a flight of the oracle, and its export."""

from pathlib import Path

import pytest

from dronecats.cli.main import main

EPISODE = "residential-searching-03"


@pytest.fixture(scope="session")
def flown(tmp_path_factory) -> Path:
    """A run folder of one flight that was drawn; nothing may be written into it."""
    folder = tmp_path_factory.mktemp("action_head") / "flown"
    words = ["fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--latency", "fixed:0.1", "--episode", EPISODE]
    assert main([*words, "--out", str(folder)]) == 0
    return Path(folder)


@pytest.fixture(scope="session")
def dataset_folder(flown) -> Path:
    """The LeRobot dataset of that flight."""
    folder = flown.with_name("dataset")
    assert main(["export", str(flown), "--to", "lerobot", "--out", str(folder)]) == 0
    return Path(folder)
