"""FOLLOW in the full simulation, as in MAVSDK's example: the target jumps, and the vehicle keeps the set height."""

import math

import numpy as np
import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from foundation.frames import ned_to_geodetic
from foundation.mavlink import Packer, dialect
from vehicles import airframe

ORIGIN = (47.397742, 8.545594, 488.0)
JUMPS = ((33.0, -1.6), (33.0, -43.6), (9.5, -44.0))  # m north and east, two seconds each
HEIGHT_M = 8.0


@pytest.mark.parametrize("below_home_m", [8.0, 0.0])
def test_a_jumping_target_is_followed_at_the_set_height(below_home_m):
    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=2, origin=ORIGIN)
    port, packer = vehicle.open_port("minimal"), Packer(245, 190)
    commander, heights = vehicle.autopilot.commander, []

    def live(seconds):
        for _ in range(round(seconds * 100)):
            vehicle.advance()
            port.take()
            heights.append(-float(vehicle.plant.truth["position_ned"][2]))
        return np.array(heights[-round(seconds * 100) :])

    live(5.0)
    wanted = {"HT": HEIGHT_M, "DST": 2.0, "FA": 0.0, "RS": 0.02, "ALT_M": 2, "MAX_VEL": 10.0}
    for name, value in wanted.items():
        vehicle.autopilot.parameters.set(f"FLW_TGT_{name}", value)
    assert commander.arm() == dialect.MAV_RESULT_ACCEPTED
    commander.take_off(math.nan)
    live(8.0)
    commander.set_mode("FOLLOW")
    waiting = live(4.0)
    assert np.ptp(waiting) < 0.3  # no target to follow: the vehicle holds its position
    for north, east in JUMPS:
        lat, lon, alt = ned_to_geodetic(*ORIGIN, north, east, below_home_m)
        port.receive(
            packer.pack(
                dialect.MAVLink_follow_target_message(
                    0, 0, round(lat * 1e7), round(lon * 1e7), alt, [0.0] * 3, [0.0] * 3, [0.0] * 4, [0.0] * 3,
                    [0.0] * 3, 0,
                )
            )
        )  # fmt: skip
        live(2.0)
    travelled = float(np.hypot(*vehicle.plant.truth["position_ned"][:2]))
    assert travelled > 15.0
    commander.set_mode("HOLD")
    stopped = live(8.0)
    assert max(heights) < HEIGHT_M + 1.0  # includes the error of the estimate
    assert stopped == pytest.approx(HEIGHT_M, abs=1.0)
    assert np.ptp(stopped[400:]) < 0.4
