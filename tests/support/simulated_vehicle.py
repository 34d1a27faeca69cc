"""A simulated vehicle in its own process, for the links and clients of tests."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import AIRFRAME, CameraConfig, SimulatorConfig
from dronecats.flight.stages.stage import CAMERA, SIMULATOR

EPISODE = "residential-approaching-01"
# A busy machine may pause a client for seconds. With PX4's defaults, a second of vehicle time without setpoints ends
# Offboard, and ten seconds between arming and take-off disarm the vehicle.
PATIENT = {"COM_OF_LOSS_T": 60.0, "COM_DISARM_PRFLT": -1.0}


def start_vehicle(
    supervisor: Supervisor, speed: float = 1.0, state_dir: Path | None = None, airframe: str = AIRFRAME
) -> dict[str, Any]:
    """Start a vehicle at the start of `EPISODE`, `speed` times as fast as the wall clock; return its ports by name.

    `state_dir` keeps its parameters, plans, logs and clients' files. With None, nothing is kept.
    """
    folder = str(state_dir) if state_dir else None
    config = SimulatorConfig(episode=EPISODE, airframe=airframe, speed=speed, state_dir=folder)
    return supervisor.start(SIMULATOR, config).ready()


def patient_state(folder: Path) -> Path:
    """Make and return a `state_dir` whose vehicle waits for a paused client."""
    vehicle = folder / "state" / "vehicle-1"
    vehicle.mkdir(parents=True)
    (vehicle / "parameters.json").write_text(json.dumps(PATIENT))
    return vehicle.parent


@contextmanager
def simulated_rig(folder: Path) -> Iterator[tuple[int, str]]:
    """Yield the agent's port of a patient vehicle and the URL of its camera, for any pilot."""
    supervisor = Supervisor(folder)
    try:
        ports = start_vehicle(supervisor, state_dir=patient_state(folder))
        truth = f"udpout://127.0.0.1:{ports['truth']}"
        camera = supervisor.start(CAMERA, CameraConfig(episode=EPISODE, truth=truth))
        yield ports["agent"][0], str(camera.ready()["url"])
    finally:
        supervisor.close()


@contextmanager
def simulated_vehicle(
    folder: Path, speed: float = 1.0, state_dir: Path | None = None, airframe: str = AIRFRAME
) -> Iterator[dict[str, Any]]:
    """Yield the ports of a vehicle by name. The vehicle ends with the block. Its log is in `folder`."""
    supervisor = Supervisor(folder)
    try:
        yield start_vehicle(supervisor, speed, state_dir, airframe)
    finally:
        supervisor.close()
