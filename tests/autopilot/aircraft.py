"""An autopilot with the real physics, sensors, estimator and cascade, in lockstep."""

from collections.abc import Callable
from typing import Any

from numba import njit

from autopilot.autopilot import Autopilot
from autopilot.control.flight_core import FlightCore
from autopilot.control.flight_core import update as core_update
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import ORIGIN, Client, Timed
from vehicles.airframe import load
from vehicles.multirotor import Multirotor
from vehicles.multirotor import step as vehicle_step


@njit(cache=False)  # type: ignore[untyped-decorator]  # Numba has no types
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

    def take_off(self, height: float) -> None:
        """Take off to a height (m), and wait until the vehicle hovers there."""
        self.until(lambda: not self.commander.arming_failures(), 15.0)
        self.autopilot.parameters.set("MIS_TAKEOFF_ALT", height)
        assert self.client.mode(4, 3) == 0  # HOLD
        assert self.client.arm() == 0
        assert self.client.command(dialect.MAV_CMD_NAV_TAKEOFF) == 0
        self.until(lambda: self.commander.mode == "HOLD", 30.0)

    def run(self, seconds: float, each_50ms: Callable[[], None] | None = None) -> None:
        for i in range(round(seconds * 50)):
            if each_50ms is not None and i % 5 in (0, 2):
                each_50ms()
            _live(20, *self._kernels)
            self.autopilot.update()
