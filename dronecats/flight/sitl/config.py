"""Configurations of the simulator's processes."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dronecats.flight.spec.disturbances import VehicleFaults
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.truth import KEPT

AIRFRAME = "x500"  # if none is named


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorConfig:
    """Vehicles and who flies them."""

    episode: str  # id, or a record's file; drones stand on the ground below its starts
    airframe: str = AIRFRAME
    seed: int = 0  # tells flights of one episode apart
    speed: float | None = 1.0  # × real time; None: as fast as it can
    instance: int | None = None  # added to every port; None: ports that the system chose
    count: int | None = None  # vehicles; None: as many as the record has starts
    least_charge: float | None = None  # 0 … 1, below which no battery is drained; None: as real ones
    disturbances: VehicleFaults | None = None  # a payload from boot, the others from the episode's begin on
    from_boot: bool = False  # the others from boot, too
    faults: str | None = None  # file of a fault script
    state_dir: str | None = None  # where parameters, plans and logs stay; None: nowhere
    autopilot: Literal["ours", "px4"] = "ours"
    px4: str | None = None  # the command that starts a PX4; None: it is waited for
    log_dir: str | None = None  # for what a PX4 prints
    keep_ulogs: str | None = None  # folder for the logs that each PX4 has written on board; None: they are not kept
    restart: bool = False  # whether a PX4 that ends is started again
    sign: str | None = None  # file of the key with which our autopilot signs; None: it does not
    hitl: str | None = None  # URL of a board that flies the vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """A camera in an episode's world."""

    episode: str
    truth: str  # URL of the truth bus
    airframe: str | None = None  # of the drones that are in the pictures
    count: int | None = None
    port: int = 0  # TCP; 0: one that the system chose
    or_next_free: bool = False  # where the port is in use: the next free one instead of an error
    optics: dict[str, Any] | None = None
    conditions: SceneConditions = AS_BUILT
    seed: int = 0  # tells flights of one episode apart, with optics
    kept: int = KEPT  # samples of the truth of each drone, of which pictures can be had


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthBridgeConfig:
    """A vehicle that simulates itself, moved to an episode's start."""

    episode: str
    truth: str  # URL of its true poses


def noise_seed(episode: int, flight: int, vehicle: int) -> int:
    """Return the seed of all that is random about a vehicle: of its episode, this flight of it, its place in the fleet.

    Neighbouring numbers share nothing (numpy's SeedSequence), and it fits a signed 64-bit integer.
    """
    return int(np.random.SeedSequence((episode, flight, vehicle)).generate_state(1, np.uint64)[0] >> np.uint64(1))
