"""The model that was asked for: a built-in pilot that a process serves, an endpoint, or the oracle on the truth bus."""

from collections.abc import Callable

from dronecats.agent.chat import ChatModel
from dronecats.agent.model import Model
from dronecats.agent.providers import PROVIDERS, split
from dronecats.border.camera import CameraModel
from dronecats.pilots.oracle_model import OracleModel
from dronecats.run.listening import Listener
from dronecats.run.supervisor import ChildProcess, Supervisor
from dronecats.sitl.scenario import origin
from episodes.world import World


def served(supervisor: Supervisor, pilot: str | None) -> ChildProcess | None:
    """Start the process of a built-in pilot that looks at frames; None for the oracle and for a model."""
    return supervisor.start("pilot", {"pilot": pilot}) if pilot not in (None, "oracle") else None


def asked(
    pilot: str | None,
    process: ChildProcess | None,
    model: str | None,
    base_url: str | None,
    waiting: Callable[[], None] = lambda: None,
) -> Model:
    """Return the client of a pilot's process, or of PROVIDER/NAME where there is none. Raises UsageError."""
    if process is not None:
        return ChatModel(PROVIDERS["local"], pilot or "", process.ready(waiting)["base_url"])
    return ChatModel(*split(model or ""), base_url)


class BusOracle(OracleModel):
    """The oracle, which hears the truth on the bus of a simulator that is another process."""

    def __init__(self, world: World, bus: str) -> None:
        """`bus` is the URL of the truth. Raises UsageError."""
        super().__init__(world, CameraModel(), origin(world), self._read_bus)
        self._bus = Listener(bus, self.feed)

    def close(self) -> None:
        self._bus.close()

    def _read_bus(self) -> None:
        while self._bus.read(0.0):
            pass
