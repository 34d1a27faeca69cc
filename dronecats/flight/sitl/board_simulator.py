"""Hardware in the loop: an autopilot board flies the simulated vehicle in real time (`dronecats sitl --hitl`)."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Unpack

from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.episode_world import load_world
from dronecats.flight.sitl.pace import PaceReport, RateKeeper
from dronecats.flight.sitl.px4 import HilVehicle
from dronecats.flight.sitl.simulation import BootPose, Physics, Simulation, build
from dronecats.flight.sitl.sockets import AGENT_LOCAL, AGENT_PORT, GCS_LOCAL, GCS_PORT, LOOPBACK, UdpPort, truth_port
from foundation.airframe import Airframe
from foundation.mavlink import Packer
from foundation.truth import TRUTH_COMPONENT
from hil.link.transport import connect
from hil.simulator import BoardLine, gps_message, sensor_period_us
from vehicles.sensors import Suite

SILENCE_S = 0.5  # wall seconds without motor outputs after which the rotors stop


class BoardVehicle(HilVehicle):
    """A simulated vehicle that an autopilot board flies."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        pose: BootPose,
        *,
        line: BoardLine,
        period_us: int,
        **physics: Unpack[Physics],
    ) -> None:
        """`line`: connection to the board. A sensor suite with period `period_us` (µs) replaces any in `physics`."""
        physics["suite"] = Suite(imu_period_us=period_us)
        super().__init__(index, airframe, pose, period_us=period_us, **physics)
        self.line = line
        self.keeper = RateKeeper(period_us / 1e6)

    @property
    def is_flying(self) -> bool:
        """Whether the board is in HIL mode and has sent motor outputs within SILENCE_S."""
        return self.line.in_hil and time.monotonic() - self.line.actuators_s < SILENCE_S

    def close(self) -> None:
        self.line.close()

    def _exchange(self) -> None:
        self.keeper.wait()
        self.line.exchange()
        if self.line.in_hil:
            if self._has_fix():
                self.line.send(gps_message(self.plant.sensors))
            self.line.send(self._sensor_message())
        self.plant.actuators["armed"] = 0
        if self.line.actuators is not None and self.is_flying:
            self._obey(self.line.actuators, self.time_us)


class BoardSimulator:
    """The simulator for one board. A call of `turn` simulates one tick and forwards messages to and from UDP ports."""

    def __init__(self, config: SimulatorConfig, notify: Callable[[str], None]) -> None:
        """Raises UsageError, LinkError."""
        url, instance = config.hitl or "", config.instance or 0
        period_us = sensor_period_us(url)
        self._line = BoardLine(lambda: connect(url), Packer(1, TRUTH_COMPONENT))
        self.simulation: Simulation[BoardVehicle] = build(
            lambda *arguments, **physics: BoardVehicle(*arguments, line=self._line, period_us=period_us, **physics),
            load_world(config.episode),
            replace(config, count=1, faults=None),
        )
        self._vehicle = self.simulation.vehicles[0]
        self._vehicle.plant.advance(0)  # compiles the physics on the first run of an installation
        self._truth = truth_port(self.simulation.bus, instance)
        self._unsent: dict[str, bytearray] = {"agent": bytearray(), "ground station": bytearray()}
        self._ports = [
            self._port("agent", AGENT_LOCAL + instance, AGENT_PORT + instance),
            self._port("ground station", GCS_LOCAL + instance, GCS_PORT),
        ]
        self._notify, self._state = notify, ""
        self.pace = PaceReport(self._vehicle.keeper)

    def _port(self, name: str, local: int, remote: int) -> UdpPort:
        def take() -> bytes:
            data = bytes(self._unsent[name])
            self._unsent[name].clear()
            return data

        return UdpPort((LOOPBACK, local), (LOOPBACK, remote), take, self._line.give)

    def ready(self) -> dict[str, Any]:
        self._vehicle.keeper.restart()
        return {"truth": self._truth.port}

    def turn(self) -> None:
        self._truth.exchange()
        self.simulation.advance()
        self._truth.exchange()
        command = self._line.take()
        for unsent in self._unsent.values():
            unsent += command
        for port in self._ports:
            port.exchange()
        self._report()

    def close(self) -> None:
        for port in (*self._ports, self._truth):
            port.close()
        self._vehicle.close()

    def _report(self) -> None:
        """Report the state of the board when it has changed."""
        if self._vehicle.is_flying:
            state = "the board receives the simulated sensors and drives the rotors"
        elif self._line.in_hil:
            state = "the board is in HIL mode and sends no motor outputs yet"
        elif self._line.present:
            state = "the board is not in HIL mode. Set SYS_AUTOSTART to 1001 and SYS_HITL to 1, and restart it"
        else:
            state = "no message of a board arrives"
        if state != self._state:
            self._state = state
            self._notify(f"{state}, at {self._vehicle.time_us / 1e6:.1f} s")
