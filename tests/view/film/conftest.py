"""A short unrendered lockstep flight behind a moving target. All tests share its world."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.film.composition import Composition
from dronecats.view.film.film import composition
from dronecats.view.film.plan import filmable
from foundation.run_folder import layout
from tests.support.flown_runs import MOVING as EPISODE

GREY = 128  # grey level of the frames that replace the unrendered ones


@pytest.fixture(scope="session")
def flight_folder(unrendered_runs) -> Path:
    """The folder of the episode, with the flight's unrendered frames. No test may change it."""
    return Path(unrendered_runs[0].run / EPISODE)


@pytest.fixture(scope="session")
def pictured(flight_folder, tmp_path_factory) -> Path:
    """A copy of that folder that looks rendered: its frames are plain grey."""
    run = tmp_path_factory.mktemp("film") / "pictured"
    shutil.copytree(flight_folder.parent, run)
    about = json.loads((run / layout.RUN).read_text())
    about["flight"]["simulated"]["rendered"] = True
    (run / layout.RUN).write_text(json.dumps(about))
    for frame in (run / EPISODE / layout.FRAMES).glob("*.jpg"):
        cv2.imwrite(str(frame), np.full((360, 640, 3), GREY, np.uint8))
    return Path(run / EPISODE)


@pytest.fixture(scope="session")
def flight(pictured) -> RecordedFlight:
    """That flight with its world."""
    return filmable(pictured)


@pytest.fixture(scope="session")
def composed(pictured) -> Composition:
    """The composition of the flight, 320 by 180 pixels."""
    return composition(str(pictured.resolve()), 320, 180, None)
