"""One vehicle in lockstep, flown by our autopilot or by a real PX4: for measurements that need no episode."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from dronecats.flight.sitl.config import AIRFRAME, SimulatorConfig
from dronecats.flight.sitl.lockstep import Lockstep
from dronecats.flight.sitl.px4.simulator import Px4Lockstep, Px4Simulator
from dronecats.flight.sitl.scenario import build
from episodes.world.world import World
from vehicles.wind import CALM, Wind


@contextmanager
def one_vehicle(
    world: World,
    *,
    airframe: str = AIRFRAME,
    seed: int = 0,
    wind: Wind = CALM,
    px4: str | None = None,
    log_dir: Path | None = None,
) -> Iterator[Lockstep | Px4Lockstep]:
    """Stand the record's first drone in its world, under our autopilot or the PX4 that the command `px4` starts.

    log_dir: an existing folder for what PX4 prints; None: it is not kept.
    Raises UsageError for an airframe or command that cannot fly, InfrastructureError where PX4 ends.
    """
    if px4 is None:
        yield Lockstep(build(world, airframe=airframe, seed=seed, count=1, wind=wind))
        return
    config = SimulatorConfig(
        episode=world.record.id, airframe=airframe, seed=seed, speed=None, count=1, wind_ned=wind.mean_ned,
        gusts_w20=wind.w20, px4=px4, log_dir=str(log_dir) if log_dir else None,
    )  # fmt: skip
    with closing(Px4Simulator(config, say=lambda line: None, world=world)) as simulator:
        yield Px4Lockstep(simulator)
