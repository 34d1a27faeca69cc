"""The simulator as a process: vehicles and autopilots in real time, MAVLink on UDP, the truth on a bus beside it."""

from pathlib import Path
from typing import Any

from dronecats.processes.child import Part
from dronecats.sitl.pace import PaceReport, RateKeeper
from dronecats.sitl.ports import Ports
from dronecats.sitl.scenario import build, load_world
from dronecats.sitl.simulation import TICK_US
from vehicles import airframe as airframes
from vehicles import fault_script
from vehicles.wind import Wind


class Simulator:
    """Part of a real-time flight: one turn is one tick of the simulation."""

    def __init__(self, config: dict[str, Any]) -> None:
        world = load_world(config["episode"])
        script = config.get("faults")
        rotors = len(airframes.load(config["airframe"]).rotors)
        north, east = config.get("wind") or (0.0, 0.0)
        self.simulation = build(
            world,
            airframe=config["airframe"],
            seed=config["seed"],
            count=config.get("count"),
            state_dir=Path(config["state_dir"]) if config.get("state_dir") else None,
            wind=Wind((north, east, 0.0), config.get("gusts") or 0.0),
            faults=fault_script.load(Path(script), rotors) if script else (),
        )
        self.simulation.advance()  # compiles, on the first run of an installation
        self.ports = Ports(self.simulation, config.get("instance"))
        self.speed = float(config["speed"])
        self._keeper = RateKeeper(TICK_US / 1e6 / self.speed)
        self.pace = PaceReport(self._keeper)

    def ready(self) -> dict[str, Any]:
        self._keeper = RateKeeper(TICK_US / 1e6 / self.speed)
        self.pace = PaceReport(self._keeper)
        return {
            "agent": [port.port for port in self.ports.agent],
            "log": [port.port for port in self.ports.log],
            "truth": self.ports.truth.port,
        }

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        if command == "begin":
            self.simulation.begin(arguments["t0_us"])
        if command == "pace":
            return self._keeper.figures()
        return None

    def turn(self) -> None:
        for port in self.ports.all():
            port.exchange()
        self.simulation.advance()
        for port in self.ports.all():
            port.exchange()
        self._keeper.wait()

    def close(self) -> None:
        for vehicle in self.simulation.vehicles:
            vehicle.close()
        for port in self.ports.all():
            port.close()


def create(config: dict[str, Any]) -> Part:
    """Return the simulator of an episode's vehicles.

    Keys episode, airframe, seed, speed, instance or None; if wanted count, state_dir, wind (north and east in m/s),
    gusts (m/s at 20 ft) and faults (a script's path). With autopilot "px4", a PX4 flies each: see `Px4Simulator`.
    Raises UsageError.
    """
    if config.get("autopilot") == "px4":
        from dronecats.sitl.px4.simulator import Px4Simulator

        return Px4Simulator(config)
    return Simulator(config)
