"""Configurations of the simulator's processes."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dronecats.flight.spec.disturbances import VehicleFaults
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.truth import KEPT

AIRFRAME = "x500"  # the default airframe


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorConfig:
    """Configuration of the simulated vehicles and their autopilots."""

    episode: str  # id, or path of a record file; the drones boot on the ground below the record's start poses
    airframe: str = AIRFRAME
    seed: int = 0  # differs between flights of one episode
    speed: float | None = 1.0  # × real time; None: with PX4 as fast as possible, else real time
    instance: int | None = None  # added to every port; None: the system chooses the ports
    count: int | None = None  # vehicles; None: as many as the record has starts
    least_charge: float | None = None  # 0 … 1, lower bound of the battery charge; None: no bound
    disturbances: VehicleFaults | None = None  # a payload acts from boot, all others from the episode's start
    from_boot: bool = False  # True: all disturbances act from boot
    faults: str | None = None  # file of a fault script
    state_dir: str | None = None  # folder that keeps parameters, plans and logs; None: not kept
    autopilot: Literal["ours", "px4"] = "ours"
    px4: str | None = None  # the command that starts a PX4; None: wait for a PX4
    log_dir: str | None = None  # folder for PX4's output
    keep_ulogs: str | None = None  # folder for a copy of each PX4's own log; None: no copy
    restart: bool = False  # whether to restart a PX4 that ends
    sign: str | None = None  # key file for signed messages of the project's autopilot; None: unsigned messages
    hitl: str | None = None  # URL of the autopilot board that flies the vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """Configuration of a camera in an episode's world."""

    episode: str
    truth: str  # URL of the truth bus
    airframe: str | None = None  # sets the camera mount and the drones in the pictures; None: AIRFRAME
    count: int | None = None  # vehicles in the pictures; None: as many as the record has starts
    port: int = 0  # TCP; 0: the system chooses one
    or_next_free: bool = False  # if the port is in use, take the next free one
    optics: dict[str, Any] | None = None
    conditions: SceneConditions = AS_BUILT
    seed: int = 0  # seeds random effects of the optics; differs between flights of one episode
    kept: int = KEPT  # truth samples to keep per drone, for pictures of past times


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthBridgeConfig:
    """Configuration of the bridge that places a vehicle with an external simulator at an episode's start."""

    episode: str
    truth: str  # URL of the vehicle's true poses


def noise_seed(episode: int, flight: int, vehicle: int) -> int:
    """Return the seed of a vehicle's random values, from the seeds of episode and flight and the vehicle's number.

    Neighbouring numbers give independent seeds (numpy's SeedSequence). A seed fits a signed 64-bit integer.
    """
    return int(np.random.SeedSequence((episode, flight, vehicle)).generate_state(1, np.uint64)[0] >> np.uint64(1))
