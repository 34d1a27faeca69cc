"""Vehicles for the tests of this folder."""

from typing import Any

import numpy as np

from foundation.frames import GRAVITY
from vehicles.airframe import load
from vehicles.battery import NOMINAL_CELL_V
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite

ORIGIN = (47.3977, 8.5456, 488.0)
HIGH = (0.0, 0.0, -100.0)  # far from the ground's effects
PERFECT = Suite(
    accel_noise_density=0.0,
    accel_random_walk=0.0,
    accel_bias=0.0,
    accel_scale=0.0,
    gyro_noise_density=0.0,
    gyro_random_walk=0.0,
    gyro_bias=0.0,
    gyro_scale=0.0,
    mag_noise=0.0,
    mag_bias=0.0,
    baro_noise_hpa=0.0,
    baro_drift_hpa=0.0,
    gps_error_h=0.0,
    gps_error_v=0.0,
    gps_noise=0.0,
    gps_velocity_noise_h=0.0,
    gps_velocity_noise_v=0.0,
    range_noise_m=0.0,
)


def vehicle(name: str = "x500", seed: int = 1, **options: Any) -> Multirotor:
    """Return a vehicle at ORIGIN, on flat ground unless told otherwise."""
    return Multirotor(load(name), **{"seed": seed, "origin": ORIGIN, **options})


def spin(craft: Multirotor, speed: float | np.ndarray) -> None:
    """Let the rotors turn at `speed` (rad/s) now, and command them to keep it at a pack of nominal voltage."""
    rotors = len(craft.airframe.rotors)
    craft.state["rotor_speed"][:rotors] = speed
    craft.state["voltage"] = NOMINAL_CELL_V * craft.airframe.battery.cells
    craft.actuators["armed"] = 1
    craft.actuators["command"][:rotors] = np.asarray(speed) / craft.airframe.curve.speed_max


def hover_speed(craft: Multirotor) -> float:
    """Return the rotor speed (rad/s) whose thrust equals the weight in still air, far from the ground."""
    frame = craft.airframe
    return float(np.sqrt(frame.mass_kg * GRAVITY / len(frame.rotors) / frame.curve.thrust_coefficient))
