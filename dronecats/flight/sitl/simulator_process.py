"""The simulator as a process: it runs vehicles and autopilots in real time, with MAVLink on UDP and a truth bus."""

import time
from pathlib import Path
from typing import Any, Unpack

from dronecats.flight.processes.child import Part
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.episode_world import load_world
from dronecats.flight.sitl.simulation import BootPose, PacedSimulator, Physics, SimulatedVehicle, build
from dronecats.flight.sitl.sockets import Ports
from foundation.airframe import Airframe
from foundation.signing import load_key, timestamp

WORK_SHARE = 0.1  # share of a tick's wall time for client messages before the simulation step, and again after it


class Simulator(PacedSimulator[SimulatedVehicle]):
    """The simulator with the project's autopilot. A call of `turn` simulates one tick."""

    def __init__(self, config: SimulatorConfig) -> None:
        world = load_world(config.episode)
        super().__init__(config, world)

        def make(index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> SimulatedVehicle:
            folder = Path(config.state_dir) / f"vehicle-{index + 1}" if config.state_dir else None
            return SimulatedVehicle(index, airframe, pose, state_dir=folder, **physics)

        self.simulation = build(make, world, config)
        if config.least_charge is not None:
            for vehicle in self.simulation.vehicles:
                vehicle.plant.keep_charge(config.least_charge)
        self.simulation.advance()  # on the first run of an installation, this compiles the physics
        self.ports = Ports(self.simulation, config.instance)
        if config.sign is not None:
            # signatures need the wall time, which a real PX4 receives together with the key
            key, now = load_key(Path(config.sign)), timestamp(time.time())
            for vehicle in self.simulation.vehicles:
                vehicle.sign(key, now)
        self.speed = 1.0 if config.speed is None else config.speed
        self._reset_pace()

    def ready(self) -> dict[str, Any]:
        """Start the rate keeper anew, because starting up took time, and return the ports."""
        self._reset_pace()
        return {
            "agent": [port.port for port in self.ports.agent],
            "log": [port.port for port in self.ports.log],
            "truth": self.ports.truth.port,
        }

    def turn(self) -> None:
        work_s = WORK_SHARE * self._keeper.period_s
        self.ports.exchange(work_s)
        self.simulation.advance()
        self.ports.exchange(work_s)
        self._staller.turn(self.simulation.time_us)
        self._keeper.wait()

    def close(self) -> None:
        for vehicle in self.simulation.vehicles:
            vehicle.close()
        self.ports.close()


def create(config: SimulatorConfig) -> Part:
    """Return the simulator of an episode's vehicles, with the project's autopilot or PX4. Raises UsageError."""
    if config.autopilot == "px4":
        from dronecats.flight.sitl.px4 import Px4Simulator

        return Px4Simulator(config)
    return Simulator(config)
