"""The child processes that a flight may stand on, each the module whose `create` makes it."""

import math
from pathlib import Path

from dronecats.flight.disturbances import FrameFaults
from dronecats.flight.logger.config import EstimateLoggerConfig, LoggerConfig
from dronecats.flight.processes.supervisor import ChildKind
from dronecats.flight.sitl.config import CameraConfig, SimulatorConfig, TruthBridgeConfig
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots.pilot_process import PilotConfig
from foundation.run_folder import layout
from foundation.truth import KEPT

SIMULATOR = ChildKind("simulator", "dronecats.flight.sitl.simulator_process", SimulatorConfig)
CAMERA = ChildKind("camera", "dronecats.flight.sitl.camera", CameraConfig)
TRUTH_BRIDGE = ChildKind("truth-bridge", "dronecats.flight.sitl.truth_bridge", TruthBridgeConfig)
LOGGER = ChildKind("logger", "dronecats.flight.logger.logger_process", LoggerConfig)
ESTIMATE_LOGGER = ChildKind("estimate-logger", "dronecats.flight.logger.estimate_process", EstimateLoggerConfig)
COMMANDER = ChildKind("commander", "dronecats.pilots.pilot_process", PilotConfig)
PILOT = ChildKind("pilot", "dronecats.pilots.pilot_process", PilotConfig)
TRUTH_HZ = 50.0


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
        keep_ulogs=str(folder) if spec.keep_ulog else None,
        disturbances=spec.disturbances.vehicle,
    )


def truth_kept(faults: FrameFaults) -> int:
    """Return how many samples of the truth a camera remembers, so that it can show what was to be seen a moment ago."""
    return KEPT + math.ceil(faults.reach_s * TRUTH_HZ)
