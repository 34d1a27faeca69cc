"""Vehicles for the tests of this folder."""

from typing import Any

import numpy as np

from vehicles.airframe import load
from vehicles.multirotor import Multirotor
from vehicles.rotor import NOMINAL_CELL_V

ORIGIN = (47.3977, 8.5456, 488.0)
HIGH = (0.0, 0.0, -100.0)  # far from the ground's effects


def vehicle(name: str = "x500", seed: int = 1, **options: Any) -> Multirotor:
    """Return a vehicle at ORIGIN with balanced rotors, on flat ground by default."""
    return Multirotor(load(name).balanced(), **{"seed": seed, "origin": ORIGIN, **options})


def spin(craft: Multirotor, speed: float | np.ndarray) -> None:
    """Set the rotor speeds (rad/s), and the commands that hold them at nominal battery voltage."""
    rotors = len(craft.airframe.rotors)
    craft.state["rotor_speed"][:rotors] = speed
    craft.state["voltage"] = NOMINAL_CELL_V * craft.airframe.battery.cells
    craft.actuators["armed"] = 1
    craft.actuators["command"][:rotors] = np.asarray(speed) / craft.airframe.curve.speed_max
