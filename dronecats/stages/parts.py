"""The child processes that a flight may stand on, each the module whose `create` makes it."""

from pathlib import Path

from dronecats.flight.spec import FlightSpec, Simulated
from dronecats.logger.config import EstimateLoggerConfig, LoggerConfig
from dronecats.pilots.config import PilotConfig
from dronecats.processes.supervisor import Kind
from dronecats.rundir import layout
from dronecats.sitl.config import CameraConfig, SimulatorConfig, TruthBridgeConfig

SIMULATOR = Kind("simulator", "dronecats.sitl.simulator_process", SimulatorConfig)
CAMERA = Kind("camera", "dronecats.sitl.camera_process", CameraConfig)
TRUTH_BRIDGE = Kind("truth-bridge", "dronecats.sitl.truth_bridge", TruthBridgeConfig)
LOGGER = Kind("logger", "dronecats.logger.logger_process", LoggerConfig)
ESTIMATE_LOGGER = Kind("estimate-logger", "dronecats.logger.estimate_process", EstimateLoggerConfig)
PILOT = Kind("pilot", "dronecats.pilots.pilot_process", PilotConfig)


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
