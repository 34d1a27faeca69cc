"""The child processes that a flight may stand on, each the module whose `create` makes it."""

from dronecats.processes.supervisor import Kind

SIMULATOR = Kind("simulator", "dronecats.sitl.simulator_process")
CAMERA = Kind("camera", "dronecats.sitl.camera_process")
TRUTH_BRIDGE = Kind("truth-bridge", "dronecats.sitl.truth_bridge")
LOGGER = Kind("logger", "dronecats.logger.logger_process")
ESTIMATE_LOGGER = Kind("estimate-logger", "dronecats.logger.estimate_process")
PILOT = Kind("pilot", "dronecats.pilots.pilot_process")
