"""An autopilot with the real physics, sensors, estimator and cascade, in lockstep."""

from collections.abc import Callable
from typing import Any

from numba import njit

from autopilot.autopilot import Autopilot
from autopilot.control.flight_core import FlightCore
from autopilot.control.flight_core import update as core_update
from tests.autopilot.commander_bench import ORIGIN, Client, Timed
from vehicles.airframe import load
from vehicles.multirotor import Multirotor
from vehicles.multirotor import step as vehicle_step


@njit(cache=False)  # type: ignore[untyped-decorator]  # numba tells no types
def _live(milliseconds: int, vehicle: Any, core: Any) -> None:
    for _ in range(milliseconds):
        vehicle_step(*vehicle)
        core_update(*core)


class Aircraft(Timed):
    """Vehicle, flight core and autopilot in lockstep."""

    def __init__(self, name: str, seed: int) -> None:
        airframe = load(name)
        self.vehicle = Multirotor(airframe, seed=seed, origin=ORIGIN)
        core = FlightCore(airframe)
        self.autopilot = Autopilot(airframe, core, self.vehicle.sensors, actuators=self.vehicle.actuators)
        self.client = Client(self.autopilot.open_port("onboard"))
        self._kernels = self.vehicle.kernel_args, core.kernel_args(self.vehicle.sensors, self.vehicle.actuators)

    @property
    def truth(self) -> Any:
        return self.vehicle.truth

    def run(self, seconds: float, each_50ms: Callable[[], None] | None = None) -> None:
        for i in range(round(seconds * 50)):
            if each_50ms is not None and i % 5 in (0, 2):
                each_50ms()
            _live(20, *self._kernels)
            self.autopilot.update()
