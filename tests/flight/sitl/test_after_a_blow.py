"""The estimator after an impact beyond the range of the accelerometers."""

import numpy as np
import pytest

from tests.flight.sitl.before_a_wall import flying, stream


def error(vehicle, name):
    return float(np.linalg.norm(vehicle.plant.truth[name] - vehicle.core.estimate[name]))


@pytest.mark.parametrize("speed", [2.5, 3.0])
def test_the_velocity_estimate_recovers_within_half_a_second_of_an_impact(speed):
    vehicle = flying(1)
    for tick in range(2000):
        if tick % 5 == 0:
            stream(vehicle, speed)
        vehicle.advance()
        if vehicle.plant.state["hits"]:
            break
    for _ in range(10):
        vehicle.advance()
    assert vehicle.plant.memory["accel_clipped"] > 0
    assert error(vehicle, "velocity_ned") > 0.3  # the acceleration beyond the range is lost
    vehicle.autopilot.commander.set_mode("HOLD")
    for _ in range(40):
        vehicle.advance()
    assert error(vehicle, "velocity_ned") < 0.5
    heights = []
    for _ in range(800):
        vehicle.advance()
        heights.append(-float(vehicle.plant.truth["position_ned"][2]))
    assert error(vehicle, "position_ned") < 1.0
    assert max(heights) - min(heights) < 1.0
    assert vehicle.autopilot.commander.mode == "HOLD"
