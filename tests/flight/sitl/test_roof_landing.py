"""A landing on a roof ends like one on the ground: upright, disarmed, at the touchdown place."""

import math

import numpy as np
import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from tests.vehicles.test_collisions import block, solid
from vehicles import airframe

ROOF_M = 4.0
ROOF = solid(block((0.0, 0.0, -ROOF_M / 2), (3.0, 3.0, ROOF_M / 2)))


def test_a_landing_on_a_roof_ends_upright_and_disarmed():
    place = BootPose((0.0, 0.0, -ROOF_M - 0.3), 0.0)
    vehicle = SimulatedVehicle(0, airframe.load("x500"), place, seed=2, origin=(47.4, 8.5, 488.0), obstacles=ROOF)
    commander, truth = vehicle.autopilot.commander, vehicle.plant.truth
    reports = []
    while commander.arming_failures():
        vehicle.advance()
        reports += [vehicle.collisions()]
    assert sum(map(bool, reports)) == 1  # the drop at boot; then the vehicle stands
    commander.take_off(math.nan)
    commander.arm()
    for _ in range(700):
        vehicle.advance()
    assert truth["position_ned"][2] < -ROOF_M - 2.0
    commander.set_mode("LAND")
    reports = []
    for _ in range(2000):
        vehicle.advance()
        reports += [vehicle.collisions()]
    assert sum(map(bool, reports)) <= 2  # the end of the earlier contact, and the touchdown; then the vehicle stands
    assert not commander.armed
    assert truth["position_ned"][2] == pytest.approx(-ROOF_M, abs=0.3)
    assert float(np.linalg.norm(truth["attitude"][1:3])) < math.sin(math.radians(2.0))
