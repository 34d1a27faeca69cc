"""A simulated vehicle in its own process, for the links and clients of tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import AIRFRAME, CameraConfig, SimulatorConfig
from dronecats.flight.stages.stage import CAMERA, SIMULATOR

EPISODE = "residential-approaching-01"


def start_vehicle(
    supervisor: Supervisor, speed: float = 1.0, state_dir: Path | None = None, airframe: str = AIRFRAME
) -> dict[str, Any]:
    """Start a vehicle at the start of `EPISODE`, `speed` times as fast as the wall clock; return its ports by name.

    `state_dir` keeps its parameters, plans, logs and clients' files. With None, nothing is kept.
    """
    folder = str(state_dir) if state_dir else None
    config = SimulatorConfig(episode=EPISODE, airframe=airframe, speed=speed, state_dir=folder)
    return supervisor.start(SIMULATOR, config).ready()


@contextmanager
def simulated_rig(folder: Path) -> Iterator[tuple[int, str]]:
    """Yield the agent's port of a vehicle and the URL of its camera, for any pilot.

    The vehicle flies in real time, because its failsafe allows a second of vehicle time without setpoints. At double
    speed, half a second in which a busy machine does not run the agent would end a flight.
    """
    supervisor = Supervisor(folder)
    try:
        ports = start_vehicle(supervisor)
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
