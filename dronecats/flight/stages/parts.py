"""The child processes that a flight may stand on, each the module whose `create` makes it."""

import math
from pathlib import Path

from dronecats.flight.logger.config import EstimateLoggerConfig, LoggerConfig
from dronecats.flight.processes.supervisor import ChildKind
from dronecats.flight.sitl.config import CameraConfig, FlightConditions, HostStalls, SimulatorConfig, TruthBridgeConfig
from dronecats.flight.spec.disturbances import FrameFaults, VehicleFaults
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
        payload_kg=spec.disturbances.vehicle.payload_kg,
        disturbed=conditions_of(spec.disturbances.vehicle),
        stalls=HostStalls(share=spec.disturbances.vehicle.stalled, seconds=spec.disturbances.vehicle.stall_s),
    )


def conditions_of(faults: VehicleFaults) -> FlightConditions:
    """Return in what they are flown from the episode's beginning on."""
    return FlightConditions(
        wind_ned=faults.wind_ned,
        gusts_w20=faults.gusts_w20,
        gps_delay_s=faults.gps_delay_s,
        gps_noise=faults.gps_noise,
        sensor_noise=faults.estimator_noise,
    )


def truth_kept(faults: FrameFaults) -> int:
    """Return how many samples of the truth a camera remembers, so that it can show what was to be seen a moment ago."""
    return KEPT + math.ceil(faults.reach_s * TRUTH_HZ)
