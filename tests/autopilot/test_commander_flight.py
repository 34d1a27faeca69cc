"""Complete flights with simulated physics, sensors, estimator and cascade, commanded over MAVLink only."""

import math

import numpy as np
import pytest

from autopilot.records import KIND_TRAJECTORY
from foundation.mavlink import dialect
from tests.autopilot.aircraft import Aircraft


def ground_speed(aircraft: Aircraft) -> float:
    return math.hypot(*aircraft.truth["velocity_ned"][:2])


@pytest.mark.parametrize("name", ["x500", "racer250", "nano", "hexa"])
def test_a_mavlink_client_flies_take_off_offboard_hold_and_landing(name: str) -> None:
    craft = Aircraft(name, seed=3)
    client = craft.client
    start = craft.truth["position_ned"].copy()
    craft.until(lambda: not craft.commander.arming_failures(), 15.0)
    craft.run(1.5)
    status = client.of("SYS_STATUS")[-1]
    for bit in (0x1, 0x2, 0x4, 0x20, 0x10000000):
        assert status.onboard_control_sensors_health & bit

    assert client.arm() == 0
    assert client.command(dialect.MAV_CMD_NAV_TAKEOFF) == 0
    craft.until(lambda: craft.commander.mode == "HOLD", 20.0)
    craft.run(3.0)
    assert start[2] - craft.truth["position_ned"][2] == pytest.approx(2.5, abs=0.6)

    def forward() -> None:
        client.velocity(1.2, 0.0, 0.0)

    forward()
    assert client.mode(6) == 0
    craft.run(4.0, forward)
    assert ground_speed(craft) == pytest.approx(1.2, abs=0.25)
    assert abs(craft.truth["velocity_ned"][2]) < 0.3
    craft.run(1.5, lambda: client.velocity(0.0, 0.0, 0.0, yaw_rate=math.radians(60.0)))
    craft.run(1.0, lambda: client.velocity(0.0, 0.0, 0.0))
    assert math.degrees(craft.autopilot.state.yaw) == pytest.approx(90.0, abs=25.0)
    assert craft.commander.mode == "OFFBOARD"

    assert client.mode(4, 3) == 0
    craft.run(3.0)
    assert ground_speed(craft) < 0.3
    assert client.command(dialect.MAV_CMD_NAV_LAND) == 0
    craft.until(lambda: craft.commander.landed, 20.0)
    assert abs(craft.truth["position_ned"][2] - start[2]) < 0.1  # on the ground in the truth, not only in the estimate
    craft.run(2.5)
    assert not craft.commander.armed
    craft.run(1.0)
    assert np.allclose(craft.truth["velocity_ned"], 0.0, atol=0.05)
    texts = client.texts()
    assert not any("Failsafe" in text for text in texts)
    assert client.port.lost == 0


def test_the_vehicle_lands_and_disarms_after_setpoint_loss() -> None:
    craft = Aircraft("x500", seed=5)
    client = craft.client
    craft.until(lambda: not craft.commander.arming_failures(), 15.0)
    client.velocity(0.0, 0.0, -1.0)
    assert client.mode(6) == 0
    assert client.arm() == 0
    craft.run(7.0, lambda: client.velocity(0.0, 0.0, -1.0))
    assert craft.truth["position_ned"][2] < -2.5
    craft.run(2.5)
    assert craft.commander.mode == "POSCTL"
    assert craft.truth["velocity_ned"][2] == pytest.approx(0.7, abs=0.2)
    craft.until(lambda: not craft.commander.armed, 20.0)


def test_a_descent_from_above_the_rangefinder_keeps_its_thrust() -> None:
    craft = Aircraft("x500", seed=3)
    craft.take_off(20.0)
    assert math.isnan(craft.autopilot.state.range_m())
    assert craft.client.command(dialect.MAV_CMD_NAV_LAND) == 0
    for _ in range(150):
        craft.run(0.02)
        assert craft.commander.passed.kind == KIND_TRAJECTORY
        assert craft.truth["velocity_ned"][2] < 2.5
