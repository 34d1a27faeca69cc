"""A pytest plugin: runs that the tests of a session share, and flights without their summary picture."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from tests import natures


@dataclass(frozen=True)
class FlownOnce:
    """A run folder, which is read-only by convention, and the result of each of its flights."""

    run: Path
    results: list[dict[str, Any]]


FlyOnce = Callable[..., FlownOnce]

ALONE, FLEET = "residential-approaching-01", "blocks-commanding-01"  # the episodes of `rendered_run`
MOVING = "residential-tracking-01"  # a moving target: the episode of `unrendered_runs`
MOVING_S = 6.0  # s


@pytest.fixture(scope="session")
def fly_once(tmp_path_factory: pytest.TempPathFactory) -> FlyOnce:
    """Return a function that flies specs into one run folder. Tests and workers with the same specs share the run."""
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "flown"
    shared.mkdir(exist_ok=True)

    def fly_once(*specs: Any) -> FlownOnce:
        from dronecats.flight.run.fly import fly
        from dronecats.flight.spec.spec_file import as_json

        key = hashlib.sha256(json.dumps([as_json(spec) for spec in specs]).encode()).hexdigest()[:16]
        folder, results = shared / key / "run", shared / key / "results.json"
        with (shared / f"{key}.lock").open("w") as turn, _without_picture():
            fcntl.flock(turn, fcntl.LOCK_EX)  # released when the file is closed
            if not results.exists():
                shutil.rmtree(folder, ignore_errors=True)
                flights = [fly(spec, folder, lambda line: None) for spec in specs]
                assert all(result["status"] == 0 for result in flights), flights
                results.write_text(json.dumps(flights))
        return FlownOnce(folder, json.loads(results.read_text()))

    return fly_once


@pytest.fixture(scope="session")
def rendered_run(fly_once: FlyOnce) -> FlownOnce:
    """The oracle's complete flights of ALONE and FLEET."""
    from dronecats.flight.spec.flight_spec import FlightSpec, Simulated

    return fly_once(*[FlightSpec(pilot="oracle", episode=e, simulated=Simulated(speed=None)) for e in (ALONE, FLEET)])


@pytest.fixture(scope="session")
def unrendered_runs(fly_once: FlyOnce) -> tuple[FlownOnce, FlownOnce]:
    """Two short flights of the oracle in MOVING, with grey pictures and the seeds 0 and 3."""
    from dronecats.flight.spec.flight_spec import FlightSpec, Simulated

    grey = Simulated(speed=None, rendered=False)
    spec = FlightSpec(pilot="oracle", episode=MOVING, simulated=grey, seconds=MOVING_S, full=True)
    return fly_once(spec), fly_once(replace(spec, seed=3))


@pytest.fixture(scope="module", autouse=True)
def without_flight_picture(request: pytest.FixtureRequest) -> Iterator[None]:
    """Do not draw flight.png, which takes longer than a short flight, unless the module sets FLIGHT_PICTURE."""
    if natures.of_path(request.node.nodeid) == "unit" or getattr(request.module, "FLIGHT_PICTURE", False):
        yield
        return
    with _without_picture():
        yield


@contextmanager
def _without_picture() -> Iterator[None]:
    from dronecats.flight.run import simulated

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "draw", lambda *arguments: None)
        yield
