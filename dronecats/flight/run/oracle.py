"""The pilots that are told the truth, on a stage that knows it. They need what simulating needs."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dronecats.flight.disturbances import FrameFaults
from dronecats.flight.run.pilot import OpenPilot, commanded, opened
from dronecats.flight.sitl.scenario import origin
from dronecats.flight.spec.flight import Flight
from dronecats.flight.stages.parts import TRUTH_HZ
from dronecats.flight.stages.stage import TruthfulStage
from dronecats.pilots import roster
from dronecats.pilots.oracle import failing, oracle
from dronecats.pilots.oracle.noisy import NoisyPilot
from dronecats.pilots.oracle.oracle import TruthPilot
from dronecats.pilots.oracle.oracle_model import OracleModel
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.truth import KEPT

LATE_S = 90.0  # s; a picture that is stale for longer is taken for one of then


@contextmanager
def opened_in(world: World, flight: Flight, stage: TruthfulStage, folder: Path) -> Iterator[OpenPilot]:
    """Open any pilot of a flight in a world of ours. Raises UsageError, InfrastructureError."""
    name = flight.spec.pilot
    if name is None or not roster.needs_truth(name) or flight.spec.replay:
        with opened(flight, stage, folder) as pilot:
            yield pilot
        return
    tap = stage.tap(lambda data: model.feed(data))
    model = OracleModel(
        world, CameraModel(), origin(world), tap.drain, name, _knowing(name, flight), kept=_kept(flight),
        obeys=not name.startswith(roster.FAILING), looks=name == roster.NOISY,
    )  # fmt: skip
    try:
        with commanded(flight, stage, folder, OpenPilot(model, begin=model.begin)) as pilot:
            yield pilot
    finally:
        tap.close()


def _knowing(name: str, flight: Flight) -> TruthPilot:
    if name == roster.ORACLE:
        return oracle.reply_nearest
    if name == roster.NOISY:
        return NoisyPilot(flight.instruction, flight.seed)
    return failing.pilot(name.removeprefix(roster.FAILING))


def _kept(flight: Flight) -> int:
    """Return how many samples of the truth are remembered: of pictures that may be late, a minute and a half."""
    return KEPT if flight.spec.disturbances.frame == FrameFaults() else KEPT + round(LATE_S * TRUTH_HZ)
