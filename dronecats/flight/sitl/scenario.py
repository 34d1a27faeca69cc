"""A simulation built from an episode record: the map's ground, and each vehicle on it below its start pose."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Unpack

import numpy as np

from dronecats.flight.disturbances import VehicleFaults
from dronecats.flight.sitl.collisions import Traffic
from dronecats.flight.sitl.config import AIRFRAME
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle, Simulation, V
from dronecats.flight.sitl.vehicle import Physics
from episodes.maps.assets.multirotor import outline
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from episodes.world.obstacles import obstacles
from episodes.world.world import World
from foundation.airframe import Airframe
from foundation.truth import Origin
from vehicles import airframe as airframes
from vehicles.faults import Fault
from vehicles.wind import CALM, Wind


def origin(world: World) -> Origin:
    """Return the geodetic place of the map's NED origin."""
    return world.scene.latitude_deg, world.scene.longitude_deg, world.scene.altitude_m


def boot_poses(world: World) -> list[BootPose]:
    """Return where each drone of the record stands before it takes off: on the ground below its start pose."""
    poses = []
    for start in world.record.starts:
        north, east, _ = start.position_ned
        poses.append(BootPose((north, east, world.ground_down(north, east)), math.radians(start.yaw_deg)))
    return poses


def build(
    world: World,
    *,
    airframe: str = AIRFRAME,
    seed: int = 0,
    count: int | None = None,
    state_dir: Path | None = None,
    wind: Wind = CALM,
    disturbances: VehicleFaults | None = None,
    faults: Sequence[Fault] = (),
) -> Simulation[SimulatedVehicle]:
    """Return the simulation of a record's drones under our autopilot, or of `count` of them, as `built_of` has it."""

    def make(index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> SimulatedVehicle:
        folder = state_dir / f"vehicle-{index + 1}" if state_dir else None
        return SimulatedVehicle(index, airframe, pose, state_dir=folder, **physics)

    return built_of(
        make,
        world,
        airframe=airframe,
        seed=seed,
        count=count,
        wind=wind,
        disturbances=disturbances,
        faults=faults,
    )


def built_of(
    make: Callable[..., V],
    world: World,
    *,
    airframe: str = AIRFRAME,
    seed: int = 0,
    count: int | None = None,
    wind: Wind = CALM,
    disturbances: VehicleFaults | None = None,
    faults: Sequence[Fault] = (),
) -> Simulation[V]:
    """Return the simulation of a record's drones, or of `count` of them, as `make` makes them of `Vehicle`'s arguments.

    The record's own seed is behind all that is random; `seed` tells flights of one episode apart. All boot in the same
    wind, have the same disturbances once the episode has begun (a payload from boot) and the same faults. Raises
    UsageError for an unknown airframe, a payload that it cannot carry or an impossible fault.
    """
    solid = obstacles(world.scene)
    frame = airframes.load(airframe)
    poses = boot_poses(world)
    while count is not None and len(poses) < count:  # more than the record has: beside one another, two metres apart
        last = poses[-1].position_ned
        north, east = last[0], last[1] + 2.0
        poses.append(BootPose((north, east, world.ground_down(north, east)), poses[-1].yaw))
    return Simulation(
        [
            make(
                index,
                frame,
                pose,
                seed=noise_seed(world.record.seed, seed, index),
                origin=origin(world),
                terrain=world.scene.terrain,
                obstacles=solid,
                wind=wind,
                payload_kg=disturbances.payload_kg if disturbances else 0.0,
                faults=faults,
            )
            for index, pose in enumerate(poses[:count])
        ],
        Traffic(world.target_upright) if solid.moving else None,
        disturbances,
    )


def noise_seed(episode: int, flight: int, vehicle: int) -> int:
    """Return the seed of all that is random about a vehicle: of its episode, this flight of it, its place in the fleet.

    Neighbouring numbers share nothing (numpy's SeedSequence), and it fits a signed 64-bit integer.
    """
    return int(np.random.SeedSequence((episode, flight, vehicle)).generate_state(1, np.uint64)[0] >> np.uint64(1))


def load_world(episode: str, airframe: str | None = None, count: int | None = None) -> World:
    """Return the world of an episode id or file, `count` vehicles of an airframe in its pictures. Raises UsageError."""
    return world_of(catalogue.load(episode), airframe, count)


def world_of(record: EpisodeRecord, airframe: str | None = None, count: int | None = None) -> World:
    """Return the world of a record, as `load_world` does. Raises UsageError."""
    return World(record, outline(airframes.load(airframe or AIRFRAME)), count)
