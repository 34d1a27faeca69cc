"""The oracle of a flight whose simulator is another process. It needs what simulating needs."""

from dronecats.pilots.oracle_model import OracleModel
from dronecats.processes.bus_listener import Listener
from dronecats.sitl.scenario import origin
from episodes.world import World
from foundation.camera import CameraModel


class BusOracle(OracleModel):
    """Hears the truth on the simulator's bus."""

    def __init__(self, world: World, bus: str) -> None:
        """`bus` is the URL of the truth. Raises UsageError."""
        super().__init__(world, CameraModel(), origin(world), self._read_bus)
        self._bus = Listener(bus, self.feed)

    def close(self) -> None:
        self._bus.close()

    def _read_bus(self) -> None:
        while self._bus.read(0.0):
            pass
