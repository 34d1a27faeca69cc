"""Pressing against obstacles: the estimate holds, the vehicle stays upright and slow, and obeys later orders."""

import numpy as np
import pytest

from benchmarks.presses import BLOCKS, RESIDENTIAL, Press, fly
from tests.flight.sitl.before_a_wall import flying, stream
from vehicles.wind import Wind

PRESSES = (
    Press(BLOCKS, "cylinder-1", beside=0.7, seconds=15.0),
    Press(BLOCKS, "box-1", 45.0, seconds=12.0, wind_n=5.0),
    Press(BLOCKS, "ramp-1", seconds=15.0),
    Press(RESIDENTIAL, "ground", seconds=5.0),
)


@pytest.mark.parametrize("press", PRESSES, ids=lambda press: f"{press.thing}-{press.turn_deg:g}")
def test_pressing_against_an_obstacle_does_no_harm(press):
    outcome = fly(press, 1)
    assert outcome.beyond == ()
    assert outcome.clipped == outcome.resets == 0


@pytest.mark.parametrize("speed", [6.0, -10.0])
def test_wind_is_not_taken_for_a_wall(speed):
    vehicle = flying(1)
    vehicle.plant.set_wind(Wind((speed, 0.0, 0.0)))
    off = []
    for tick in range(1200):
        if tick % 5 == 0:
            stream(vehicle, 0.0)
        vehicle.advance()
        off.append(abs(float(vehicle.plant.truth["velocity_ned"][0])))
    assert np.mean(off[-300:]) < 0.2


def test_the_push_against_a_wall_stays_small():
    """Even long after the contact, the integral of the velocity controller is small, so the vehicle leans little."""
    vehicle = flying(1)
    for tick in range(4500):
        if tick % 5 == 0:
            stream(vehicle, 1.2)
        vehicle.advance()
    assert vehicle.plant.state["hits"] > 0
    assert float(np.linalg.norm(vehicle.core.state["velocity_integral"][:2])) < 1.5
