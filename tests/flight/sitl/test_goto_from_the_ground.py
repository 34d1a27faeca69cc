"""MAVSDK's goto example in the full simulation: the order comes one second after take-off, still on the ground."""

import math

import numpy as np
import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from foundation.frames import ned_to_geodetic
from foundation.mavlink import Packer, dialect
from vehicles import airframe

ORIGIN = (47.397742, 8.545594, 488.0)
FAR_NED = (-15.0, -190.0, -20.0)


@pytest.mark.parametrize("after_s", [0.2, 1.0, 1.6, 2.5])
def test_a_goto_right_after_takeoff_is_flown_without_tipping_over(after_s):
    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 1.0), seed=6, origin=ORIGIN)
    port, packer = vehicle.open_port("minimal"), Packer(245, 190)
    places, tilts = [], []

    def live(seconds):
        for _ in range(round(seconds * 100)):
            vehicle.advance()
            port.take()
            truth = vehicle.plant.truth
            _, x, y, _ = (float(q) for q in truth["attitude"])
            places.append(truth["position_ned"].copy())
            tilts.append(math.degrees(math.acos(1.0 - 2.0 * (x * x + y * y))))

    live(5.0)
    commander = vehicle.autopilot.commander
    assert commander.arm() == dialect.MAV_RESULT_ACCEPTED
    commander.take_off(math.nan)
    live(after_s)
    lat, lon, alt = ned_to_geodetic(*ORIGIN, *FAR_NED)
    port.receive(
        packer.pack(
            dialect.MAVLink_command_int_message(
                1, 1, dialect.MAV_FRAME_GLOBAL_INT, dialect.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, 1.0, 0.0, 0.0,
                round(lat * 1e7), round(lon * 1e7), alt,
            )
        )
    )  # fmt: skip
    live(50.0)
    heights = -np.array(places)[:, 2] + places[0][2]  # m above its start
    off = int(np.argmax(heights > 0.1))
    assert heights[off] > 0.1
    assert max(tilts[:off]) < 5.0  # it does not tip over its own legs
    assert vehicle.plant.state["crashed"] == 0
    assert places[-1] == pytest.approx(FAR_NED, abs=2.0)
