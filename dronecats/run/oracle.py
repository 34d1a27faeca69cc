"""The oracle on a stage that knows the truth. It needs what simulating needs."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dronecats.flight.flight import Flight
from dronecats.pilots.oracle_model import OracleModel
from dronecats.run.pilot import OpenPilot, commanded, opened
from dronecats.sitl.scenario import origin
from dronecats.stages.stage import TruthfulStage
from episodes.world import World
from foundation.camera import CameraModel

ORACLE = "oracle"


@contextmanager
def opened_in(world: World, flight: Flight, stage: TruthfulStage, folder: Path) -> Iterator[OpenPilot]:
    """Open any pilot of a flight in a world of ours. Raises UsageError, InfrastructureError."""
    if flight.spec.pilot != ORACLE:
        with opened(flight, stage, folder) as pilot:
            yield pilot
        return
    tap = stage.tap(lambda data: oracle.feed(data))
    oracle = OracleModel(world, CameraModel(), origin(world), tap.drain)
    try:
        with commanded(flight, stage, folder, OpenPilot(oracle, begin=oracle.begin)) as pilot:
            yield pilot
    finally:
        tap.close()
