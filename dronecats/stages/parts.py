"""The child processes that a flight may stand on, each the module whose `create` makes it."""

from pathlib import Path

from dronecats.flight.spec import FlightSpec, Simulated
from dronecats.logger.config import EstimateLoggerConfig, LoggerConfig
from dronecats.pilots.config import PilotConfig
from dronecats.processes.supervisor import ChildKind
from dronecats.rundir import layout
from dronecats.sitl.config import CameraConfig, SimulatorConfig, TruthBridgeConfig

SIMULATOR = ChildKind("simulator", "dronecats.sitl.simulator_process", SimulatorConfig)
CAMERA = ChildKind("camera", "dronecats.sitl.camera_process", CameraConfig)
TRUTH_BRIDGE = ChildKind("truth-bridge", "dronecats.sitl.truth_bridge", TruthBridgeConfig)
LOGGER = ChildKind("logger", "dronecats.logger.logger_process", LoggerConfig)
ESTIMATE_LOGGER = ChildKind("estimate-logger", "dronecats.logger.estimate_process", EstimateLoggerConfig)
COMMANDER = ChildKind("commander", "dronecats.pilots.pilot_process", PilotConfig)
PILOT = ChildKind("pilot", "dronecats.pilots.pilot_process", PilotConfig)


def simulator_config(spec: FlightSpec, simulated: Simulated, folder: Path) -> SimulatorConfig:
    """Return the simulator of a flight whose record is in `folder`."""
    return SimulatorConfig(
        episode=str(folder / layout.EPISODE),
        airframe=simulated.airframe,
        seed=spec.seed,
        speed=simulated.speed,
        autopilot=simulated.autopilot,
        px4=simulated.px4,
        log_dir=str(folder),
    )
