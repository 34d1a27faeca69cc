"""Fixtures: a run of two rendered flights (one drone, four drones), and both flights as the exporters read them."""

from pathlib import Path

import pytest

from dronecats.report.export.formats import finished_flight
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun, recorded_runs
from tests.support.flown_runs import ALONE as ALONE
from tests.support.flown_runs import FLEET


@pytest.fixture(scope="session")
def run_folder(rendered_run) -> Path:
    """Return the run folder of both flights. Tests must not change it."""
    return Path(rendered_run.run)


@pytest.fixture(scope="session")
def run(run_folder) -> RecordedRun:
    return recorded_runs([run_folder])[0]


@pytest.fixture(scope="session")
def alone(run) -> RecordedFlight:
    return finished_flight(run.folder / ALONE)


@pytest.fixture(scope="session")
def fleet(run) -> RecordedFlight:
    return finished_flight(run.folder / FLEET)
