"""An X500 hovers in front of a wall. Tests fly it with velocity setpoints through its commander."""

import numpy as np

from autopilot.records import FREE, NAN, CascadeSetpoint
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from episodes.world.obstacles import sorted_into_cells
from vehicles import airframe

WALL_M = 20.0  # north
HEIGHT_M = 8.0


def wall():
    corners = [(WALL_M, -20.0, 0.0), (WALL_M, 20.0, 0.0), (WALL_M, 20.0, -30.0), (WALL_M, -20.0, -30.0)]
    triangles = np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])
    return sorted_into_cells(triangles, np.zeros(2, np.int32), ("wall",), 0.7)


def flying(seed, north=0.0):
    place, origin = BootPose((north, 0.0, 0.0), 0.0), (47.4, 8.5, 488.0)
    vehicle = SimulatedVehicle(0, airframe.load("x500"), place, seed=seed, origin=origin, obstacles=wall())
    commander = vehicle.autopilot.commander
    while commander.arming_failures():
        assert vehicle.time_us < 60_000_000
        vehicle.advance()
    for _ in range(300):
        vehicle.advance()
    commander.take_off(-HEIGHT_M)
    commander.arm()
    for _ in range(1000):
        vehicle.advance()
    stream(vehicle, 0.0)
    commander.set_mode("OFFBOARD")
    return vehicle


def stream(vehicle, north):
    offboard = vehicle.autopilot.commander.flight.offboard
    offboard.setpoint = CascadeSetpoint(
        position_ned=(NAN, NAN, -HEIGHT_M), velocity_ned=(north, 0.0, NAN), acceleration_ned=FREE, yaw=0.0
    )
    offboard.time_us = vehicle.autopilot.state.time_us
