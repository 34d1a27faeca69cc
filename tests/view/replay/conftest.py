"""Two short unrendered lockstep flights of one episode, behind a moving target."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dronecats.view.replay.moments import FlightMoments, flight_moments
from foundation.run_folder import layout
from tests.support.flown_runs import MOVING as EPISODE


@pytest.fixture(scope="session")
def runs(unrendered_runs, tmp_path_factory) -> Path:
    """A folder with copies of the runs `paper` and `other`: the oracle's flights with two seeds."""
    folder = tmp_path_factory.mktemp("replay")
    for name, run in zip(("paper", "other"), unrendered_runs, strict=True):
        shutil.copytree(run.run, folder / name)
    return Path(folder)


@pytest.fixture(scope="session")
def folder(runs) -> Path:
    """The folder of an episode whose frames are plain, each in a different grey."""
    path = Path(runs / "paper" / EPISODE)
    about = json.loads((path.parent / layout.RUN).read_text())
    about["flight"]["simulated"]["rendered"] = True
    (path.parent / layout.RUN).write_text(json.dumps(about))
    for number, frame in enumerate(sorted((path / layout.FRAMES).glob("*.jpg"))):
        cv2.imwrite(str(frame), np.full((360, 640, 3), 60 + 20 * number, np.uint8))
    return path


@pytest.fixture(scope="session")
def flight(folder) -> FlightMoments:
    """The flight of that folder."""
    return flight_moments(folder)


@pytest.fixture
def copied(folder, tmp_path) -> Path:
    """A copy of that folder, which a test may damage."""
    shutil.copytree(folder.parent, tmp_path / "run")
    return Path(tmp_path / "run" / EPISODE)


@pytest.fixture
def rewrite() -> Callable[..., None]:
    """Change the lines of a log: a function maps each object, and None omits it."""

    def change(path: Path, how: Callable[[dict[str, Any]], dict[str, Any] | None]) -> None:
        changed = [how(json.loads(line)) for line in path.read_text().splitlines()]
        path.write_text("".join(json.dumps(row) + "\n" for row in changed if row is not None))

    return change
