"""One run of two rendered flights, of one drone and of four, and both as every format takes them."""

from pathlib import Path

import pytest

from dronecats.cli.main import main
from dronecats.export.flight import ExportedFlight, exported_flight
from dronecats.results.flown_run import FlownRun, flown_runs

ALONE, FLEET = "residential-approaching-01", "blocks-commanding-01"


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory) -> Path:
    """A run folder that `fly` has left; nothing may be written into it."""
    folder = tmp_path_factory.mktemp("export") / "flown"
    for episode in (ALONE, FLEET):
        flight = ["fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--episode", episode, "--out", str(folder)]
        assert main(flight) == 0
    return Path(folder)


@pytest.fixture(scope="session")
def run(run_folder) -> FlownRun:
    return flown_runs([run_folder])[0]


@pytest.fixture(scope="session")
def alone(run) -> ExportedFlight:
    return exported_flight(run, run.folder / ALONE)


@pytest.fixture(scope="session")
def fleet(run) -> ExportedFlight:
    return exported_flight(run, run.folder / FLEET)
